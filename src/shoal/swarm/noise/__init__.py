"""Noise: particles that slip, are seen beside their cell, or are not seen; and maps of a stated confidence from them."""

from __future__ import annotations

from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.episode import MapErrors, NoisyEpisode
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.moments import Moment
from shoal.swarm.noise.plant import NoisyRig
from shoal.swarm.noise.seen import SeenEpisode

__all__ = ["CONFIDENCE", "MapErrors", "Moment", "Noise", "NoisyBelief", "NoisyEpisode", "NoisyRig", "SeenEpisode"]
