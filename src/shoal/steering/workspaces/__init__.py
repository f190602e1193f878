"""Workspaces: convex ones, regions with obstacles, and the files that hold them."""
