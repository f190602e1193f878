"""Rigs that lie: what a drive must notice, and what an honest rig must not be accused of."""

from __future__ import annotations

import numpy as np
import pytest

from shoal import GridWorkspace, open_map
from shoal.swarm.grid.placements import place
from shoal.swarm.noise.model import Noise
from shoal.swarm.rigs import NoisyRig, SimulatedRig, drive

OPPOSITE = dict(zip("lurdio", "rdluoi", strict=True))
NOISE = Noise(0.05, 0.01, 0.02)
STATED = {"slip": 0.05, "misplace": 0.01, "miss": 0.02}


class Lying:
    """Wraps a rig. From command number ``since`` on, ``command`` changes what is sent, and ``seen`` what a scan shows."""

    def __init__(self, rig, *, since=0, command=lambda letter: letter, seen=lambda cells, moves: cells):
        self.rig, self.since, self.command, self.seen = rig, since, command, seen
        self.name, self.shape, self.rule = "liar", rig.shape, rig.rule
        self.sent, self.stops = [], 0

    def send(self, letter):
        self.sent.append(letter)
        for one in self.command(letter) if len(self.sent) > self.since else letter:
            self.rig.send(one)

    def observe(self):
        cells = self.rig.observe()
        return self.seen(cells, len(self.sent)) if len(self.sent) >= self.since else cells

    def stop(self):
        self.stops += 1


def exact(workspace, particles=4, seed=1):
    return SimulatedRig(workspace, place(workspace, particles, "uniform", np.random.default_rng(seed)))


def noisy(workspace, particles=12, seed=1, noise=NOISE):
    start = place(workspace, particles, "uniform", np.random.default_rng(seed))
    return NoisyRig(workspace, start, noise, np.random.default_rng(seed))


def frozen():
    kept = []
    return lambda cells, moves: (kept.append(cells), kept[0])[1]


MAZE = open_map("maze:15x11:1")

# ------------------------------------------------------------------------------------------------- dead from the start


@pytest.mark.parametrize("test_move", [True, False])
@pytest.mark.parametrize("policy", ["closest-frontier", "best", "random-moves", "sweep", "manual:lurdlurd"])
@pytest.mark.parametrize("lie", [{"command": lambda _letter: ""}, {"seen": None}], ids=["dead magnet", "frozen frame"])
def test_a_map_drawn_from_particles_that_never_moved_is_never_complete(policy, test_move, lie):
    lie = {name: what or frozen() for name, what in lie.items()}
    rig = Lying(exact(MAZE), **lie)
    driven = drive(rig, policy=policy, test_move=test_move, max_moves=60)
    assert driven.status in ({"alarm"} if "manual" not in policy and test_move else {"alarm", "limit", "stalled"})
    assert not driven
    assert driven.trust.level == "none"
    assert rig.stops == 1
    if driven.status == "alarm":
        assert [alarm.kind for alarm in driven.alarms] == ["still"]
        assert "no particle moved" in driven.reason
    if test_move and "manual" not in policy:
        assert driven.commands == "lurd"  # no more than one command in each direction


@pytest.mark.parametrize("rule", ["merge", "tilt"])
def test_a_dead_magnet_is_noticed_under_every_rule(rule):
    rig = Lying(SimulatedRig(MAZE, MAZE.cells[:3], rule=rule), command=lambda _letter: "")
    assert drive(rig, policy="closest-frontier").status == "alarm"


def test_a_dead_magnet_in_three_dimensions():
    workspace = GridWorkspace(np.ones((2, 3, 3)))
    driven = drive(Lying(SimulatedRig(workspace, [(0, 0, 0)]), command=lambda _letter: ""))
    assert (driven.status, driven.moves) == ("alarm", 6)


