"""Noise (particles that slip or are observed wrongly), and maps with a stated confidence from noisy scans."""

from __future__ import annotations

from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.map_errors import MapErrors
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.moments import Moment
from shoal.swarm.noise.simulated import NoisyRig

__all__ = ["CONFIDENCE", "MapErrors", "Moment", "Noise", "NoisyBelief", "NoisyRig"]
