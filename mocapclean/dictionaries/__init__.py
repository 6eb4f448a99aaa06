"""Dictionaries of body parts: learnt from clean takes, kept in a file without pickle."""
