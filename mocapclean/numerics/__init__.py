"""Numerical building blocks: arrays in, arrays out, without takes, files or methods."""
