"""Registration: how the pixels of a camera lie in the grid.

Marks are points whose pixel and cell are known. A known map is laid over the outline of the vessel
in the picture: a threshold separates the vessel, its centroid and its second moments determine the
affine map up to a turn and a reflection, these are tried, and the best is refined by maximizing the
correlation of the two masks (ECC of OpenCV). If only the size of a cell is known, the grid covers
the picture, along the directions in which pulses move the particles.
"""

from __future__ import annotations

from itertools import combinations, islice
from math import atan2, degrees, inf, radians, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.rigs.calibration import RESIDUAL, TieKind, transform_points
from shoal.rigs.cameras import grey, load_opencv
from shoal.swarm.maps.workspace import check_free

HIDDEN = 3.0  # times the residual that an error of a lens may be between marks

Points = NDArray[np.float64]
Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]

COARSE = 160  # pixels of the longer side of the picture in which turns are tried
FINE = 900  # pixels of the longer side of the map in the refinement
TURNS = 180  # turns that are tried, for each reflection
SURE = 0.03  # least difference of the overlaps of the best turn and of any other
OTHER = 15.0  # degrees from which on a turn is another one
HOLE = 0.7  # area in cells up to which a hole in the vessel is a particle
LEAST = 0.6  # overlap (area of the intersection over that of the union) below which nothing fits
AROUND = 3  # rows and columns of a square in which outlines are compared, too
LOCAL = 2.0  # times the limit of all outlines that the distance in a square may be
OUTLIER = 0.5  # distance, in cells, from which on a mark contradicts the others
FLAT = 0.05  # width over length of a set of marks, below which the marks lie on one line
TURNED = 45.0  # angle, in degrees, between command and motion, from which on an axis is another one


@dataclass(frozen=True, eq=False)
class Tie:
    """How pixels lie in the grid.

    Parameters
    ----------
    kind : str
        What tied them, as in `BenchCalibration`.
    matrix : ndarray of float64, shape (3, 3)
        As in `BenchCalibration`.
    residual : float or None
        Root mean square error in cells.
    notes : tuple of str
        What the user should know.
    """

    kind: TieKind
    matrix: Points
    residual: float | None
    notes: tuple[str, ...] = ()


def tie_by_marks(marks: ArrayLike, *, limit: float = RESIDUAL) -> Tie:
    """Return the map from pixels to cells that fits marked points: affine, or a homography if the
    marks show that the camera looks askew. A mark that contradicts the others is left out.

    Parameters
    ----------
    marks : array_like of float, shape (n, 4)
        Pixel x, y and the row and column there, of at least three points that are not on a line.
    limit : float
        Largest residual in cells.

    Raises
    ------
    InvalidInputError
        Raised if there are too few marks, if they lie on a line, or if the residual is too large.

    Examples
    --------
    >>> marks = [(0, 0, 0, 0), (100, 0, 0, 5), (0, 100, 5, 0), (100, 100, 5, 5)]
    >>> tie = tie_by_marks(marks)
    >>> transform_points(tie.matrix, [(40, 20)]).round(3).tolist(), round(tie.residual, 6)
    ([[1.0, 2.0]], 0.0)
    """
    expected = "mark: expected numbers x, y, row, column for each mark"
    table = check_array(marks, expected=expected).astype(np.float64)
    if table.ndim != 2 or table.shape[1] != 4 or not np.isfinite(table).all():
        raise InvalidInputError(expected)
    if len(table) < 3:
        raise InvalidInputError(f"mark: expected at least 3 marks, got {len(table)}")
    notes = []
    for name, points in (("pixels", table[:, :2]), ("cells", table[:, 2:])):
        _check_spread(points, f"mark: expected {name} that are not on one line")
    inliers = _find_inliers(table) if len(table) >= 6 else np.ones(len(table), dtype=bool)
    for at in np.flatnonzero(~inliers).tolist():
        x, y, row, col = table[at]
        notes.append(f"the mark {x:g},{y:g}={row:g},{col:g} contradicts the others: left out")
    table = table[inliers]
    _check_spread(table[:, :2], "mark: expected pixels that are not on one line")
    matrix, residual = _fit(table, projective=False), _leave_one_out_error(table, projective=False)
    if len(table) >= 6 and residual is not None:
        projective = _leave_one_out_error(table, projective=True)
        if projective is not None and projective < residual / 2:
            matrix, residual = _fit(table, projective=True), projective
    if residual is not None and residual > limit:
        raise InvalidInputError(
            f"mark: expected marks that agree within {limit:g} cells, got a residual of"
            f" {residual:.2g}"
        )
    if residual is None:
        notes.append("three marks cannot show an error; give four or more")
    elif _hidden_by_marks(table) > HIDDEN:
        notes.append(
            "these marks do not show whether the lens bends lines, so that cells between them may be"
            " farther off than the residual: give more marks, at other distances from their middle"
        )
    return Tie("marks", matrix, residual, tuple(notes))


