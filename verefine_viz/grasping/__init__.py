"""Grasping in simulation: would a gripper that trusts an estimated pose lift the object? Source: Sec. V-D."""
