"""The 3D scene: nodes made once, moved and shown with every snapshot; what is below ``/cam`` is in the camera frame."""
