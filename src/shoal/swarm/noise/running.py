"""Episodes with noise: closest-frontier runs whole in compiled code, all other policies step by step."""

from __future__ import annotations

import time
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.errors import InvalidInputError
from shoal.swarm.episode import Episode
from shoal.swarm.grid.board import GridLayout
from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.tasks import Mapping
from shoal.swarm.kernels import noise, noisy_play
from shoal.swarm.noise.asking import AskedRuns
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.episode import NoisyEpisode, new_log, noise_rng
from shoal.swarm.noise.model import Noise, bound_of
from shoal.swarm.noise.plant import seen_board, truth_of
from shoal.swarm.policies import Policy, View
from shoal.swarm.stepwise import OnMoves

PIECE = 256  # moves between two moments at which progress is shown and Ctrl-C takes effect


def check_noisy(noise_: Noise, confidence: float, *, rule: str, task: Any, scanning: ScanRule) -> None:
    """Refuse what is not modelled with noise.

    Raises
    ------
    InvalidInputError
    """
    bound_of(confidence)
    if not isinstance(noise_, Noise):
        raise InvalidInputError(f"noise: expected a Noise, got {noise_!r}")
    if rule != "block":
        raise InvalidInputError(f"noise: expected rule block, got {rule}")
    if not isinstance(task, Mapping):
        raise InvalidInputError(f"noise: expected the task mapping, got {getattr(task, 'name', task)}")
    if scanning.kind != "equal":
        raise InvalidInputError(
            f"noise: expected scan-every as a number of commands, as no outcome is certain beforehand, got {scanning.every}"
        )


def play_noisy(
    blank: Episode,
    policy: Policy,
    noise_: Noise,
    confidence: float,
    rng: Generator,
    max_moves: int,
    *,
    stepwise: bool = False,
    on_moves: OnMoves | None = None,
) -> NoisyEpisode:
    """Play one episode with noise; ``blank`` says on what, ``rng`` is the policy's own."""
    layout, luck = GridLayout(blank.workspace.shape), noise_rng(blank.seed, blank.trial)
    haze = truth_of(blank.workspace, blank.start, noise_, confidence)
    noise.look(haze, luck)
    belief = NoisyBelief(layout.shape, seen_board(haze, layout), noise_, confidence, haze=haze)
    first = belief.remaining
    began = time.perf_counter()
    compiled = getattr(policy, "kind", "") == "closest-frontier" and not stepwise
    player = _compiled if compiled else _stepwise
    log, status = player(belief, policy, luck, rng, blank.scanning.step, max_moves, on_moves)
    values = {field.name: getattr(blank, field.name) for field in fields(Episode)}
    values |= {"codes": log.commands, "done": log.done, "frontier": log.frontier, "travelled": log.travelled}
    values |= {"scanned": log.scanned, "status": status, "first_frontier": first, "seconds": time.perf_counter() - began}
    return NoisyEpisode(**values, noise=noise_, confidence=confidence)


def _compiled(
    belief: NoisyBelief, policy: Any, luck: Generator, _rng: Generator, every: int, max_moves: int, on_moves: OnMoves | None
) -> tuple[noisy_play.Log, str]:
    from shoal.swarm.engine import search_of

    size = int(np.prod(belief.layout.window))
    search = search_of(belief.layout, ties=policy.ties, neighbours=policy.neighbours, plan_size=size)
    pieces, moves, ended = [], 0, noisy_play.RUNNING
    while moves < max_moves and ended == noisy_play.RUNNING:
        piece = new_log(min(PIECE, max_moves - moves))
        played, ended = belief.play(search, luck, piece, every=every, limit=max_moves - moves)
        kept: list[Any] = [column[:played] for column in piece]
        pieces.append(noisy_play.Log(*kept))
        moves += played
        if on_moves is not None:
            on_moves(moves, belief.remaining)
    status = {noisy_play.COMPLETE: "complete", noisy_play.STALLED: "stalled"}.get(ended, "limit")
    if ended == noisy_play.RUNNING and belief.finished:
        status = "complete"
    return _joined(pieces), status


def _joined(pieces: list[noisy_play.Log]) -> noisy_play.Log:
    if not pieces:
        return new_log(0)
    columns: list[Any] = [np.concatenate(column) for column in zip(*pieces, strict=True)]
    return noisy_play.Log(*columns)


def _stepwise(
    belief: NoisyBelief, policy: Policy, luck: Generator, rng: Generator, every: int, max_moves: int, on_moves: OnMoves | None
) -> tuple[noisy_play.Log, str]:
    runs, last = AskedRuns(policy, rng, every), (0, 0)
    rows: list[tuple[int, int, int, int, bool]] = []
    status = "limit"
    while True:
        if belief.remaining == 0 and belief.finished:
            status = "complete"
            break
        if len(rows) >= max_moves:
            break
        view = View(belief.belief, belief.occupied, "block", True, len(rows), *last)
        run = runs.next(view, SwarmState(belief.occupied), 0)
        if run is None:
            status = "complete" if belief.finished else "stalled"
            break
        code = encode(run[0], ndim=belief.layout.ndim)[0]
        travelled = int(noise.move_hazy(belief.haze, code, luck))
        scan, done = runs.due or len(rows) + 1 == max_moves, 0
        if scan:
            noise.look(belief.haze, luck)
            done = belief.learn(code)
        else:
            belief.foretell(code)
        last = travelled, done
        rows.append((code, done, belief.remaining, travelled, scan))
        if on_moves is not None:
            on_moves(len(rows), belief.remaining)
    log, table = new_log(len(rows)), np.array(rows, dtype=np.int64).reshape(-1, len(noisy_play.Log._fields))
    columns: list[Any] = list(log)
    for number, column in enumerate(columns):
        column[:] = table[:, number]
    return log, status
