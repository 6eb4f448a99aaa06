"""Numerical building blocks: arrays in, arrays out; they know no take, file or method."""
