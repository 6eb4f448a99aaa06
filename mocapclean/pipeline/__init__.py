"""Process one take: read, select markers, detect, choose a method, fill, write and summarise; or check it against
limits.
"""
