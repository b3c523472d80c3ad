"""The Bullet simulator, convex colliders, contacts and plausibility."""
