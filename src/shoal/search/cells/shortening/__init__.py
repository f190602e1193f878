"""Shortening: exchanges of cells, and paths along the border, that make a tour shorter."""
