"""The paper's algorithms and the policies it compares with, one page each."""
