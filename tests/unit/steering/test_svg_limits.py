"""Drawings of many curves are refused before their points are computed."""

from __future__ import annotations

import pytest

from shoal.core.errors import InvalidInputError
from shoal.steering.workspaces import formats as svg


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (
            "M 0 0 " + "q 1 1 2 2 " * 50_000 + "z",
            "at most 20000 corners, got more than 160000 numbers",
        ),
        ("M 0 0 " + "c 1 1 2 2 3 3 " * 1_000 + "z", "at most 20000 corners, got more"),
        ("M 0 0 " + "h 1 v 1 " * 10_500 + "z", "at most 20000 corners, got more"),
    ],
)
def test_corners_are_counted_before_they_are_computed(monkeypatch, path, words):
    computed = []
    points = svg._points
    monkeypatch.setattr(svg, "_points", lambda point: computed.append(1) or points(point))
    with pytest.raises(InvalidInputError, match=words):
        svg.rings_of_path(path, where="drawing")
    assert len(computed) <= svg.MOST_CORNERS


def test_drawings_of_many_curves():
    curves = "<path d='M0 0 q 1 1 2 0 z'/>" * 450
    with pytest.raises(InvalidInputError, match="at most 20000 corners, got more"):
        svg.read_drawing(f"<svg xmlns='http://www.w3.org/2000/svg'>{curves}</svg>", where="drawing")
    # two points are no closed line and count as no corner
    strokes = "<path d='M0 0 l 1 1'/>" * 1000
    square = "<path d='M0 0 h 4 v 4 h -4 z'/>"
    rings = svg.read_drawing(
        f"<svg xmlns='http://www.w3.org/2000/svg'>{strokes}{square}</svg>", where="drawing"
    )
    assert len(rings) == 1
