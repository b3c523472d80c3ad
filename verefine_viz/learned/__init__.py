"""Learned networks as they are used: what they see, the files they come from, their inference."""
