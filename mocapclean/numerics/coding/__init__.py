"""Sparse and locality-constrained coding, and dictionaries for it."""
