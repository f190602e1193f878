"""Episode: everything needed to replay what a swarm did, and its metrics."""

from __future__ import annotations

import base64
import html
import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.commands import decode
from shoal.swarm.grid.scans import EVERY_MOVE, ScanRule
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.tasks import make_task
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.raster import png_bytes
from shoal.swarm.maps.workspace import GridWorkspace

STATUSES = {
    "complete": "nothing is left to do",
    "stalled": "the policy could make no progress",
    "limit": "stopped at the limit of moves",
}


@dataclass(frozen=True)
class Verification:
    """The answer of `Episode.verify`; true if the episode holds.

    Parameters
    ----------
    ok : bool
    message : str
        What was checked, or the first difference.
    """

    ok: bool
    message: str

    def __bool__(self) -> bool:
        return self.ok


@dataclass(frozen=True, eq=False)
class Episode:
    """One run of a policy on a task.

    Parameters
    ----------
    workspace : GridWorkspace
    start : ndarray of int64, shape (n, ndim)
        Cells of the particles at the start.
    codes : ndarray of int8, shape (moves,)
        The commands; `commands` gives them as letters.
    rule, task, policy, placement : str
    targets : ndarray of bool, the shape of the workspace, or None
        The cells to cover; None for a mapping.
    seed, trial : int
        Randomness was ``default_rng(SeedSequence(seed, spawn_key=(trial,)))``.
    status : str
        "complete", "stalled" or "limit".
    first_frontier : int
        Frontier cells at the start.
    done : ndarray of int32, shape (moves,)
        Cells classified (coverage: covered) by each move.
    frontier : ndarray of int32, shape (moves,)
        Frontier cells after each move.
    travelled : ndarray of int64, shape (moves,)
        Cells travelled in each move, summed over the particles.
    seconds : float
        Time the run took, planning included.
    version : str
        Of Shoal.
    scanning : ScanRule
        When to scan, and the prices of scans and moves.
    scanned : ndarray of bool, shape (moves,)
        Whether a scan followed each move; by default after each. There was one more before the first.

    Notes
    -----
    True as a bool if the task was completed.
    """

    part: ClassVar[str] = "swarm"

    workspace: GridWorkspace
    start: NDArray[np.int64]
    codes: NDArray[np.int8]
    rule: str
    task: str
    policy: str
    placement: str
    targets: NDArray[np.bool_] | None
    seed: int
    trial: int
    status: str
    first_frontier: int
    done: NDArray[np.int32]
    frontier: NDArray[np.int32]
    travelled: NDArray[np.int64]
    seconds: float
    version: str
    scanning: ScanRule = EVERY_MOVE
    scanned: NDArray[np.bool_] = None  # type: ignore[assignment]  # filled in below

    def __post_init__(self) -> None:
        if self.scanned is None:
            object.__setattr__(self, "scanned", np.ones(len(self.codes), dtype=np.bool_))

    def __bool__(self) -> bool:
        return self.status == "complete"

    @cached_property
    def commands(self) -> str:
        """The commands as letters."""
        return decode(self.codes)

    @property
    def moves(self) -> int:
        """Number of commands sent."""
        return len(self.codes)

    @property
    def scans(self) -> int:
        """Number of scans, the one at the start included."""
        return 1 + int(np.count_nonzero(self.scanned))

    @property
    def cost(self) -> float:
        """Price of all moves and scans."""
        return self.scanning.cost(moves=self.moves, scans=self.scans)

    @property
    def n_particles(self) -> int:
        """Number of particles."""
        return len(self.start)

    @property
    def classified(self) -> NDArray[np.int64]:
        """Cells classified (coverage: covered) up to and with each move; int64, shape (moves,)."""
        return np.cumsum(self.done, dtype=np.int64)

    @property
    def distance(self) -> int:
        """Cells travelled, summed over the particles."""
        return int(self.travelled.sum())

    @property
    def seconds_per_move(self) -> float:
        """Mean time of a move, planning included; 0 if there was none."""
        return self.seconds / self.moves if self.moves else 0.0

    @property
    def sentence(self) -> str:
        """The status for people."""
        left = int(self.frontier[-1]) if self.moves else self.first_frontier
        rest = "" if self else f"; {left} frontier cells left"
        return f"{self.status} after {self.moves} moves: {STATUSES[self.status]}{rest}"

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield state and belief at the start and after each move, replayed step by step.

        The belief is that of the last scan, or the newest if all that has happened since was known beforehand.
        """
        world, task = GridWorld(self.workspace, self.rule), make_task(self.task)
        state = world.initial(self.start)
        belief = shown = task.begin(world, state, self.targets)
        yield state, shown
        for command, scanned in zip(self.commands, self.scanned.tolist(), strict=True):
            for after in world.pushes(state, command):
                belief = task.update(belief, command, state.occupied, after.occupied)
                state = after
            if scanned or belief.known == shown.known:
                shown = belief
            yield state, shown

    def final(self) -> tuple[SwarmState, Belief]:
        """Return state and belief after the last move."""
        from shoal.swarm.running import replay

        state, belief, _ = replay(self)
        return state, belief

    def verify(self) -> Verification:
        """Replay the commands; compare all metrics, and whether the task is complete at the end."""
        from shoal.swarm.running import replay

        state, belief, again = replay(self)
        for name in ("first_frontier", "done", "frontier", "travelled", "scanned"):
            mine, theirs = np.atleast_1d(getattr(self, name)), np.atleast_1d(getattr(again, name))
            if mine.shape != theirs.shape:
                return Verification(False, f"{name}: {len(mine)} entries stored, {len(theirs)} replayed")
            if (mine != theirs).any():
                move = int(np.argmax(mine != theirs))
                return Verification(False, f"{name} differs at move {move + 1}: {mine[move]} stored, {theirs[move]} replayed")
        wrong = self._wrong_scan()
        if wrong is not None:
            return Verification(False, wrong)
        if state.n_particles != self.n_particles:
            return Verification(False, f"{self.n_particles} particles at the start, {state.n_particles} at the end")
        if belief.complete != bool(self):
            return Verification(False, f"status {self.status!r} stored, {len(belief.frontier)} frontier cells left")
        return Verification(True, f"{self.moves} moves of {self.n_particles} particles replayed: all the same")

    def _wrong_scan(self) -> str | None:
        """Return what is wrong with the scans, None if they fit the rule: no decision may fall between a run and its scan."""
        if not self.moves:
            return None
        rule, scanned = self.scanning, self.scanned
        if rule.every_move and not scanned.all():
            return f"no scan after move {int(np.argmin(scanned)) + 1}, although there should be one after every move"
        unseen = 0  # moves since the last scan that are still to be looked at
        for move, (code, scan) in enumerate(zip(self.codes.tolist(), scanned.tolist(), strict=True), start=1):
            if unseen and code != self.codes[move - 2]:
                return f"no scan after move {move - 1}, where the direction changes"
            if rule.kind != "adaptive" or unseen or (self.targets is None and self.done[move - 1] > 0):
                unseen += 1
            if rule.kind == "equal" and unseen > rule.step:
                return f"no scan after move {move - 1}, {rule.step} moves after the one before"
            unseen = 0 if scan else unseen
        return f"no scan after the last move, {self.moves}" if unseen else None

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode to an ``.npz`` file, whole or not at all.

        Raises
        ------
        InvalidInputError
            If the suffix is another.
        OutputError
            If the file cannot be written.
        """
        from shoal.swarm.episode_file import save

        save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Episode:
        """Read an episode that `save` wrote.

        Raises
        ------
        InvalidInputError
            If the file is missing, damaged, or of another format.
        """
        from shoal.swarm.episode_file import load

        return load(path)

    def __repr__(self) -> str:
        return (
            f"<Episode {self.task} of {self.workspace.name!r} by {self.policy}: {self.n_particles} particles, "
            f"{self.moves} moves, {self.status}>"
        )

    def _repr_html_(self) -> str:
        state, belief = self.final()
        picture = base64.b64encode(png_bytes(belief.picture(state.occupied), side=480)).decode()
        name, policy = html.escape(self.workspace.name), html.escape(self.policy)
        return (
            f'<figure style="margin:0"><img alt="final map of {name}" src="data:image/png;base64,{picture}" '
            'style="image-rendering:pixelated;max-width:100%"/>'
            f"<figcaption><b>{name}</b>: {self.task} by {policy}, {self.n_particles} particles, rule {self.rule}; "
            f"{html.escape(self.sentence)}</figcaption></figure>"
        )
