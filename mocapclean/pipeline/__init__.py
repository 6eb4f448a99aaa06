"""One take, from reading to its outcome."""