@pytest.mark.parametrize("particles", [1, 12, 60])
def test_a_dead_magnet_under_noise_is_noticed(particles):
    for seed in range(3):
        driven = drive(Lying(noisy(MAZE, particles, seed), command=lambda _letter: ""), **STATED, policy="closest-frontier")
        assert driven.status == "alarm", (seed, driven.reason)
        assert driven.trust.level == "none"
        driven = drive(
            Lying(noisy(MAZE, particles, seed), command=lambda _letter: ""), **STATED, policy="closest-frontier", test_move=False,
            max_moves=1500,
        )  # fmt: skip
        assert driven.status in {"alarm", "stalled", "limit"}, (seed, driven.reason)
        assert not driven
        assert driven.trust.level == "none"


def test_a_vessel_without_any_room_cannot_be_told_from_a_dead_magnet():
    for test_move in (True, False):
        driven = drive(SimulatedRig(GridWorkspace([[1, 1], [1, 0]]), [(0, 0), (0, 1), (1, 0)]), test_move=test_move)
        assert driven.status == "alarm"
        assert "no particle has room to move" in driven.reason


# ------------------------------------------------------------------------------------------------- failures on the way


@pytest.mark.parametrize("policy", ["closest-frontier", "best", "greedy-classify"])
@pytest.mark.parametrize("particles", [1, 4])
def test_a_magnet_that_dies_on_the_way_never_completes_a_map(policy, particles):
    """Wherever it dies: each death is either noticed, or comes after the last cell was found."""
    maze = open_map("maze:9x7")
    honest = drive(exact(maze, particles), policy=policy)
    assert honest.status == "complete"
    for since in range(1, honest.moves, 5):
        rig = Lying(exact(maze, particles), since=since, command=lambda _letter: "")
        driven = drive(rig, policy=policy)
        assert driven.status == "alarm", since
        assert driven.alarms[-1].kind == "still"
        assert driven.trust.level == ("limited" if driven.trace.travelled.any() else "none")
        assert driven.moves >= since
        assert driven.episode.verify(), since


def test_a_magnet_that_dies_before_the_last_walls_is_noticed_by_the_closing_move():
    """After 'r' in a corridor of two cells, only walls are left to find, which a dead magnet 'finds' as well."""
    workspace = GridWorkspace([[1, 1]])
    honest = drive(SimulatedRig(workspace, [(0, 0)]), policy="closest-frontier")
    last = int(np.flatnonzero(honest.trace.travelled[:-1])[-1]) + 1  # the closing move left out
    assert (honest.status, honest.trust.level) == ("complete", "high")
    for test_move, status in ((True, "alarm"), (False, "complete")):
        rig = Lying(SimulatedRig(workspace, [(0, 0)]), since=last, command=lambda _letter: "")
        driven = drive(rig, policy="closest-frontier", test_move=test_move)
        assert (driven.status, driven.trust.level) == (status, "limited")
    assert "at which nothing was seen to move" in driven.trust.why


def test_a_magnet_that_dies_under_noise_is_noticed():
    noticed = 0
    for seed in range(6):
        rig = Lying(noisy(MAZE, 12, seed), since=30, command=lambda _letter: "")
        driven = drive(rig, **STATED, policy="closest-frontier")
        noticed += driven.status == "alarm"
        assert driven.status != "complete" or driven.alarms, (seed, driven.reason)
    assert noticed >= 5


def test_a_frozen_frame_on_the_way_is_noticed():
    driven = drive(Lying(exact(MAZE), since=20, seen=frozen()), policy="closest-frontier")
    assert (driven.status, driven.alarms[-1].kind) == ("alarm", "still")


# ------------------------------------------------------------------------------------- wrong directions, drift, doubling


TURN = dict(zip("lurd", "uldr", strict=True))


