"""Policies: conformance, options, and third parties' code."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from tests.swarm_runs import run, run_trials

from shoal import InvalidInputError, UnknownNameError, open_map
from shoal.swarm import POLICIES, Coverage, GridWorkspace, make_policy
from shoal.swarm.simulation.compiled import is_compiled
from shoal.testing import check_policy, check_task

STEPS = {"l": (0, -1), "u": (-1, 0), "r": (0, 1), "d": (1, 0)}


class ThirdParty:
    """Closest-frontier as an outsider would write it: sets, a queue, nothing of Shoal but what a
    policy is shown.
    """

    name = "third-party"

    def decide(self, view, memory, rng):
        frontier, known = set(view.belief.frontier), set(view.belief.open)
        level = sorted(view.occupied, key=lambda cell: cell[::-1])
        came = dict.fromkeys(level, "")
        while level:
            following = []
            for cell in level:
                for command, step in STEPS.items():
                    ahead = (cell[0] + step[0], cell[1] + step[1])
                    if ahead in frontier:
                        return self.path(came, cell) + command, None
                    if ahead in known and ahead not in came:
                        came[ahead] = command
                        following.append(ahead)
            level = sorted(following, key=lambda cell: cell[::-1])
        return "", None

    @staticmethod
    def path(came, cell):
        commands = deque()
        while came[cell]:
            command = came[cell]
            commands.appendleft(command)
            cell = (cell[0] - STEPS[command][0], cell[1] - STEPS[command][1])
        return "".join(commands)


class Stubborn:
    """Pushes to the left for ever."""

    name = "stubborn"

    def decide(self, view, memory, rng):
        return "l", None


@pytest.mark.parametrize("name", ["maze:15x11", "cave:24x16", "htree:120", "vessels:200"])
def test_third_party_gives_the_same_episode(name):
    """A policy in plain Python, played step by step, and the built-in one in its kernel: the same
    commands.
    """
    workspace = open_map(name)
    for trial in range(3):
        theirs = run(workspace, policy=ThirdParty(), particles=8, trial=trial)
        ours = run(workspace, policy="closest-frontier", particles=8, trial=trial)
        assert theirs.commands == ours.commands
        np.testing.assert_array_equal(theirs.trace.frontier, ours.trace.frontier)
        np.testing.assert_array_equal(theirs.trace.travelled, ours.trace.travelled)
        assert theirs.verify()


def test_third_party_by_name():
    assert (
        run(
            open_map("maze:9x7"), policy="tests.unit.swarm.test_policies:ThirdParty", particles=3
        ).status
        == "complete"
    )


# The alias of a planner, and policies whose episodes end by chance, by their commands, or only in
# coverages: they have tests of their own.
OTHERS = ("best", "random-moves", "manual", "model", "offline")


@pytest.mark.parametrize(
    "policy",
    [
        *(name for name in POLICIES if name not in OTHERS),
        "closest-frontier:ties=row-major",
        "manual:lurd",
    ],
)
def test_conformance(policy):
    check_policy(policy)


def test_random_moves_conform_where_they_can_end():
    check_policy("random-moves", rules=["block", "merge"], max_moves=200_000)


class Corner(Coverage):
    """Only the first free cell is to be covered."""

    name = "corner"

    def choose_targets(self, workspace, rng):
        return workspace.free & (np.cumsum(workspace.free).reshape(workspace.shape) == 1)


def test_a_task_that_only_chooses_targets_is_compiled():
    check_task(Corner())
    assert is_compiled(Corner())
    whole, steps = (
        run(open_map("maze:9x7"), task=Corner(), particles=2, stepwise=stepwise)
        for stepwise in (False, True)
    )
    assert whole.commands == steps.commands


@pytest.mark.parametrize(
    "task", ["mapping", "coverage", "subset-coverage", "subset-coverage:fraction=0.5", "gathering"]
)
def test_tasks_conform(task):
    check_task(task)


def test_a_policy_without_progress_is_stopped():
    episode = run(open_map("rectangle:4x5"), policy=Stubborn(), particles=3)
    assert episode.status == "stalled"
    assert episode.moves < 1100
    assert "stalled" in episode.sentence
    with pytest.raises(AssertionError):
        check_policy(
            type(
                "Endless",
                (),
                {"name": "endless", "decide": lambda self, view, memory, rng: ("lr", None)},
            )(),
            max_moves=500,
        )


def test_manual():
    workspace = GridWorkspace([[1, 1, 1]])
    assert run(workspace, policy="manual:ludr", particles=3).status == "complete"
    stalled = run(workspace, policy="manual:ll", particles=1)
    assert (stalled.status, stalled.moves) == ("stalled", 2)
    assert stalled.policy == "manual:commands=ll"


@pytest.mark.parametrize(
    ("policy", "words"),
    [
        ("closest-frontier:ties=diagonal", "column-major or row-major"),
        ("closest-frontier:neighbours=lurx", "an order of 'lurd'"),
        ("closest-frontier:speed=3", "has no option 'speed'"),
        ("random-moves:fast", "has no option"),
        ("manual:lxr", "'x' at position 2"),
    ],
)
def test_bad_options(policy, words):
    with pytest.raises(InvalidInputError, match=words):
        run(open_map("line:5"), policy=policy, particles=1)


def test_unknown_names_suggest_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'elect-particle'"):
        make_policy("elect-particel")
    with pytest.raises(UnknownNameError, match="cannot import"):
        make_policy("no_such_module:Policy")
    assert set(POLICIES) >= {
        "random-moves",
        "elect-particle",
        "closest-frontier",
        "depth-first",
        "sweep",
        "manual",
    }


@pytest.mark.parametrize(("policy", "rule"), [("elect-particle", "tilt"), ("depth-first", "tilt")])
def test_rules_that_a_policy_cannot_play(policy, rule):
    with pytest.raises(InvalidInputError, match="expected rule block or merge"):
        run(open_map("line:5"), policy=policy, rule=rule, particles=1)


def test_sweep_is_flat():
    with pytest.raises(InvalidInputError, match="2-D"):
        run(GridWorkspace(np.ones((2, 2, 2), bool)), policy="sweep", particles=1)


def test_elect_particle_never_cycles():
    """A part of what `make soak` plays: with the handover every episode ends."""
    for name in ("vessels:600", "line:300", "rectangle:12x20", "htree:300", "maze:31x21"):
        for n in (1, 5, 60):
            episodes = run_trials(open_map(name), trials=20, particles=n, policy="elect-particle")
            assert {episode.status for episode in episodes} == {"complete"}


def test_a_done_part_hands_over_to_another():
    """Where the free space has several parts, the elected particle of a finished part
    is replaced.
    """
    workspace = GridWorkspace([[1, 1, 0, 1, 1, 1, 0, 1]])
    assert (
        run(workspace, policy="elect-particle", start=[(0, 0), (0, 4), (0, 7)]).status == "complete"
    )


def test_belief_of_a_task_is_what_the_policy_sees():
    workspace = open_map("maze:9x7")
    episode = run(workspace, particles=4)
    frames = list(episode.frames())
    assert len(frames) == episode.moves + 1
    assert [len(belief.frontier) for _, belief in frames[1:]] == episode.trace.frontier.tolist()
    assert len(frames[0][1].frontier) == episode.first_frontier


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        ("l", "expected decide to return"),
        ((1, None), "expected decide"),
        (("x", None), "'x' at position 1"),
    ],
)
def test_answers_that_are_none(answer, words):
    policy = type("Odd", (), {"name": "odd", "decide": lambda self, view, memory, rng: answer})()
    with pytest.raises(InvalidInputError, match=words):
        run(open_map("line:5"), policy=policy, particles=1)


def test_a_policy_that_fails_is_named_with_the_line():
    policy = type(
        "Broken", (), {"name": "broken", "decide": lambda self, view, memory, rng: 1 / 0}
    )()
    with pytest.raises(
        InvalidInputError,
        match=(
            r"policy broken: the method decide failed at .*test_policies.py, line \d+:"
            r" ZeroDivisionError"
        ),
    ):
        run(open_map("line:5"), policy=policy, particles=1)


def test_the_conformance_check_finds_a_policy_that_remembers():
    class Counting(ThirdParty):
        def __init__(self):
            self.calls = 0

        def decide(self, view, memory, rng):
            self.calls += 1
            return super().decide(view, memory, rng)

    with pytest.raises(AssertionError, match="changed the policy object"):
        check_policy(Counting(), rules=["block"])


class Flat(ThirdParty):
    """A policy that takes every cell for a pair (row, column)."""

    name = "flat"

    def decide(self, view, memory, rng):
        assert all(row >= 0 and column >= 0 for row, column in view.belief.open)
        return super().decide(view, memory, rng)


def test_the_conformance_check_names_the_map_on_which_a_policy_fails():
    expected = (
        r"^policy flat: the method decide failed at .*, line \d+: ValueError: .*, on a"
        r" three-dimensional map under rule block$"
    )
    with pytest.raises(AssertionError, match=expected):
        check_policy(Flat(), rules=["block"])
    check_policy(Flat(), rules=["block"], dimensions=[2])


def test_a_policy_states_its_rules_and_dimensions():
    class Stated(Flat):
        rules, dimensions = ("block",), (2,)

    check_policy(Stated())
    with pytest.raises(InvalidInputError, match="policy flat: expected a 2-D workspace, got 3-D"):
        run(np.ones((2, 2, 2), dtype=bool), policy=Stated(), particles=1)
    with pytest.raises(InvalidInputError, match="policy flat: expected rule block, got merge"):
        run(open_map("line:5"), policy=Stated(), particles=1, rule="merge")


class WithOptions:
    """A third party's policy whose options are set by name."""

    name = "with-options"

    def __init__(
        self, letters: str = "lurd", times: int = 1, share: float = 0.5, reverse: bool = False
    ):
        self.letters, self.times, self.share, self.reverse = letters, times, share, reverse

    def decide(self, view, memory, rng):
        return self.letters * self.times, memory


def test_options_of_third_parties():
    made = make_policy(
        "tests.unit.swarm.test_policies:WithOptions:letters=lr,times=2,share=0.25,reverse=true"
    )
    assert (made.letters, made.times, made.share, made.reverse) == ("lr", 2, 0.25, True)
    assert make_policy("tests.unit.swarm.test_policies:WithOptions:ud").letters == "ud"
    for options, words in (
        ("speed=3", "has no option 'speed'"),
        ("times=x", "times: expected a whole number, got 'x'"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            make_policy(f"tests.unit.swarm.test_policies:WithOptions:{options}")
