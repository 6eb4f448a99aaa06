"""Takes: markers over time, with their trust, skeleton, bones and names."""

from mocapclean.take.take import Finding, Origin, ReadOptions, Solution, Take

__all__ = ["Finding", "Origin", "ReadOptions", "Solution", "Take"]
