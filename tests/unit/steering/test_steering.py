"""Workspaces, contacts and Δ-space: what is accepted, what is refused, and the rules of
the walls.
"""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from shoal.core.errors import InvalidInputError
from shoal.steering import (
    ContactWorld,
    ConvexWorkspace,
    Region,
    cylinder,
    disk,
    disk_reach,
    open_workspace,
    polygon,
    prism,
    reached_in_two_moves,
    region,
    regular_polygon,
)
from shoal.steering.delta_space import two_move_pieces
from shoal.steering.problem import _parse_places

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])


def test_any_order_and_straight_vertices():
    clockwise = polygon([(0, 0), (0, 0.5), (0, 1), (1, 1), (1, 1), (1, 0), (0, 0)])
    assert sorted(map(tuple, clockwise.vertices.tolist())) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for space in (clockwise, SQUARE, regular_polygon(7)):
        assert (space.wall_distances(space.center) > 0).all()
        np.testing.assert_allclose(np.hypot(*space.normals.T), 1)


@pytest.mark.parametrize(
    ("vertices", "wanted"),
    [
        ([(0, 0), (1, 0)], "expected 3 different vertices or more, got 2"),
        ([(0, 0), (1, 0), (1, 0), (0, 0)], "expected 3 different vertices or more, got"),
        ([(0, 0), (1, 1), (2, 2)], "got a flat one"),
        ([(0, 0), (1, 0), (2, 0), (3, 1e-12)], "got a flat one"),
        (
            [(0, 0), (1, 1), (0, 1), (1, 0)],
            "does not cross itself, got one that does at (0.5, 0.5)",
        ),
        ([(0, 0), (2, 0), (1, 0.2), (1, 2)], "bends inward at vertex 3, (1.0, 0.2)"),
        ([(1, 2), (1, 0.2), (2, 0), (0, 0)], "bends inward at vertex 2, (1.0, 0.2)"),
        ([(0, 0), (1, float("nan")), (1, 1)], "expected finite numbers, got (1.0, nan) at point 2"),
        (
            [(0, 0, 0), (1, 0, 0), (1, 1, 0)],
            "expected points of 2 numbers, got an array of shape (3, 3)",
        ),
        ([(0, 0), (1,), (1, 1)], "expected points of 2 numbers"),
        ("square", "expected points of 2 numbers, got 'square'"),
    ],
)
def test_outlines_that_are_refused(vertices, wanted):
    with pytest.raises(InvalidInputError) as caught:
        polygon(vertices)
    assert wanted in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (
            "POLYGON ((0 0, 1 0, 1 1))",
            "workspace, ring 1, vertex 3: expected a closed ring, which ends where it begins, at"
            " (0, 0), got (1, 1)",
        ),
        (
            "POLYGON ((0 0, 9 0, 9 9, 0 0), (2 1, 3 1, 3 2))",
            "workspace, ring 2, vertex 3: expected a closed ring, which ends where it begins, at"
            " (2, 1), got (3, 2)",
        ),
        (
            "POLYGON ((0 0, 1 x, 1 1, 0 0))",
            "workspace, ring 1, vertex 2: expected two numbers, x and y, got '1 x'",
        ),
        (
            "POLYGON ((0 0, 1 0, 1 1, 0 0)",
            "workspace: expected as many closing as opening parentheses, got 1 and 2",
        ),
        ("POLYGON EMPTY", "workspace: expected one polygon, got an empty one"),
        (
            "POLYGON 3",
            "workspace: expected well-known text such as POLYGON ((0 0, 2 0, 2 1, 0 0)),",
        ),
        (
            {"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1]]]},
            "workspace, ring 1, vertex 3: expected a closed ring, which ends where it begins, at"
            " (0, 0), got (1, 1)",
        ),
        (
            {"type": "MultiPolygon", "coordinates": [[[[0, 0], [1, "x"], [0, 0]]]]},
            "workspace, ring 1, vertex 2: expected two numbers, x and y, got [1, 'x']",
        ),
        ({"type": "Polygon"}, "workspace: expected a GeoJSON polygon, got {'type': 'Polygon'}"),
    ],
)
def test_texts_of_polygons_that_are_refused_are_told_in_words_of_their_own(text, wanted):
    with pytest.raises(InvalidInputError) as caught:
        open_workspace(text)
    assert str(caught.value).startswith(wanted)
    assert "Exception" not in str(caught.value)


