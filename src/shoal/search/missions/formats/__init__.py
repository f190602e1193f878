"""Formats of mission files. Each module writes and reads one format."""
