"""Linear dynamical systems: filtering, smoothing and learning."""
