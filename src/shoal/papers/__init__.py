"""Reproduction of the papers' figures and theorems.

A recipe describes each figure and theorem: its sweeps, its drawing, and claims that compare the paper with Shoal's results.

Papers: M, Mapping and coverage with a particle swarm controlled by uniform inputs (2017); D, the draft of M; W, two particles with
non-slip wall contacts; H, exhaustive search along a space-filling curve (1998).
"""

from __future__ import annotations

from shoal.papers.claims import Claim, Verdict
from shoal.papers.recipe import Outcome, Recipe, Result, Settings, Table
from shoal.papers.reproduce import recipes, reproduce, reproduce_all

__all__ = ["Claim", "Outcome", "Recipe", "Result", "Settings", "Table", "Verdict", "recipes", "reproduce", "reproduce_all"]
