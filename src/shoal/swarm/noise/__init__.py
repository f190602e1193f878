"""Noise: particles slip, and scans show wrong positions. The user chooses the confidence with which
a cell must be classified.
"""

from __future__ import annotations

from shoal.swarm.noise.belief import Moment, NoisyBelief
from shoal.swarm.noise.model import CONFIDENCE, MapErrors, Noise

__all__ = ["CONFIDENCE", "MapErrors", "Moment", "Noise", "NoisyBelief"]