@pytest.mark.parametrize(
    "lie",
    [
        {"command": OPPOSITE.get},
        {"command": lambda letter: OPPOSITE[letter] if letter in "lr" else letter},
        {"command": lambda letter: OPPOSITE[letter] if letter in "ud" else letter},
        {"command": TURN.get},
        {"seen": lambda cells, _moves: np.array([MAZE.shape[0] - 1, 0]) + cells * [-1, 1]},
        {"seen": lambda cells, _moves: np.array([0, MAZE.shape[1] - 1]) + cells * [1, -1]},
    ],
    ids=["both axes", "columns", "rows", "quarter turn", "picture upside down", "picture mirrored"],
)
@pytest.mark.parametrize("noise", [False, True])
def test_directions_that_are_not_the_commands_are_noticed(lie, noise):
    for seed in range(3):
        rig = Lying(noisy(MAZE, 12, seed) if noise else exact(MAZE, 6, seed), **lie)
        driven = drive(rig, policy="closest-frontier", **(STATED if noise else {}))
        assert driven.status == "alarm"
        assert driven.alarms[-1].kind == "direction", driven.alarms[-1].text
        assert driven.trust.level == "none"


def test_a_drift_is_noticed():
    drifting = {"command": lambda letter: letter + "d"}
    for seed in range(3):
        driven = drive(Lying(exact(MAZE, 6, seed), **drifting), policy="closest-frontier")
        assert driven.status == "alarm"
        rig = noisy(open_map("cave:24x18:3"), 15, seed)
        rng = np.random.default_rng(seed)
        slowly = {"command": lambda letter, rng=rng: letter + "d" * int(rng.random() < 0.4)}
        driven = drive(Lying(rig, **slowly), policy="closest-frontier", **STATED, max_moves=1500)
        assert driven.alarms, driven.reason
        assert driven.trust.level != "high"


def test_a_command_that_is_carried_out_twice_is_noticed():
    driven = drive(Lying(exact(MAZE), since=9, command=lambda letter: 2 * letter), policy="closest-frontier")
    assert (driven.status, driven.alarms[-1].kind) == ("alarm", "twice")


# --------------------------------------------------------------------------------------------------- rates and numbers


@pytest.mark.parametrize("name", ["slip", "miss", "misplace"])
def test_rates_far_from_the_stated_ones_are_said_with_an_interval(name):
    true = {"slip": 0.02, "miss": 0.02, "misplace": 0.02} | {name: 0.25}
    rig = noisy(open_map("cave:24x18:3"), 12, 5, Noise(**true))
    driven = drive(rig, **dict.fromkeys(true, 0.02), policy="closest-frontier", max_moves=600)
    rate = driven.rates[name]
    assert rate.low < 0.25 < rate.high
    assert rate.stated == 0.02
    assert rate.wrong
    assert any(alarm.kind == "rates" and alarm.text.startswith(name) for alarm in driven.alarms)
    assert driven.trust.level == "limited"


def test_the_number_of_particles_is_counted_under_noise():
    workspace = open_map("vessels:300:1")
    rig = noisy(workspace, 20, 1)

    def lose_one(letter):
        if len(liar.sent) == 60:
            there = np.flatnonzero(rig._noisy.there)
            rig._noisy.there[there[7]] = False
        return letter

    liar = Lying(rig, command=lose_one)
    driven = drive(liar, **STATED, policy="closest-frontier")
    assert driven.status == "complete"
    numbers = [alarm.text for alarm in driven.alarms if alarm.kind == "number"]
    assert len(numbers) == 1
    assert "about 20 particles at the start, about 19 now" in numbers[0]
    assert driven.trust.level == "limited"


def test_an_honest_rig_is_not_accused():
    false = []
    for seed in range(4):
        for noise in (Noise(0.05, 0.01, 0.02), Noise(0.2, 0.05, 0.1), Noise(0, 0, 0.1), Noise(0.1, 0, 0)):
            workspace = open_map(("maze:15x11", "cave:24x18", "vessels:200")[seed % 3] + f":{seed}")
            rig = noisy(workspace, (8, 20, 40)[seed % 3], seed, noise)
            driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=400)
            false += [(seed, noise, alarm.kind, alarm.text) for alarm in driven.alarms]
        driven = drive(exact(open_map(f"maze:15x11:{seed}"), 1 + seed))
        assert (driven.status, driven.trust.level, driven.alarms) == ("complete", "high", ())
    assert not false
