"""What is shown at one moment, computed from the state: frozen data, nothing of the GUI library."""
