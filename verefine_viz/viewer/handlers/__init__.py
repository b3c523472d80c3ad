"""What the commands do to the state."""
