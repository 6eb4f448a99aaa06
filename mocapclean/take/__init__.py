"""Takes: positions of markers over time, with trust, skeleton, bones and names."""

from mocapclean.take.take import Finding, Origin, ReadOptions, Solution, Take

__all__ = ["Finding", "Origin", "ReadOptions", "Solution", "Take"]
