"""Regions to search: polygons with holes in metres, built-in regions, region files, map projection,
and measured coverage.
"""
