"""Pose errors against ground truth."""
