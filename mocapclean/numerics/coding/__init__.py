"""Sparse and locality-constrained coding."""
