"""Workspaces: convex workspaces, regions with obstacles, and workspace files."""
