"""The 3D scene: nodes made once, moved and shown with every snapshot."""
