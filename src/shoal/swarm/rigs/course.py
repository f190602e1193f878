"""The course of a drive: what was sent, what it brought, and the episode that comes of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.swarm.episode import Episode
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.model import Noise
from shoal.swarm.noise.seen import SeenEpisode
from shoal.swarm.rigs.tracking import ExactTracker, NoisyTracker
from shoal.version import __version__

if TYPE_CHECKING:
    from shoal.swarm.rigs.protocol import Rig


@dataclass
class Course:
    """What was sent, and what it brought."""

    codes: list[int] = field(default_factory=list)
    rows: list[tuple[int, int, int]] = field(default_factory=list)  # (done, frontier, travelled) of each command
    scanned: list[bool] = field(default_factory=list)
    idle: int = 0
    last: tuple[int, int] = (0, 0)  # (travelled, done) of the last run

    def add(self, code: int, rows: list[tuple[int, int, int]], *, scanned: bool) -> None:
        """Take in a run of equal commands."""
        self.codes += [code] * len(rows)
        self.rows += rows
        self.scanned += [False] * (len(rows) - 1) + [scanned]
        self.last = sum(row[2] for row in rows), sum(row[0] for row in rows)
        self.idle = 0 if any(self.last) else self.idle + 1

    def episode(
        self,
        rig: Rig,
        tracker: ExactTracker | NoisyTracker,
        *,
        policy: str,
        seed: int,
        scanning: ScanRule,
        status: str,
        seconds: float,
        noise: Noise | None,
        confidence: float,
    ) -> Episode | None:
        """Return the run as an episode in the map that was found; None if no free cell was.

        Without noise every particle moves there as it did. With noise it is what was seen.
        """
        free = tracker.belief.open.inner
        if not free.any():
            return None
        columns: Any = np.array(self.rows, dtype=np.int64).reshape(-1, 3)
        about: dict[str, Any] = {"policy": policy, "seed": seed, "scanning": scanning, "status": status, "seconds": seconds}
        about |= {
            "workspace": GridWorkspace(free, name=rig.name),
            "start": tracker.start,
            "first_frontier": tracker.first_frontier,
            "codes": np.array(self.codes, dtype=np.int8),
            "done": columns[:, 0].astype(np.int32),
            "frontier": columns[:, 1].astype(np.int32),
            "travelled": columns[:, 2].copy(),
            "scanned": np.array(self.scanned, dtype=np.bool_),
        }
        about |= {"rule": rig.rule, "task": "mapping", "placement": "given", "targets": None, "trial": 0, "version": __version__}
        if isinstance(tracker, ExactTracker):
            return Episode(**about)
        return SeenEpisode(**about, noise=noise or Noise(), confidence=confidence, sights=tuple(tracker.sights))