@pytest.mark.parametrize(
    ("outline", "obstacles", "wanted"),
    [
        ([(0, 0), (1, 1), (1, 0), (0, 1)], [], "got one that crosses itself at (0.5, 0.5)"),
        ([(0, 0), (4, 0), (4, 4), (0, 4)], [[(3, 3), (5, 3), (5, 5)]], "got others at (4, 3)"),
    ],
)
def test_regions_that_are_refused_name_the_place(outline, obstacles, wanted):
    with pytest.raises(InvalidInputError) as caught:
        region(outline, obstacles)
    assert str(caught.value).endswith(wanted)


@pytest.mark.parametrize(
    ("call", "wanted"),
    [
        (lambda: disk(0), "radius: expected a number, above 0, got 0"),
        (lambda: disk(float("inf")), "radius: expected a number, above 0, got inf"),
        (
            lambda: disk(1, center=(0, None)),
            "center: expected one point of 2 numbers, got [(0, None)]",
        ),
        (lambda: regular_polygon(2), "sides: expected a whole number from 3 to 1000, got 2"),
        (lambda: prism(SQUARE, -1), "height: expected a number, above 0, got -1"),
        (lambda: prism(cylinder(1, 1), 1), "expected a polygon or a disk as base"),
        (lambda: cylinder(1, 1).differences, "expected a plane workspace, got a cylinder"),
        (
            lambda: ContactWorld(SQUARE).initial([(0.5, 0.5), (1.5, 0.5)]),
            "got (1.5, 0.5) at point 2, 0.5 outside",
        ),
        (
            lambda: ContactWorld(SQUARE, radius=0.05).initial([(0.5, 0.5), (0.98, 0.5)]),
            "expected points at least the particle radius of 0.05 from the walls, got 0.02 at point 2",
        ),
        (
            lambda: ContactWorld(SQUARE).step([(0.5, 0.5)], (1, np.nan)),
            "move: expected finite numbers",
        ),
        (
            lambda: ContactWorld(SQUARE).step([(0.5, 0.5)], (1, 2, 3)),
            "move: expected one point of 2 numbers",
        ),
        (
            lambda: reached_in_two_moves(SQUARE, (0.5, 0), (1.5, 0)),
            "after: expected the difference of two points of the polygon",
        ),
        (lambda: disk_reach(0, moves=2), "distance: expected a number, above 0"),
        (lambda: disk_reach(0.1, moves=3), "moves: expected an even number, 2 or more, got 3"),
    ],
)
def test_refusals(call, wanted):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert wanted in str(caught.value)


def test_tangential_motion_and_corners_are_held():
    world = ContactWorld(SQUARE)
    assert world.step([(0.5, 0)], (0.25, 0)).tolist() == [[0.5, 0]]  # along the wall
    assert world.step([(0.5, 0)], (0.25, 0.25)).tolist() == [[0.75, 0.25]]  # lifted off it
    assert world.step([(0, 0)], (0.25, -0.1)).tolist() == [[0, 0]]  # in a corner either wall holds
    assert world.step([(0, 0)], (0.25, 0.1)).tolist() == [[0.25, 0.1]]
    ring = ContactWorld(disk(1))
    assert ring.step([(1, 0)], (0, 0.5)).tolist() == [[1, 0]]
    assert ring.step([(1, 0)], (-0.5, 0.5)).tolist() == [[0.5, 0.5]]


def test_a_particle_stays_where_it_first_meets_a_wall():
    after = ContactWorld(SQUARE).step([(0.5, 0.5), (0.9, 0.1)], (0.3, 0.8))
    np.testing.assert_allclose(after, [[0.6875, 1.0], [1.0, 0.1 + 0.8 / 3]])


def test_prism_and_cylinder_have_caps_unless_they_are_tubes():
    for space in (prism(SQUARE, 2), cylinder(0.5, 2)):
        center = [*space.center, 1.0]
        world = ContactWorld(space)
        assert world.step([center], (0, 0, 5))[0, 2] == 2
        assert not space.contains([*space.center, 2.1])
    tube = cylinder(0.5, 2, open_ends=True)
    assert ContactWorld(tube).step([(0, 0, 1)], (0, 0, 5))[0, 2] == 6
    side = ContactWorld(cylinder(0.5, 2)).step([(0, 0, 1), (0.4, 0, 1)], (0.3, 0, 0.3))
    # what a side wall holds does not rise either
    np.testing.assert_allclose(side, [[0.3, 0, 1.3], [0.5, 0, 1.1]])


