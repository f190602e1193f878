"""Alarms of a drive in plain words, and how far its map can be trusted.

Shoal infers walls from particles that do not move. A magnet that does nothing, a camera that shows
an old picture, or an axis that is inverted therefore gives a map, and a wrong one. A drive compares
what the rig shows with what the commands must have done.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from shoal.core.checks import count_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, letters_of
from shoal.swarm.grid.scans import states_of_run
from shoal.swarm.grid.state import SwarmState

NOISY = "if particles slip or are observed wrongly, give the probabilities slip, misplace and miss"
Level = Literal["high", "limited", "none"]
KINDS = {
    "still": "nothing moved although it should",
    "direction": "the particles move in other directions than the commands",
    "number": "the number of particles changed",
    "outside": "a position lies outside the field of view",
    "twice": "a command was carried out or answered twice",
    "commands": "some commands were not carried out, or late, or in another direction",
    "drift": "the particles move without a command",
    "rule": "a position does not follow from the command and the known free cells",
    "map": "the known map is wrong",
    "rates": "the observed rates of errors are far from the stated rates",
    "stop": "the rig has not confirmed the stop command",
    "failure": "the rig does not answer, or reports an error",
}
"""The kinds of alarms, and what each kind means."""


@dataclass(frozen=True)
class Alarm:
    """Something that a rig did although it should not, or did not do although it should.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    move : int
        Number of commands sent before the alarm.
    text : str
        What was expected, what came, and the likely causes, for people.
    """

    kind: str
    move: int
    text: str


class AlarmRaised(Exception):  # noqa: N818 - no error of the program
    """Ends a drive whose rig contradicts the commands. The function `drive` turns the exception
    into the status ``alarm``.
    """

    def __init__(self, alarm: Alarm) -> None:
        super().__init__(alarm.text)
        self.alarm = alarm


@dataclass(frozen=True)
class Trust:
    """How far the map of a drive can be trusted.

    Parameters
    ----------
    level : str
        "high": every check was made and passed. "limited": an alarm was raised, or a check could
        not be made. "none": the map says nothing about the apparatus.
    why : str
        The reason for the level, in one sentence.
    """

    level: Level
    why: str


def trust_of(alarms: list[Alarm], *, moved: bool, doubts: list[str]) -> Trust:
    """Return how far a map can be trusted.

    Parameters
    ----------
    alarms : list of Alarm
    moved : bool
        Whether particles moved at all.
    doubts : list of str
        Other reasons to doubt the map, such as walls that rest on commands without any motion.
    """
    if not moved:
        return Trust(
            "none", "no particle was seen to move, so that the map says nothing about the walls"
        )
    fatal = [alarm for alarm in alarms if alarm.kind == "direction"]
    if fatal:
        return Trust("none", f"every wall was inferred from a wrong direction: {fatal[0].text}")
    reasons = [alarm.text for alarm in alarms] + doubts
    if reasons:
        return Trust("limited", "; ".join(reasons))
    return Trust(
        "high",
        "the particles moved as the commands and the known free cells require, and no alarm was"
        " raised",
    )


def alarms_as_json(alarms: tuple[Alarm, ...]) -> list[dict[str, Any]]:
    """Return alarms as JSON objects."""
    return [dict(vars(alarm)) for alarm in alarms]


def explain_contradiction(
    before: SwarmState,
    after: SwarmState,
    command: str,
    steps: int,
    *,
    free: Board,
    move: int,
    otherwise: str,
) -> Alarm:
    """Return the alarm for positions that a command cannot explain, with the most likely cause.

    Parameters
    ----------
    before, after : SwarmState
        What the scans before and after the command show.
    command : str
    steps : int
        Number of cells that the command (or the run of equal commands) may move a particle.
    free : Board
        The cells known to be free.
    move : int
        Number of commands sent.
    otherwise : str
        The text of the alarm if no cause is likelier than a slip or a wrong observation.
    """
    where = f"move {move}, command {command!r}"
    if before.n_particles != after.n_particles:
        text = (
            f"{before.n_particles} particles before, {after.n_particles} now: a particle was lost,"
            " was not seen or came in"
        )
        return Alarm("number", move, f"{where}: {text}; {NOISY}")
    if before == after:
        text = (
            "nothing moved although a particle has a free cell ahead: the magnets do nothing, or"
            " the camera shows an old picture"
        )
        return Alarm("still", move, f"{where}: {text}")
    for letter in letters_of(before.occupied.layout.ndim):
        # a single particle that drifts leaves others behind that have room in its direction
        behind = (before.occupied & after.occupied).shifted(letter) & free
        if (
            letter != command
            and explains(before, after, letter, steps)
            and behind <= after.occupied
        ):
            text = (
                f"the particles moved as command {letter!r} moves them: the picture or the magnets"
                " are turned or mirrored"
            )
            return Alarm("direction", move, f"{where}: {text}, or the particles drift")
    if explains(before, after, command, 2 * steps) and not explains(before, after, command, steps):
        text = (
            f"a particle moved by more than {count_text(steps, 'cell')}: the command was carried"
            " out twice, or particles drift"
        )
        return Alarm("twice", move, f"{where}: {text}")
    sideways = len(after.occupied - before.occupied) > 0 and not explains(
        before, after, command, max(before.occupied.layout.shape)
    )
    if sideways:
        text = (
            "a particle moved against the command or to the side: the particles drift, or were"
            " observed wrongly"
        )
        return Alarm("drift", move, f"{where}: {text} ({otherwise}); {NOISY}")
    return Alarm("rule", move, f"{where}: {otherwise}; {NOISY}")


def explains(before: SwarmState, after: SwarmState, command: str, steps: int) -> bool:
    """Return whether ``steps`` equal commands may lead from one state to the other, in some map."""
    try:
        states: Iterator[SwarmState] = states_of_run(before, after, command, steps)
        return any(True for _ in states)
    except InvalidInputError:
        return False
