"""The cells of a region: grid, viewpoints, footprints, portals between cells, and paths and
distances between cells.
"""