def test_delta_space():
    assert len(SQUARE.differences.vertices) == 4
    assert disk(0.5, center=(3, 4)).differences.radius == 1
    triangle = regular_polygon(3).differences
    assert len(triangle.vertices) == 6
    np.testing.assert_allclose(
        sorted(triangle.vertices.tolist()), sorted((-triangle.vertices).tolist()), atol=1e-12
    )


def test_what_two_moves_cannot_do():
    assert reached_in_two_moves(SQUARE, (0, 0), (0.1, 0)) is None  # together for ever
    assert reached_in_two_moves(disk(0.5), (0, 0), (0.1, 0)) is None
    assert reached_in_two_moves(SQUARE, (0.5, 0), (0.5, 0.1)) is not None
    assert reached_in_two_moves(SQUARE, (0.5, 0), (0.6, 0)) is None  # further apart across a wall
    assert reached_in_two_moves(disk(0.5), (0.3, 0.1), (-0.9, -0.3)) is None
    assert two_move_pieces(disk(0.5), (0, 0)) == []


def test_fractions_of_the_disk():
    """Paper W, section IV.F: 6.3, 30, 55, 75, 86, 93 and 96 % after 2, 4, ..., 14 moves."""
    fractions = [100 * reach.fraction() for reach in disk_reach(0.1, moves=14)]
    np.testing.assert_allclose(fractions, [6.3, 30.1, 55.7, 74.9, 86.5, 93.0, 96.5], atol=0.3)
    nearest = {d: disk_reach(d, moves=2)[0].fraction() for d in (0.70, 0.8175, 0.90)}
    assert max(nearest, key=nearest.get) == 0.8175
    assert nearest[0.8175] == pytest.approx(0.377, abs=0.003)


def test_reach_of_two_moves_is_the_exact_set():
    rng = np.random.default_rng(6)
    before = np.array([0.6, 0.0])
    points = (rng.random((400, 2)) * 2 - 1) * 0.99
    points = points[np.hypot(*points.T) < 0.99]
    sampled = disk_reach(0.6, moves=2)[0].contains(points)
    for point, found in zip(points, sampled, strict=True):
        crossing = reached_in_two_moves(disk(0.5), before, point)
        if crossing is None:
            assert not found
        elif crossing.slack > 0.01:  # wider than the contacts lie apart
            assert found


@pytest.mark.parametrize(
    "text",
    [
        "0.2,0.3 0.5,0.35",
        "0.2,0.3, 0.5,0.35",
        "0.2, 0.3, 0.5, 0.35",
        "0.2, 0.3 0.5, 0.35",
        "0.2 0.3, 0.5 0.35",
        "0.2 0.3 0.5 0.35",
        "0.2,0.3;0.5,0.35",
        "(0.2, 0.3), (0.5, 0.35)",
        "[[0.2,0.3],[0.5,0.35]]",
    ],
)
def test_points_are_read_however_they_are_separated(text):
    assert _parse_places(text) == [[0.2, 0.3], [0.5, 0.35]]


def test_points_in_space_and_what_are_no_points():
    wanted = [[0.2, 0.3, 0.1], [0.5, 0.4, 0.7]]
    for text in ("0.2,0.3,0.1 0.5,0.4,0.7", "0.2 0.3 0.1, 0.5 0.4 0.7", str(wanted)):
        assert _parse_places(text) == wanted
    for text in ("0.2,0.3 0.5", "0.2,0.3 0.5,0.6,0.7", "a,b c,d"):
        with pytest.raises(ValueError, match=r"expected points, as in '0\.1,0\.2 0\.3,0\.4', got "):
            _parse_places(text)


def test_a_drawing_that_bends_inward_is_a_region(tmp_path):
    """It was refused, and only a file of the type region was one."""
    corners = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)]
    ring = ", ".join(f"{x} {y}" for x, y in (*corners, corners[0]))
    text = f"POLYGON (({ring}))"
    (tmp_path / "corner.geojson").write_text(shapely.to_geojson(shapely.Polygon(corners)))
    (tmp_path / "corner.svg").write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg"><path d="M {ring} z"/></svg>'
    )
    for source in (text, tmp_path / "corner.geojson", tmp_path / "corner.svg"):
        workspace = open_workspace(source)
        assert isinstance(workspace, Region)
        assert len(workspace.outline) == 6
        assert not workspace.obstacles
    assert isinstance(open_workspace("POLYGON ((0 0, 2 0, 2 1, 0 0))"), ConvexWorkspace)
    with pytest.raises(InvalidInputError, match="does not cross itself"):
        open_workspace("POLYGON ((0 0, 1 1, 0 1, 1 0, 0 0))")
