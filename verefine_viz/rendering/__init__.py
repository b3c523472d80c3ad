"""Depth rendering and the verification score, on OpenGL and on the CPU."""