def _hidden_by_marks(table: Points) -> float:
    """Return how many times as large as the residual an error of a place between the marks may be,
    if a lens with its axis in their middle draws points nearer to it, with the cube of the distance.
    """
    pixels = table[:, :2]
    middle, size = pixels.mean(0), float(np.abs(pixels - pixels.mean(0)).max())

    def bend(points: Points) -> Points:
        away = (points - middle) / size
        return np.asarray(points - 1e-3 * size * away * np.sum(away**2, axis=1)[:, None])

    plain = _fit(table, projective=False)
    steps = np.linspace(pixels.min(0), pixels.max(0), 9)
    places = np.stack(np.meshgrid(*steps.T), axis=-1).reshape(-1, 2)
    bent = np.column_stack([bend(pixels), transform_points(plain, pixels)])
    wrong = transform_points(_fit(bent, projective=False), bend(places)) - transform_points(
        plain, places
    )
    residual = _leave_one_out_error(bent, projective=False) or 0.0
    return float(np.linalg.norm(wrong, axis=1).max() / max(residual, 1e-12))


def _check_spread(points: Points, expected: str) -> None:
    long, short = np.linalg.svd(points - points.mean(0), compute_uv=False)[:2]
    if not long or short / long < FLAT:
        raise InvalidInputError(
            f"{expected}, got {', '.join(f'({x:g}, {y:g})' for x, y in points[:4].tolist())}"
        )


def _fit(table: Points, *, projective: bool) -> Points:
    """Return the least-squares map from pixels to cells."""
    pixels, cells = table[:, :2], table[:, 2:]
    middle, size = pixels.mean(0), float(np.abs(pixels - pixels.mean(0)).max())
    scaled = (pixels - middle) / size
    ones = np.column_stack([scaled, np.ones(len(scaled))])
    affine = np.vstack([np.linalg.lstsq(ones, cells, rcond=None)[0].T, [0, 0, 1]])
    if projective:
        from scipy.optimize import least_squares

        def errors(entries: Points) -> Points:
            return (transform_points(np.append(entries, 1.0).reshape(3, 3), scaled) - cells).ravel()

        affine = np.append(least_squares(errors, affine.ravel()[:8]).x, 1.0).reshape(3, 3)
    shrink = np.array(
        [[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]]
    )
    matrix = affine @ shrink
    return np.asarray(matrix / matrix[2, 2], dtype=np.float64)


def _leave_one_out_error(table: Points, *, projective: bool) -> float | None:
    """Return the root mean square distance of each mark from where the others put it, in cells."""
    if len(table) < (6 if projective else 4):
        return None
    errors = []
    for at in range(len(table)):
        others = np.delete(table, at, axis=0)
        try:
            _check_spread(others[:, :2], "")
        except InvalidInputError:  # this mark alone shows one direction
            continue
        matrix = _fit(others, projective=projective)
        errors.append(
            float(np.sum((transform_points(matrix, table[at, :2])[0] - table[at, 2:]) ** 2))
        )
    return float(np.sqrt(np.mean(errors))) if errors else None


