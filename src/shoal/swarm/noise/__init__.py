"""Noise: particles slip, and scans show wrong positions. The user chooses the confidence with which a cell must be classified."""

from __future__ import annotations

from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.map_errors import MapErrors
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.moments import Moment

__all__ = ["CONFIDENCE", "MapErrors", "Moment", "Noise", "NoisyBelief"]
