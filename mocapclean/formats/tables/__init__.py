"""What the formats that are tables of text share: a text kept byte for byte, whose cells are patched in place.

A module of a maker finds the header: names, columns, unit, rate and first frame (``reading.Header``). The rest is here.
"""
