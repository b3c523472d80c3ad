"""Rerun recordings: writer, blueprint, reader."""
