"""Pose refiners."""
