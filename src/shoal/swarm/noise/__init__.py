"""Noise: particles slip, or are observed wrongly. Maps from noisy scans have a stated confidence."""

from __future__ import annotations

from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.map_errors import MapErrors
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.moments import Moment

__all__ = ["CONFIDENCE", "MapErrors", "Moment", "Noise", "NoisyBelief"]
