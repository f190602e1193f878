"""Workspaces of steering: convex workspaces, regions with obstacles, and files that describe
workspaces.
"""
