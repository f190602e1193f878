"""Formats of mission files. Each module of this folder writes and reads one format."""

from __future__ import annotations
