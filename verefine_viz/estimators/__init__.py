"""Initial poses of an object from its segment of the frame. A package of pluggable estimators (core.protocols)."""
