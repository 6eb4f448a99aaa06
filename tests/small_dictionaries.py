"""Small trained dictionaries for tests: those on which the laws of methods are tried."""

from mocapclean.solvers.contract.takes import SMALL, learn, twelve_parts

__all__ = ["SMALL", "learn", "twelve_parts"]
