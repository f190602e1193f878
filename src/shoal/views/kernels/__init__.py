"""Compiled functions of films."""
