"""What is derived from a frame: normals, observed clouds, support plane and gravity."""
