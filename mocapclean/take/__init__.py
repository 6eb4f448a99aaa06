"""Takes: positions of markers over time, with trust, skeleton, bones and names."""

from mocapclean.take.take import Event, Exchanged, Finding, Origin, ReadOptions, Solution, Take, require_take

__all__ = ["Event", "Exchanged", "Finding", "Origin", "ReadOptions", "Solution", "Take", "require_take"]
