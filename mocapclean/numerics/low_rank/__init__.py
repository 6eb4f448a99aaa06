"""Low-rank matrices: proximal maps, completion, separation of sparse errors, and what hastens the iterations."""
