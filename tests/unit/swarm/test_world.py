"""Move rules, worked by hand."""

from __future__ import annotations

import numpy as np
import pytest

import shoal
from shoal import GridWorkspace, InvalidInputError, UnknownNameError
from shoal.swarm import GridWorld
from shoal.testing import check_world


def moved(text: str, command: str, rule: str = "block") -> str:
    """Move the particles of a text picture: '.' free, '#' wall, 'o' particle, digits several
    particles.
    """
    rows = text.split()
    free = np.array([[letter != "#" for letter in row] for row in rows])
    start = [
        (r, c)
        for r, row in enumerate(rows)
        for c, letter in enumerate(row)
        for _ in range(
            {".": 0, "#": 0, "o": 1}.get(letter, 0) if not letter.isdigit() else int(letter)
        )
    ]
    world = GridWorld(GridWorkspace(free), rule)
    picture = np.where(free, ".", "#")
    counts: dict[tuple[int, int], int] = {}
    for cell in world.step(world.initial(start), command).cells.tolist():
        counts[tuple(cell)] = counts.get(tuple(cell), 0) + 1
    for cell, n in counts.items():
        picture[cell] = "o" if n == 1 else str(n)
    return " ".join("".join(row) for row in picture)


@pytest.mark.parametrize(
    ("before", "command", "after"),
    [
        ("..ooo.", "r", "...ooo"),  # a train moves together
        ("...ooo", "r", "...ooo"),  # a queue against the wall stays
        ("o.oo.oo", "r", ".o.oooo"),  # a train with room moves, the queue at the wall stays
        ("o#oo.o", "l", "o#ooo."),  # walls hold
        ("o. o. ..", "d", ".. o. o."),
        ("o. oo .o", "d", ".. oo oo"),  # one column has room, the other queues
    ],
)
def test_block(before, command, after):
    assert moved(before, command) == after


@pytest.mark.parametrize(
    ("before", "command", "after"),
    [(".oo", "l", "oo."), ("oo.", "l", "2.."), ("3o", "r", ".4"), ("2#1", "r", "2#o")],
)
def test_merge(before, command, after):
    assert moved(before, command, "merge") == after


@pytest.mark.parametrize(
    ("before", "command", "after"),
    [("o..o...", "r", ".....oo"), ("o.o#..o", "l", "oo.#o.."), ("o. .. #o", "d", ".. o. #o")],
)
def test_tilt(before, command, after):
    assert moved(before, command, "tilt") == after


@pytest.mark.parametrize("width", [63, 64, 65, 127, 128, 129])
def test_a_queue_across_words(width):
    """A corridor full but for one cell, at every place of that cell: all on one side of it move,
    none on the other.
    """
    workspace = GridWorkspace(np.ones((1, width), bool))
    world = GridWorld(workspace)
    for gap in range(width):
        state = world.initial([(0, c) for c in range(width) if c != gap])
        right, left = world.step(state, "r"), world.step(state, "l")
        assert set(range(width)) - {c for _, c in right.cells.tolist()} == {0}
        assert set(range(width)) - {c for _, c in left.cells.tolist()} == {width - 1}


def test_three_dimensions():
    world = GridWorld(GridWorkspace(np.ones((3, 1, 1), bool)))
    state = world.initial([(1, 0, 0), (2, 0, 0)])
    assert world.step(state, "i").cells.tolist() == [[0, 0, 0], [1, 0, 0]]
    assert world.step(state, "o") == state
    assert world.step(state, "u") == state


@pytest.mark.parametrize(
    ("cells", "rule", "words"),
    [
        ([(0, 3)], "block", "inside"),
        ([(0, -1)], "block", "inside"),
        ([(0, 1)], "block", "obstacle"),
        ([(0, 0), (0, 0)], "block", "two at"),
        ([], "block", "start"),
        ([(0.5, 0)], "block", "integer"),
        ([(0, 0, 0)], "block", "shape"),
    ],
)
def test_bad_start(cells, rule, words):
    with pytest.raises(InvalidInputError, match=words):
        GridWorld(GridWorkspace([[1, 0, 1]]), rule).initial(cells)


def test_bad_commands_and_rules():
    world = GridWorld(GridWorkspace([[1, 1]]))
    state = world.initial([(0, 0)])
    for command in ("x", "", "lr", "i"):
        with pytest.raises(InvalidInputError):
            world.step(state, command)
    with pytest.raises(UnknownNameError, match="did you mean 'block'"):
        GridWorld(GridWorkspace([[1, 1]]), "blok")


def test_conformance():
    check_world(seed=3)


def test_the_conformance_check_finds_a_broken_world():
    class Leaky(GridWorld):
        """Loses a particle at each step to the left."""

        def step(self, state, command):
            after = super().step(state, command)
            return (
                self.initial(after.cells[1:]) if command == "l" and after.n_particles > 1 else after
            )

    with pytest.raises(AssertionError, match=r"particles became|another state"):
        check_world(Leaky)


def test_a_complete_mapping_says_how_many_cells_no_particle_can_get_to():
    free = np.ones((7, 12), bool)
    free[:, 4] = False
    episode = shoal.run(free, particles=1, start=((0, 0),), policy="closest-frontier")
    assert episode.status == "complete"
    assert "nothing is left" not in episode.reason
    assert "no particle can reach 49 of 77 free cells" in episode.sentence
    assert episode.report()["unreachable_cells"] == 49
    whole = shoal.run(free[:, :4], particles=1, policy="closest-frontier")
    assert (whole.unreachable, whole.reason) == (0, "no frontier cell is left")
