"""Units of length."""

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
"""Millimetres per unit of length; the inch is 25.4 mm by definition, and a foot is 12 inches."""
