"""Regions to search: polygons with holes in metres, built-in regions, files, outline checks, map projection, coverage."""
