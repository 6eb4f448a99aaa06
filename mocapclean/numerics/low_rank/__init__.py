"""Low-rank matrices: shrinkage, completion, separation."""