def _find_inliers(table: Points) -> NDArray[np.bool_]:
    """Return which marks agree with most others (least median of squares over all triples)."""
    best, inliers = inf, np.ones(len(table), dtype=bool)
    order = np.random.default_rng(0).permutation(len(table))
    for triple in islice(combinations(order.tolist(), 3), 2000):
        triple_marks = table[list(triple)]
        try:
            _check_spread(triple_marks[:, :2], "")
        except InvalidInputError:
            continue
        distances = np.linalg.norm(
            transform_points(_fit(triple_marks, projective=False), table[:, :2]) - table[:, 2:],
            axis=1,
        )
        if (middle := float(np.median(distances))) < best:
            # a camera that looks askew bends all marks a little; an error of reading is larger
            best, inliers = middle, distances <= max(OUTLIER, 5 * middle)
    return inliers


def tie_by_sensor(sensor: Any) -> Tie:
    """Return the map of a sensor that knows it (its attribute ``calibration``)."""
    pixels = np.array([(0.0, 0), (100, 0), (0, 100), (100, 100)])
    table = np.hstack([pixels, sensor.calibration.to_cells(pixels)])
    return Tie("sensor", _fit(table, projective=False), None)


def tie_by_scale(
    motions: dict[str, Points], cell: float, size: tuple[int, int], points: Points
) -> tuple[Tie, tuple[int, int]]:
    """Return a grid over the whole picture, whose axes are the directions of the pulses.

    Parameters
    ----------
    motions : dict of str to ndarray of float64, shape (2,)
        Motion of each command in pixels.
    cell : float
        Side of a cell in pixels.
    size : tuple of int
        Width and height of the picture in pixels.
    points : ndarray of float64, shape (n, 2)
        Positions of particles in pixels. The grid is shifted so that they lie in the middle of their
        cells in the (circular) mean: narrow vessels along the axes then are rows of cells.

    Returns
    -------
    tie : Tie
    shape : tuple of int
        Rows and columns of the grid.

    Raises
    ------
    InvalidInputError
        Raised if the directions of two commands are nearly the same.
    """
    right = _unit(motions["r"]) - _unit(motions["l"])
    down = _unit(motions["d"]) - _unit(motions["u"])
    right, down = _unit(right), _unit(down)
    if abs(right[0] * down[1] - right[1] * down[0]) < sin(radians(TURNED)):
        raise InvalidInputError(
            "calibration: expected commands to the right and up to move particles in directions that"
            f" differ by {TURNED:g} to {180 - TURNED:g} degrees, got"
            f" {degrees(atan2(right[1], right[0])):.0f} and {degrees(atan2(-down[1], -down[0])):.0f}"
        )
    to_pixels = cell * np.column_stack([down, right])  # of one row, of one column
    linear = np.linalg.inv(to_pixels)
    width, height = size
    corners = np.array([(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)], float)
    reached = corners @ linear.T
    phase = np.angle(np.exp(2j * np.pi * (points @ linear.T)).mean(0)) / (2 * np.pi)
    shift = phase + np.floor(reached.min(0) + 0.5 - phase)
    rows, columns = np.ceil(reached.max(0) - shift + 0.5).astype(int).tolist()
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = linear, -shift
    return Tie("scale", matrix, None), (rows, columns)


def _unit(vector: Points) -> Points:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


