"""Whether camera, depth, models, masks and poses of a frame belong together."""
