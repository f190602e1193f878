"""The figures of one dimension: the spec's, and the published curve of full coverage."""

from __future__ import annotations

import pytest

from shoal.papers.recipe import published_curve
from shoal.swarm.theory.one_dimension import Line, sample


def test_spec_figures():
    assert float(Line(1000, 10).boundary.exact) == pytest.approx(273.0)
    assert float(Line(1000, 100).boundary.exact) == pytest.approx(29.73, abs=0.005)
    assert float(Line(1000, 10).largest_gap.exact) == pytest.approx(272.80, abs=0.005)
    assert Line(7, 1).boundary.exact == 11  # (3m + 1) / 2


def test_coverage_of_fig_6():
    """The spec says 58.9 exact, from a simulation; counted exactly it is 58.744, and so says a
    million trials.
    """
    line = Line(1000, 100)
    assert float(line.coverage.exact) == pytest.approx(58.7443, abs=5e-5)
    assert float(line.coverage.printed) == pytest.approx(59.6978, abs=5e-5)
    assert float(line.published_coverage) == pytest.approx(60.7, abs=0.1)
    found = sample(line, 200_000, seed=1)
    assert abs(found.coverage.mean() - float(line.coverage.exact)) < 5 * found.standard_error(
        "coverage"
    )


def test_published_coverage_takes_the_gap_as_difference_of_positions():
    """Every tenth point of the curve, 2000 trials each, lies within five standard
    errors of that.
    """
    curve = published_curve("line-full-coverage-m5000.csv")
    for n, mean, deviation in list(
        zip(curve.x.astype(int).tolist(), curve.mean, curve.std, strict=True)
    )[9::10]:
        line = Line(5000, n)
        error = deviation / 2000**0.5
        assert abs(mean - float(line.published_coverage)) <= 5 * error + 0.005
        if n < 5000:
            assert 1.5 < float(line.published_coverage - line.coverage.exact) < 2
