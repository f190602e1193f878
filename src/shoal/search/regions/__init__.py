"""Regions to search: polygons with holes in metres, built-in ones, files, checks of outlines, map projection, coverage."""
