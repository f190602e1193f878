"""Formats of mission files, one a file: each writes a mission and reads one back."""
