"""Registration of a known map with the picture of a camera, by the outline of the vessel.

The vessel is separated from its surroundings by a threshold. Its centroid and its second moments
determine the affine map to the mask of the map up to a turn and a reflection; these are tried, and
the best is refined by maximizing the correlation of the two masks (ECC of OpenCV).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.rigs.calibration import RESIDUAL, Tie
from shoal.rigs.cameras import grey, load_opencv

Matrix = NDArray[np.float64]
Mask = NDArray[np.bool_]

COARSE = 160  # pixels of the longer side of the picture in which turns are tried
FINE = 900  # pixels of the longer side of the map in the refinement
TURNS = 180  # turns that are tried, for each reflection
SURE = 0.03  # least difference of the overlaps of the best turn and of any other
OTHER = 15.0  # degrees from which on a turn is another one
HOLE = 0.7  # area in cells up to which a hole in the vessel is a particle
LEAST = 0.6  # overlap (area of the intersection over that of the union) below which nothing fits


def tie_by_map(picture: NDArray[Any], free: NDArray[np.bool_], *, limit: float = RESIDUAL) -> Tie:
    """Return the map from pixels to cells under which a known map fits the picture best.

    Parameters
    ----------
    picture : ndarray, shape (height, width) or (height, width, 3)
        Picture of the vessel, brighter or darker than its surroundings, wholly in view.
    free : ndarray of bool, shape (rows, columns)
        True for the cells of the vessel.
    limit : float
        Largest root mean square distance of the two outlines, in cells.

    Raises
    ------
    InvalidInputError
        Raised if the map does not fit, or if it fits turned or mirrored as well.
    MissingExtraError
    """
    cv2 = load_opencv()
    shown = grey(picture).astype(np.float32)
    scaled = cv2.normalize(shown, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    _, bright = cv2.threshold(scaled, 0, 1, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    best: tuple[float, Matrix, Mask] | None = None
    other = 0.0
    for mask in (bright > 0, bright == 0):
        vessel = _largest(cv2, mask, int(free.sum()))
        if vessel is None:
            continue
        tried = _tried(cv2, vessel, free)
        overlap, matrix, angle = max(tried, key=lambda one: one[0])
        rest = max(
            (
                one[0]
                for one in tried
                if np.sign(np.linalg.det(one[1])) != np.sign(np.linalg.det(matrix))
                or abs((one[2] - angle + 180) % 360 - 180) > OTHER
            ),
            default=0.0,
        )
        if best is None or overlap > best[0]:
            best, other = (overlap, matrix, vessel), rest
    if best is None or best[0] < LEAST:
        raise InvalidInputError(
            "map: expected one whose outline is in the picture, got an overlap of at most"
            f" {0 if best is None else best[0]:.0%}; give marks"
        )
    overlap, matrix, vessel = best
    if overlap - other < SURE:
        raise InvalidInputError(
            "map: expected one that fits the picture in one way, got one that fits turned or"
            " mirrored as well; give marks"
        )
    matrix = _refined(cv2, vessel, free, matrix)
    residual = _outline_distance(cv2, vessel, free, matrix)
    if residual > limit:
        raise InvalidInputError(
            f"map: expected an outline within {limit:g} cells of that in the picture, got"
            f" {residual:.2g}"
        )
    return Tie("map", np.linalg.inv(matrix), residual)


def _largest(cv2: Any, mask: Mask, cells: int) -> Mask | None:
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


def _tried(cv2: Any, vessel: Mask, free: Mask) -> list[tuple[float, Matrix, float]]:
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
    tried = []
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
            tried.append((float(np.minimum(laid, small).sum()) / union, matrix, 360 * turn / TURNS))
    return tried


def _refined(cv2: Any, vessel: Mask, free: Mask, matrix: Matrix) -> Matrix:
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


def _outline_distance(cv2: Any, vessel: Mask, free: Mask, matrix: Matrix) -> float:
    """Return the root mean square distance from the outline of the map to that in the picture, in
    cells.
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
    squares = []
    for one, another in (outlines, outlines[::-1]):
        away = cv2.distanceTransform((~another).astype(np.uint8), cv2.DIST_L2, 5)
        squares.append(away[one] ** 2)
    cell = abs(np.linalg.det(matrix[:2, :2])) ** 0.5
    return float(np.sqrt(np.mean(np.concatenate(squares)))) / cell


def _outline(cv2: Any, mask: NDArray[np.uint8]) -> Mask:
    eroded = cv2.erode(
        mask, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return np.asarray((mask > 0) & (eroded == 0))
