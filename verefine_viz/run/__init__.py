"""Session files, the engine, history, breakpoints, and the composition root."""
