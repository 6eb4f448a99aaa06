"""Linear dynamical systems: filtering, smoothing, learning."""
