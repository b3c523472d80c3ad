"""Headless runs over whole data sets."""
