"""The offline page of a run: an overview of its takes, and for each take its map, curves, bones and a 3D player.

View, row -> data.take_data -> one string for each take -> building.write -> one file, or a file and a folder
"""