def tie_by_map(picture: NDArray[Any], free: NDArray[np.bool_], *, limit: float = RESIDUAL) -> Tie:
    """Return the map from pixels to cells under which a known map fits the picture best.

    Parameters
    ----------
    picture : ndarray, shape (height, width) or (height, width, 3)
        Picture of the vessel, brighter or darker than its surroundings, wholly in view.
    free : ndarray of bool, shape (rows, columns)
        True for the cells of the vessel.
    limit : float
        Largest root mean square distance of the two outlines, in cells. In no square of 3 x 3 cells,
        half of the outlines may be twice as far from each other.

    Raises
    ------
    InvalidInputError
        Raised if the map does not fit, or if it fits turned or mirrored as well.
    MissingExtraError
    """
    cv2 = load_opencv()
    free = check_free(free)
    shown = grey(picture).astype(np.float32)
    scaled = cv2.normalize(shown, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    _, bright = cv2.threshold(scaled, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    best: tuple[float, Matrix, Mask] | None = None
    runner_up = 0.0
    for mask in (bright > 0, bright == 0):
        vessel = _largest_part(cv2, mask, int(free.sum()))
        if vessel is None:
            continue
        candidates = _try_turns(cv2, vessel, free)
        overlap, matrix, angle = max(candidates, key=lambda candidate: candidate[0])
        alternative = max(
            (
                candidate[0]
                for candidate in candidates
                if np.sign(np.linalg.det(candidate[1])) != np.sign(np.linalg.det(matrix))
                or abs((candidate[2] - angle + 180) % 360 - 180) > OTHER
            ),
            default=0.0,
        )
        if best is None or overlap > best[0]:
            best, runner_up = (overlap, matrix, vessel), alternative
    if best is None or best[0] < LEAST:
        raise InvalidInputError(
            "map: expected one whose outline is in the picture, got an overlap of at most"
            f" {0 if best is None else best[0]:.0%}; give marks"
        )
    overlap, matrix, vessel = best
    if overlap - runner_up < SURE:
        raise InvalidInputError(
            "map: expected one that fits the picture in one way, got one that fits turned or"
            " mirrored as well; give marks"
        )
    matrix = _refine(cv2, vessel, free, matrix)
    residual, farthest, place = _outline_distances(cv2, vessel, free, matrix)
    if residual > limit:
        raise InvalidInputError(
            f"map: expected an outline within {limit:g} cells of that in the picture, got"
            f" {residual:.2g}"
        )
    pixel = float(abs(np.linalg.det(matrix[:2, :2]))) ** -0.5  # distances are whole pixels, or so
    if farthest > max(LOCAL * limit, 1.5 * pixel):
        raise InvalidInputError(
            f"map: expected an outline within {LOCAL * limit:g} cells of that in the picture"
            f" everywhere, got {farthest:.2g} near row {place[0]}, column {place[1]}: the map differs"
            " there, or the lens bends lines"
        )
    return Tie("map", np.asarray(np.linalg.inv(matrix), dtype=np.float64), residual)


def _largest_part(cv2: Any, mask: Mask, cells: int) -> Mask | None:
    """Return the largest connected part of a mask, with small holes filled (the particles)."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        mask.astype(np.uint8), connectivity=4
    )
    if count < 2:
        return None
    part = labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    _, labels, stats, _ = cv2.connectedComponentsWithStats((~part).astype(np.uint8), connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] < HOLE * part.sum() / cells
    small[0] = False
    return np.asarray(part | small[labels])


def _moments(mask: Mask) -> tuple[Matrix, Matrix]:
    """Return the centroid (x, y) and the square root of the covariance of a mask's area."""
    rows, columns = np.nonzero(mask)
    points = np.column_stack([columns, rows]).astype(np.float64)
    covariance = np.cov(points.T) + np.eye(2) / 12  # each pixel is a unit square
    values, axes = np.linalg.eigh(covariance)
    return points.mean(0), axes @ np.diag(np.sqrt(values)) @ axes.T


def _try_turns(cv2: Any, vessel: Mask, free: Mask) -> list[tuple[float, Matrix, float]]:
    """Return overlap, matrix from (column, row) to pixels and turn for all turns and reflections."""
    height, width = vessel.shape
    shrink = min(1.0, COARSE / max(height, width))
    size = max(1, round(width * shrink)), max(1, round(height * shrink))
    small = cv2.resize(vessel.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    to_small = np.array(
        [
            [size[0] / width, 0, (size[0] / width - 1) / 2],
            [0, size[1] / height, (size[1] / height - 1) / 2],
            [0, 0, 1],
        ]
    )
    middle, spread = _moments(vessel)
    centre, shape = _moments(free)
    candidates = []
    drawn = free.astype(np.float32)
    for mirror in (1.0, -1.0):
        for turn in range(TURNS):
            angle = 2 * np.pi * turn / TURNS
            rotation = np.array(
                [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            ) @ np.diag([1.0, mirror])
            linear = spread @ rotation @ np.linalg.inv(shape)
            matrix = np.eye(3)
            matrix[:2, :2], matrix[:2, 2] = linear, middle - linear @ centre
            laid = cv2.warpAffine(drawn, (to_small @ matrix)[:2], size, flags=cv2.INTER_NEAREST)
            union = float(np.maximum(laid, small).sum())
            candidates.append(
                (float(np.minimum(laid, small).sum()) / union, matrix, 360 * turn / TURNS)
            )
    return candidates


def _refine(cv2: Any, vessel: Mask, free: Mask, matrix: Matrix) -> Matrix:
    """Return the matrix from (row, column) to pixels that correlates the masks best."""
    side = max(1, min(32, FINE // max(free.shape)))
    drawn = cv2.resize(
        free.astype(np.float32),
        (free.shape[1] * side, free.shape[0] * side),
        interpolation=cv2.INTER_NEAREST,
    )
    # (u + 1/2) / side - 1/2 is the column of the drawn pixel u
    to_cells = np.array(
        [[1 / side, 0, 0.5 / side - 0.5], [0, 1 / side, 0.5 / side - 0.5], [0, 0, 1]]
    )
    warp = (matrix @ to_cells).astype(np.float32)
    shown = vessel.astype(np.float32)
    ends = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-6)
    blur = 2 * max(1, side // 4) + 1
    try:
        _, affine = cv2.findTransformECC(
            drawn, shown, warp[:2], cv2.MOTION_AFFINE, ends, None, blur
        )
        warp = np.vstack([affine, [0, 0, 1]]).astype(np.float32)
        _, warp = cv2.findTransformECC(drawn, shown, warp, cv2.MOTION_HOMOGRAPHY, ends, None, blur)
    except cv2.error:  # it does not converge: the distance of the outlines judges what is there
        pass
    swap = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    return np.asarray(warp.astype(np.float64) @ np.linalg.inv(to_cells) @ swap)


def _outline_distances(
    cv2: Any, vessel: Mask, free: Mask, matrix: Matrix
) -> tuple[float, float, tuple[int, int]]:
    """Return the root mean square distance between the outlines of the map and of the picture in
    cells, the largest median of a square of cells, and the row and column in the middle of the square.

    A lens that bends lines moves all of the outline at the border of the map, which is little in the
    mean of the whole. A particle at a wall moves less than half of the outline of a square.
    """
    side = 8
    drawn = np.kron(free, np.ones((side, side), dtype=bool))
    swap = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])
    to_cells = np.array(
        [[1 / side, 0, 0.5 / side - 0.5], [0, 1 / side, 0.5 / side - 0.5], [0, 0, 1]]
    )
    laid = cv2.warpPerspective(
        drawn.astype(np.uint8),
        matrix @ swap @ to_cells,
        (vessel.shape[1], vessel.shape[0]),
        flags=cv2.INTER_NEAREST,
    )
    outlines = [_outline(cv2, vessel.astype(np.uint8)), _outline(cv2, laid)]
    cell = float(abs(np.linalg.det(matrix[:2, :2]))) ** 0.5
    apart, pixels = [], []
    for outline, other in (outlines, outlines[::-1]):
        distances = cv2.distanceTransform((~other).astype(np.uint8), cv2.DIST_L2, 5)
        apart.append(distances[outline] / cell)
        pixels.append(np.argwhere(outline)[:, ::-1])
    away = np.concatenate(apart)
    to_cells = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    cells = transform_points(to_cells, np.concatenate(pixels))
    squares, member, sizes = np.unique(
        np.floor((cells + 0.5) / AROUND).astype(np.int64),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    parts = np.split(away[np.argsort(member.ravel(), kind="stable")], np.cumsum(sizes)[:-1])
    # a square with less of an outline than its own side is too little for a median
    medians = [float(np.median(part)) if len(part) >= AROUND * cell else 0.0 for part in parts]
    worst = int(np.argmax(medians))
    row, column = (squares[worst] * AROUND + AROUND // 2).tolist()
    return float(np.sqrt(np.mean(away**2))), medians[worst], (row, column)


def _outline(cv2: Any, mask: NDArray[np.uint8]) -> Mask:
    eroded = cv2.erode(
        mask, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return np.asarray((mask > 0) & (eroded == 0))
