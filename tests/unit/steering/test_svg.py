"""Workspaces from SVG: whole drawings, y turned up, hostile ones refused in one sentence."""

from __future__ import annotations

import numpy as np
import pytest

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.steering import Region, open_workspace

HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    ' width="80mm" viewBox="0 0 40 40">'
)
USED = '<use xlink:href="#g{}"/>'
SQUARE = [(0, -1), (0, 0), (1, -1), (1, 0)]


def drawn(inside: str) -> object:
    return open_workspace({"type": "svg", "text": f"{HEAD}{inside}</svg>"})


def corners(space) -> list[tuple[float, float]]:
    return sorted(map(tuple, (space.vertices.round(9) + 0.0).tolist()))


@pytest.mark.parametrize(
    "inside",
    [
        '<path d="M0 0 h1 v1 h-1 z"/>',
        '<path d="m0,0 1,0 0,1 -1,0"/>',
        '<polygon points="0,0 1,0 1,1 0,1"/>',
        '<polyline points="0 0 1 0 1 1 0 1"/>',
        '<rect width="1" height="1"/>',
        '<rect x="-2" y="3" width="1" height="1" transform="translate(2 -3)"/>',
        (
            '<g transform="scale(0.5)"><g transform="translate(2,0)"><rect x="-2" width="2"'
            ' height="2"/></g></g>'
        ),
        '<defs><rect id="a" width="1" height="1"/></defs><use href="#a"/>',
        (
            '<style>.hidden { display: none }</style><rect class="hidden" width="9"'
            ' height="9"/><rect width="1" height="1"/>'
        ),
        '<title>a square</title><rect width="1" height="1" style="fill:none;stroke:#000"/>',
    ],
)
def test_squares_in_many_ways(inside):
    assert corners(drawn(inside)) == SQUARE


def test_round_shapes_and_arcs():
    assert drawn('<circle cx="2" cy="3" r="0.5"/>').center.tolist() == [2, -3]
    moved = drawn(
        '<g transform="translate(1 1) scale(2)"><ellipse cx="2" cy="3" rx="0.5" ry="0.5"/></g>'
    )
    assert (moved.radius, moved.center.tolist()) == (1, [5, -7])
    oval = drawn('<ellipse rx="2" ry="1"/>')
    assert np.ptp(oval.vertices, axis=0) == pytest.approx([4, 2], rel=1e-2)
    # clockwise on the screen, so below: down there, and down here
    half = drawn('<path d="M 1 0 A 1 1 0 0 1 -1 0 Z"/>')
    assert half.vertices[:, 1].min() == pytest.approx(-1, abs=1e-3)
    assert half.vertices[:, 1].max() == pytest.approx(0, abs=1e-9)
    assert len(drawn('<rect width="4" height="2" rx="0.5"/>').vertices) > 50


def test_lines_inside_of_the_largest_are_obstacles():
    yard = drawn('<circle cx="2" cy="2" r="0.5"/><rect width="4" height="4"/>')
    assert isinstance(yard, Region)
    assert len(yard.obstacles) == 1
    assert yard.outline[:, 1].min() == -4


@pytest.mark.parametrize(
    "inside",
    [
        "",
        '<path d="M0 0"/>',
        "<text>words</text>",
        '<path d="M 0 0 L x y"/>',
        '<path d="M0 0 L 1e999 0 L 0 1e999 Z"/>',
        '<path d="M0 0 L 1e300 0 L 0 1e300 Z"/>',
        '<rect width="1" height="1" transform="scale(1e200) scale(1e200)"/>',
        "<g>" * 5000 + '<rect width="1" height="1"/>' + "</g>" * 5000,
        '<g id="a"><use href="#a"/></g>',
        '<rect id="g0" width="1" height="1"/>'
        + "".join(f'<g id="g{k + 1}">{USED.format(k) * 10}</g>' for k in range(12)),
        '<rect width="1" height="1"/><rect x="0.5" width="2" height="1"/>',
        '<path d="M0 0 ' + "h1 v1 h-1 v1" * 30_000 + '"/>',
    ],
)
def test_hostile_drawings_get_one_sentence(inside, tmp_path, capsys):
    path = tmp_path / "drawing.svg"
    path.write_text(f"{HEAD}{inside}</svg>")
    assert run(["steer", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert "drawing.svg" in printed.err


@pytest.mark.parametrize(
    "text",
    [
        (
            '<?xml version="1.0"?><!DOCTYPE svg [<!ENTITY a "aaaa"><!ENTITY b'
            ' "&a;&a;&a;">]><svg><rect width="&b;"/></svg>'
        ),
        '<?xml version="1.0" encoding="utf-7"?><svg/>',
        "<svg",
        "<svg></svg><svg></svg>",
        "<svg>\ud800</svg>",
        "M" + "1" * 400 + " 0 h 1 v 1 z",
        "z z z",
    ],
)
def test_hostile_texts_are_refused(text):
    with pytest.raises(InvalidInputError):
        open_workspace({"type": "svg", "text": text})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello", "expected an SVG path, got 'hello'"),
        (
            "<html><body>x</body></html>",
            "expected an SVG drawing, got XML with the outermost element html",
        ),
        ("<svg", "expected an SVG drawing, got something else: unclosed token: line 1, column 0"),
    ],
)
def test_files_of_another_kind_are_told_in_no_words_of_a_parser(text, message, tmp_path):
    (tmp_path / "a.svg").write_text(text)
    with pytest.raises(InvalidInputError) as error:
        open_workspace(tmp_path / "a.svg")
    assert str(error.value) == f"{tmp_path / 'a.svg'}: {message}"


def test_a_problem_file_may_name_its_workspace(tmp_path):
    problem, shape = tmp_path / "a.json", tmp_path / "b.wkt"
    shape.write_text("POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))")
    for name in ("square", str(shape)):
        problem.write_text(f'{{"workspace": "{name}"}}')
        assert corners(open_workspace(problem)) == corners(open_workspace("square"))
    problem.write_text(f'{{"workspace": "{problem}"}}')
    with pytest.raises(InvalidInputError, match=r"a.json: workspace: .*a.json: expected an object"):
        open_workspace(problem)
