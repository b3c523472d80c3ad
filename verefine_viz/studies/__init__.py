"""The paper's studies: the same frames under growing error, with every method."""
