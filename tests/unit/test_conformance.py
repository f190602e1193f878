"""The checks of `shoal.testing`: Shoal's own objects pass, and each violation is found."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.core.errors import RigError
from shoal.missions import FORMATS as MISSION_FORMATS
from shoal.missions import MissionFormat
from shoal.rigs import NoisyRig, SimulatedRig
from shoal.search.allocation.allocate import ALLOCATORS, Arc
from shoal.steering import PLANNERS
from shoal.steering.planners import pressing
from shoal.swarm import GridWorkspace
from shoal.swarm.maps import files
from shoal.swarm.maps.files import FORMATS as MAP_FORMATS
from shoal.swarm.noise import Noise
from shoal.testing import (
    check_allocator,
    check_map_format,
    check_mission_format,
    check_planner,
    check_rig,
)

EXACT = [suffix for suffix in MAP_FORMATS if MAP_FORMATS[suffix].encode is not None]


@pytest.mark.parametrize("name", [name for name in PLANNERS if name != "sampling"])
def test_planners_pass(name, monkeypatch):
    monkeypatch.setattr(pressing, "CHANGES", 80)  # plans of conformant need not be good
    monkeypatch.setattr(pressing, "ROUNDS", 6_000)
    check_planner(name)


class Straight:
    """A planner for goals that one move reaches."""

    name = "straight"

    def plan(self, task):
        return (task.goal - task.start)[:1]


class Changed(Straight):
    def plan(self, task):
        task.goal[0] = task.start[0]
        return super().plan(task)


class Remembered(Straight):
    calls = 0

    def plan(self, task):
        self.calls += 1
        return super().plan(task)


class Drawn(Straight):
    def plan(self, task):
        return super().plan(task) + np.random.default_rng().normal(scale=1e-6, size=2)


class Flat(Straight):
    def plan(self, task):
        return super().plan(task)[0]


class Endless(Straight):
    def plan(self, task):
        return np.zeros((1000, 2))


class Infinite(Straight):
    def plan(self, task):
        return super().plan(task) * np.inf


class Silent(Straight):
    def plan(self, task):
        return None


class Short(Straight):
    def plan(self, task):
        return super().plan(task) / 2


def test_a_planner_of_third_parties_passes():
    check_planner(Straight())


@pytest.mark.parametrize(
    ("planner", "words"),
    [
        (Changed(), "changed the goal"),
        (Remembered(), "changed itself"),
        (Drawn(), "two plans"),
        (Flat(), "expected moves of shape"),
        (Endless(), "1000 moves of 40"),
        (Infinite(), "not finite"),
        (Silent(), "no plan for goals"),
        (Short(), "misses goals"),
    ],
)
def test_violations_of_planners_are_found(planner, words):
    with pytest.raises(AssertionError, match=words):
        check_planner(planner)


@pytest.mark.parametrize("name", list(ALLOCATORS))
def test_allocators_pass(name):
    check_allocator(name)


def one_for_all(tour_cost, team):
    return [[Arc(0, len(tour_cost))], *([] for _ in team.starts[1:])]


def moves_its_robots(tour_cost, team):
    team.rates[:] = 3.0
    return one_for_all(tour_cost, team)


def draws(tour_cost, team):
    return [
        [Arc(int(np.random.default_rng().integers(len(tour_cost))), len(tour_cost))],
        *one_for_all(tour_cost, team)[1:],
    ]


def test_an_allocator_of_third_parties_passes():
    check_allocator(one_for_all)


@pytest.mark.parametrize(
    ("allocator", "words"),
    [
        (moves_its_robots, "the team was changed"),
        (draws, "two allocations"),
        (lambda cost, team: one_for_all(cost, team)[:1], "arcs for 1 robots"),
        (lambda cost, team: [[Arc(0, len(cost))] for _ in team.starts], "several robots search"),
        (lambda cost, team: [[Arc(0, len(cost) - 1)], *[[]] * len(team.starts[1:])], "no robot"),
        (lambda cost, team: [[Arc(0, len(cost), 2)], *[[]] * len(team.starts[1:])], "the step 1"),
    ],
)
def test_violations_of_allocators_are_found(allocator, words):
    with pytest.raises(AssertionError, match=words):
        check_allocator(allocator)


@pytest.mark.parametrize("suffix", EXACT)
def test_map_formats_pass(suffix):
    check_map_format(suffix)


def test_a_format_that_is_only_read_needs_examples(tmp_path):
    with pytest.raises(AssertionError, match="expected examples"):
        check_map_format(".mat")
    with pytest.raises(AssertionError, match="expected a registered map format"):
        check_map_format(".unknown")


def read_bits(path, _options):
    rows, columns, *cells = path.read_bytes()
    return np.array(cells, dtype=bool).reshape(rows, columns), None


def encode_bits(workspace):
    return bytes([*workspace.shape, *workspace.free.ravel().tolist()])


@pytest.mark.parametrize(
    ("read", "encode", "words"),
    [
        (read_bits, encode_bits, "a damaged file raised ValueError"),
        (
            lambda path, options: (~read_bits(path, options)[0], None),
            encode_bits,
            "expected the written map|expected at least one free cell",
        ),
    ],
)
def test_violations_of_map_formats_are_found(monkeypatch, read, encode, words):
    monkeypatch.setitem(files.FORMATS, ".bits", files.MapFormat(read, encode))
    with pytest.raises((AssertionError, files.InvalidInputError), match=words):
        check_map_format(".bits")


@pytest.mark.parametrize("name", list(MISSION_FORMATS))
def test_mission_formats_pass(name):
    check_mission_format(name)


def changed(**more):
    """Return the format csv with another writer or reader."""
    csv = MISSION_FORMATS.get("csv")
    return MissionFormat(
        **{"suffix": ".csv", "write": csv.write, "scan": csv.scan, "metres": True} | more
    )


def raising(text, sheet):
    MISSION_FORMATS.get("csv").scan(text, sheet)
    if not len(sheet.points):
        raise KeyError("waypoints")


def moving(text, sheet):
    MISSION_FORMATS.get("csv").scan(text, sheet)
    sheet.points = sheet.points + 0.1


def losing(text, sheet):
    MISSION_FORMATS.get("csv").scan(text, sheet)
    sheet.points = sheet.points[:1]


def emptied(name):
    """Return a reader that leaves out one field."""

    def scan(text, sheet):
        MISSION_FORMATS.get("csv").scan(text, sheet)
        setattr(sheet, name, None if name == "kind" else [])

    return scan


@pytest.mark.parametrize(
    ("form", "words"),
    [
        (changed(scan=raising), "a damaged file raised KeyError"),
        (changed(scan=moving), "a waypoint moved"),
        (changed(scan=losing), "waypoints became 1"),
        (changed(scan=emptied("kind")), "a rover became a vehicle without a kind"),
        (changed(scan=emptied("places")), "1 waypoints have 0 places"),
        (changed(scan=emptied("altitudes")), "1 waypoints have 0 altitudes"),
        (changed(scan=lambda text, sheet: None), "its own file cannot be read"),
        (changed(write=lambda mission: b"bytes"), "expected a text"),
        (changed(write=lambda mission: str(np.random.default_rng().random())), "gave two files"),
    ],
)
def test_violations_of_mission_formats_are_found(form, words):
    with pytest.raises(AssertionError, match=words):
        check_mission_format(form)


WORKSPACE = GridWorkspace([[1, 1, 1, 0], [1, 0, 1, 1], [1, 1, 1, 1]])
START = [(0, 0), (2, 3), (2, 0)]


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
def test_rigs_pass(rule):
    check_rig(SimulatedRig(WORKSPACE, START, rule=rule))


def test_a_noisy_rig_passes():
    noise = Noise(slip=0.1, miss=0.2, misplace=0.1)
    check_rig(NoisyRig(WORKSPACE, START, noise, np.random.default_rng(1)), exact=False)


class Unstoppable(SimulatedRig):
    def stop(self):
        """Go on."""


class Surprised(SimulatedRig):
    def send(self, command):
        if self._stopped:
            raise ValueError("magnets")
        super().send(command)


class Drifting(SimulatedRig):
    def observe(self):
        if not self._stopped:
            self._move("r")
        return super().observe()


class Losing(SimulatedRig):
    def _move(self, command):
        super()._move(command)
        self._state = self._world.initial(
            self._state.cells[1:] if self._state.n_particles > 1 else self._state.cells
        )


class Leaping(SimulatedRig):
    def _move(self, command):
        for _ in range(3):
            super()._move(command)


class Outside(SimulatedRig):
    def observe(self):
        return super().observe() + 3


class Fractions(SimulatedRig):
    def observe(self):
        return super().observe() + 0.5


class Flattened(SimulatedRig):
    def observe(self):
        return super().observe().ravel()


class Misruled(SimulatedRig):
    rule = "slide"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (Unstoppable, "after stop.*got none"),
        (Surprised, "after stop.*got ValueError"),
        (Drifting, "without a command"),
        (Losing, "3 particles became 2"),
        (Leaping, "travelled"),
        (Outside, "outside the shape"),
        (Fractions, "whole numbers"),
        (Flattened, "cells of shape"),
        (Misruled, "expected a rule"),
    ],
)
def test_violations_of_rigs_are_found(kind, words):
    rig = kind.__new__(kind)
    if kind is Misruled:
        rig._world, rig._state, rig._stopped = _parts()
    else:
        kind.__init__(rig, WORKSPACE, START)
    with pytest.raises(AssertionError, match=words):
        check_rig(rig)


def _parts():
    rig = SimulatedRig(WORKSPACE, START)
    return rig._world, rig._state, False


def test_a_stopped_rig_refuses_commands():
    rig = SimulatedRig(WORKSPACE, START)
    rig.stop()
    with pytest.raises(RigError):
        rig.send("l")
