"""Geometry of markers and skeletons: arrays in, arrays out."""
