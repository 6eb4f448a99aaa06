"""Dictionaries of body parts: learned from clean takes, and stored in a file without pickle."""
