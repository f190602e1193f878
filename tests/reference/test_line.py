"""Formulas and kernels of one dimension against the step-by-step simulation, and exact means
against enumeration.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from tests.reference.line import largest_gap, left_then_right, printed_coverage_moves
from tests.without_compiler import printed

from shoal.swarm.kernels import theory as kernels
from shoal.swarm.theory.one_dimension import Line, boundary_moves, coverage_moves, sample


def random_lines(count, seed):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        cells = int(rng.integers(1, 40))
        particles = int(rng.integers(1, cells + 1))
        yield cells, np.sort(rng.choice(cells, size=particles, replace=False)) + 1


def test_formulas_are_the_simulation_on_ten_thousand_random_cases():
    for cells, positions in random_lines(10_000, seed=4):
        expected = left_then_right(positions.tolist(), cells)
        assert (
            int(boundary_moves(positions, cells=cells)),
            int(coverage_moves(positions, cells=cells)),
        ) == expected


def test_kernel_measures_what_the_formulas_say():
    for cells, positions in random_lines(3_000, seed=5):
        words = np.zeros(-(-cells // 64), dtype=np.uint64)
        for position in positions.tolist():
            words[(position - 1) // 64] |= np.uint64(1) << np.uint64((position - 1) % 64)
        row = np.zeros(kernels.COLUMNS, dtype=np.int32)
        kernels.measure(words, cells, row)
        formulas = (boundary_moves, coverage_moves, printed_coverage_moves)
        expected = [
            positions[0],
            cells + 1 - positions[-1],
            largest_gap(positions, cells=cells),
            positions[-1] - positions[0],
        ]
        assert row.tolist() == [
            *expected,
            *(formula(positions, cells=cells) for formula in formulas),
        ]


@pytest.mark.parametrize("cells", range(1, 11))
def test_exact_means_are_those_of_all_placements(cells):
    for particles in range(1, cells + 1):
        every = np.array(list(combinations(range(1, cells + 1), particles)))
        line = Line(cells, particles)

        def mean(values):
            return Fraction(int(np.sum(values)), len(values))

        simulated = np.array([left_then_right(positions, cells) for positions in every.tolist()])
        gaps = largest_gap(every, cells=cells)
        inner = (
            (np.diff(every) - 1).max(axis=1) if particles > 1 else np.zeros(len(every), dtype=int)
        )
        ends = every[:, 0] + cells - every[:, -1]
        assert line.placements == len(every)
        assert line.boundary.exact == mean(simulated[:, 0])
        assert line.coverage.exact == mean(simulated[:, 1])
        assert line.coverage.printed == mean(printed_coverage_moves(every, cells=cells))
        if particles not in (1, cells):
            assert line.published_coverage == mean(every[:, 0] + 1 + np.maximum(ends, inner + 1))
        for distribution, values in (
            (line.first_distribution, every[:, 0]),
            (line.first_distribution, cells + 1 - every[:, -1]),
            (line.spread_distribution, every[:, -1] - every[:, 0]),
            (line.largest_gap_distribution, gaps),
            (line.boundary_distribution, simulated[:, 0]),
        ):
            low, high = distribution.first, distribution.first + len(distribution.counts)
            assert [int(np.sum(values == value)) for value in range(low, high)] == list(
                distribution.counts
            )
            assert distribution.total == len(every)


@pytest.mark.parametrize(
    ("cells", "particles"), [(63, 20), (64, 64), (65, 50), (128, 3), (200, 150)]
)
def test_placements_are_drawn_evenly(cells, particles):
    """Each mean lies within five standard errors of the exact one; the seed is fixed."""
    line = Line(cells, particles)
    found = sample(line, 40_000, seed=2)
    for column, exact in (
        ("first", line.first_distribution.mean),
        ("last", line.first_distribution.mean),
        ("spread", line.spread_distribution.mean),
        ("largest_gap", line.largest_gap.exact),
        ("boundary", line.boundary.exact),
        ("coverage", line.coverage.exact),
        ("printed_coverage", line.coverage.printed),
    ):
        error = found.standard_error(column)
        assert abs(getattr(found, column).mean() - float(exact)) <= 5 * error + 1e-9, column


def test_all_small_placements_are_equally_likely():
    trials = 60_000
    counts = np.unique(sample(Line(6, 2), trials, seed=8).spread, return_counts=True)[1]
    expected = np.array(Line(6, 2).spread_distribution.counts) / 15 * trials
    assert (np.abs(counts - expected) < 5 * np.sqrt(expected)).all()


def test_same_sample_for_any_workers_and_with_the_compiler_off():
    script = (
        "import numpy as np; np.seterr(over='ignore')\nfrom shoal.swarm.theory.one_dimension import"
        " Line, sample\nfor n in (1, 9, 60, 70): print(sample(Line(70, n), 50, seed=3,"
        " workers=1).coverage.tolist())"
    )
    plain = printed(script)
    for workers in (1, 3):
        compiled = "".join(
            f"{sample(Line(70, n), 50, seed=3, workers=workers).coverage.tolist()}\n"
            for n in (1, 9, 60, 70)
        )
        assert plain == compiled


def test_a_sample_of_several_chunks_does_not_depend_on_the_workers():
    line = Line(3000, 1400)
    one, many = (sample(line, 4000, seed=1, workers=workers) for workers in (1, 4))
    np.testing.assert_array_equal(one.coverage, many.coverage)
    assert len(np.unique(one.first)) > 5
