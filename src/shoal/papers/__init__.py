"""Reproduction of the figures and theorems of the papers on which Shoal is based.

For each figure and theorem, a recipe describes the sweeps, the drawing, and the claims that compare
the paper with Shoal's results.

Paper M is "Mapping and coverage with a particle swarm controlled by uniform inputs" (2017), and
paper D is a draft of paper M. Paper W treats two particles with non-slip wall contacts. Paper H
treats exhaustive search along a space-filling curve (1998).
"""

from __future__ import annotations

from shoal.papers.claims import Claim, Verdict
from shoal.papers.recipe import Outcome, Recipe, Result, Settings, Table
from shoal.papers.reproduce import recipes, reproduce, reproduce_all

__all__ = [
    "Claim",
    "Outcome",
    "Recipe",
    "Result",
    "Settings",
    "Table",
    "Verdict",
    "recipes",
    "reproduce",
    "reproduce_all",
]
