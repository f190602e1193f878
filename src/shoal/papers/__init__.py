"""The figures of the papers, each as a recipe: sweeps, a view, what is published, and how far ours is from it.

Papers: M, Mapping and coverage with a particle swarm controlled by uniform inputs (2017); D, its draft; W, two particles with
non-slip wall contacts; H, exhaustive search along a space-filling curve (1998).
"""

from __future__ import annotations

from shoal.papers.recipe import Outcome, Recipe, Result, Settings, Table
from shoal.papers.reproduce import recipes, reproduce, reproduce_all

__all__ = ["Outcome", "Recipe", "Result", "Settings", "Table", "recipes", "reproduce", "reproduce_all"]
