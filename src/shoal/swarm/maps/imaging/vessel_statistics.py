"""Statistics of vessel networks, such as branching angles, width ratios, Murray's exponent,
tortuosity and density.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.imaging.network import CentreLines, Segment, centre_lines
from shoal.swarm.maps.imaging.segmentation import imaging_module
from shoal.swarm.maps.reading import Mask

Values = NDArray[np.float64]

# a segment is measured from this many radii of the junction's disc on, because nearer segments
# overlap
CLEAR = 1.5
REACH = 4.0  # length of the measured part, in radii of the junction's disc
# length of the measured part in pixels: the minimum, and the minimum if the segment is long enough
LEAST, SHORTEST = 3.0, 6.0
ALIKE = 0.9  # a segment of at least this fraction of the largest width may be the parent
# an end nearer to the border of the view than this fraction of the view's side is cut off, not a
# dead end
RIM = 0.02
LARGEST_EXPONENT = 50.0


@dataclass(frozen=True)
class VesselStatistics:
    """Measures of one vessel network. All lengths are in pixels of the mask.

    Parameters
    ----------
    angles : ndarray, float64, shape (k,)
        Angle in degrees between the two daughters of each measured bifurcation.
    radii : ndarray, float64, shape (k, 3)
        Radii of the parent vessel, the wider daughter vessel and the narrower daughter vessel of
        each bifurcation, in pixels.
    lengths, chords, widths : ndarray, float64, shape (s,)
        Length, distance between the two ends, and mean width of each vessel segment between two
        junctions, in pixels.
    area_density : float
        Area of the vessels divided by the area of the field of view.
    dead_ends : float
        Number of dead ends per 100 w of network length, where w is the mean vessel width. The
        number is NaN if the network is not longer than w.
    fractal_dimension : float
        Box-counting dimension of the network's centre lines.
    """

    angles: Values
    radii: Values
    lengths: Values
    chords: Values
    widths: Values
    area_density: float
    dead_ends: float
    fractal_dimension: float

    @property
    def area_ratios(self) -> Values:
        """For each bifurcation, the total cross-section of both daughter vessels divided by the
        parent vessel's cross-section.
        """
        return np.asarray((self.radii[:, 1] ** 2 + self.radii[:, 2] ** 2) / self.radii[:, 0] ** 2)

    @property
    def asymmetry(self) -> Values:
        """Radius of the narrower daughter vessel divided by the radius of the wider daughter
        vessel, for each bifurcation.
        """
        return np.asarray(self.radii[:, 2] / self.radii[:, 1])

    @property
    def exponents(self) -> Values:
        """Exponent of Murray's law for each bifurcation, computed by `murray_exponents`."""
        return murray_exponents(self.radii)

    def summary(self) -> dict[str, float]:
        """Return one number for each measure.

        The measures of bifurcations are NaN for a network without bifurcations. The measures of
        segments are NaN for a network without segments.

        The branching angle, area ratio, asymmetry and exponent are medians over all bifurcations,
        because vessels that cross or touch give outliers. The ratio of length to diameter is the
        mean over all vessel segments. The tortuosity is the total length of all segments divided by
        the total length of their chords. A chord is the straight line between the ends of a
        segment.
        """
        bifurcations = {
            "branching_angle": self.angles,
            "area_ratio": self.area_ratios,
            "asymmetry": self.asymmetry,
            "exponent": self.exponents,
        }
        some = len(self.lengths) > 0
        return {
            name: float(np.median(values)) if len(values) else float("nan")
            for name, values in bifurcations.items()
        } | {
            "length_over_diameter": (
                float(np.mean(self.lengths / self.widths)) if some else float("nan")
            ),
            "tortuosity": float(self.lengths.sum() / self.chords.sum()) if some else float("nan"),
            "area_density": self.area_density,
            "dead_ends": self.dead_ends,
            "fractal_dimension": self.fractal_dimension,
        }


def vessel_statistics(mask: ArrayLike, *, view: ArrayLike | None = None) -> VesselStatistics:
    """Measure a vessel network and return its statistics.

    Parameters
    ----------
    mask : array_like of bool, shape (H, W)
        Mask that is True on vessels: a map, or the mask of `find_vessels`.
    view : array_like of bool, shape (H, W), optional
        Mask of the field of view of a photograph. The default field of view is the convex hull of
        the vessels.

    Raises
    ------
    InvalidInputError
        Raised if the mask has no vessels, or if the mask and the view have different shapes.
    MissingExtraError
        Raised if scikit-image is not installed.

    Notes
    -----
    The centre lines of the vessels are the skeleton of the mask. The width of a vessel part is the
    part's area divided by its length. A bifurcation is a junction of three segments. The function
    measures the segments of a bifurcation outside the largest disc that fits into the junction. The
    parent vessel of a bifurcation is the widest segment. If several segments are about equally
    wide, the parent vessel is the segment for which the angle between the two other segments is
    smallest.

    Examples
    --------
    >>> import numpy as np
    >>> bar = np.zeros((9, 60), bool)
    >>> bar[3:6, 5:55] = True
    >>> round(vessel_statistics(bar, view=np.ones_like(bar)).area_density, 3)
    0.278
    """
    vessels = np.asarray(mask, dtype=np.bool_)
    if vessels.ndim != 2 or not vessels.any():
        raise InvalidInputError(
            f"expected a mask of shape (H, W) with vessels, got shape {vessels.shape} with"
            f" {vessels.sum()}"
        )
    hull = imaging_module("morphology").convex_hull_image(vessels) if view is None else view
    within = np.asarray(hull, dtype=np.bool_)
    if within.shape != vessels.shape:
        raise InvalidInputError(f"expected a view of shape {vessels.shape}, got {within.shape}")
    lines = centre_lines(vessels & within)
    branches, radii = lines.branches(), lines.radii.tolist()
    measured = [measurement for around in branches if (measurement := _bifurcation(around, radii))]
    degrees = [len(around) for around in branches]
    inner = [
        segment
        for segment in lines.segments
        if segment.nodes[0] != segment.nodes[1] and min(degrees[node] for node in segment.nodes) > 2
    ]
    covered = int((vessels & within).sum())
    length = max(1.0, sum(segment.length for segment in lines.segments))
    ends = _ends_inside(lines, np.array(degrees) == 1, within if view is not None else None)
    return VesselStatistics(
        angles=np.array([angle for angle, _ in measured]),
        radii=np.array([radii for _, radii in measured]).reshape(-1, 3),
        lengths=np.array([segment.length for segment in inner]),
        chords=np.array([np.hypot(*(segment.points[-1] - segment.points[0])) for segment in inner]),
        widths=np.array([segment.width(0, segment.length) for segment in inner]),
        area_density=float(covered / within.sum()),
        dead_ends=100 * ends * covered / length**2 if length**2 > covered else float("nan"),
        fractal_dimension=box_dimension(lines.skeleton, smallest=covered / length),
    )


def murray_exponents(radii: ArrayLike) -> Values:
    """Return, for each bifurcation, the exponent k of Murray's law ``r0**k == r1**k + r2**k``.

    Parameters
    ----------
    radii : array_like, shape (k, 3)
        Radius r0 of the parent vessel, and radii r1 and r2 of the daughter vessels, in any common
        unit.

    Returns
    -------
    ndarray, float64, shape (k,)
        Exponent of each bifurcation. The exponent is infinite if a daughter vessel is at least as
        wide as the parent vessel, or if the exponent would exceed 50.

    Examples
    --------
    >>> murray_exponents([[5, 4, 3], [2 ** (1 / 3), 1, 1], [1, 1, 1]]).round(3)
    array([ 2.,  3., inf])
    """
    all_radii = np.asarray(radii, dtype=np.float64).reshape(-1, 3)
    shares = all_radii[:, 1:] / all_radii[:, :1]
    low, high = np.zeros(len(shares)), np.full(len(shares), LARGEST_EXPONENT)
    for _ in range(50):
        middle = (low + high) / 2
        over = (shares ** middle[:, None]).sum(axis=1) > 1
        low, high = np.where(over, middle, low), np.where(over, high, middle)
    return np.where((shares.max(axis=1, initial=0) >= 1) | (high == LARGEST_EXPONENT), np.inf, high)


def box_dimension(mask: ArrayLike, *, smallest: float = 2.0) -> float:
    """Return the box-counting dimension of a mask, which is 1 for a line and 2 for an area.

    Parameters
    ----------
    mask : array_like of bool, shape (H, W)
        Mask that is True on the network.
    smallest : float
        Side of the smallest boxes, in pixels. The function doubles the side of the boxes
        repeatedly, up to a quarter of the network's larger side.

    Returns
    -------
    float
        The box-counting dimension, or NaN if the network is too small for two sizes of boxes.

    Examples
    --------
    >>> import numpy as np
    >>> round(box_dimension(np.ones((256, 256))), 2), round(box_dimension(np.eye(256)), 2)
    (2.0, 1.0)
    """
    where = np.argwhere(np.asarray(mask, dtype=np.bool_))
    extent = float(np.ptp(where, axis=0).max()) + 1 if len(where) else 0.0
    sides = smallest * 2.0 ** np.arange(max(0, int(np.log2(max(extent, 1.0) / (4 * smallest)) + 1)))
    if len(sides) < 2:
        return float("nan")
    counts = [len(np.unique((where - where.min(axis=0)) // side, axis=0)) for side in sides]
    return float(-np.polyfit(np.log(sides), np.log(counts), 1)[0])


def _bifurcation(branches: list[Segment], radii: list[float]) -> tuple[float, list[float]] | None:
    """Return the angle between the daughter vessels (degrees) and the three radii, or None if a
    branch is too short to measure.
    """
    if len(branches) != 3 or any(branch.nodes[0] == branch.nodes[1] for branch in branches):
        return None
    radius = radii[branches[0].nodes[0]]
    first, reach = CLEAR * radius, max(SHORTEST, REACH * radius)
    last = [
        min(first + reach, branch.length - CLEAR * radii[branch.nodes[1]]) for branch in branches
    ]
    if min(last) < first + LEAST:
        return None
    widths = np.array(
        [branch.width(first, end) for branch, end in zip(branches, last, strict=True)]
    )
    headings = [_heading(branch, first, end) for branch, end in zip(branches, last, strict=True)]
    angles = np.degrees(
        np.arccos(np.clip([headings[k - 2] @ headings[k - 1] for k in range(3)], -1, 1))
    )
    parent = int(np.argmin(np.where(widths >= ALIKE * widths.max(), angles, np.inf)))
    return float(angles[parent]), [
        widths[parent] / 2,
        *sorted(np.delete(widths, parent) / 2, reverse=True),
    ]


def _heading(segment: Segment, first: float, last: float) -> Values:
    """Return the unit vector from the point at length ``first`` along a segment to the point at
    length ``last``.
    """
    ends = [
        [np.interp(length, segment.along, axis) for axis in segment.points.T]
        for length in (first, last)
    ]
    step = np.subtract(ends[1], ends[0])
    return np.asarray(step / np.hypot(*step))


def _ends_inside(lines: CentreLines, ends: Mask, view: Mask | None) -> int:
    """Return the number of vessel ends inside the field of view. Ends at the border of the view do
    not count.
    """
    from scipy import ndimage

    if view is None:
        return int(ends.sum())
    depth = ndimage.distance_transform_edt(np.pad(view, 1))[1:-1, 1:-1]
    rows, columns = lines.places[ends].astype(np.int64).T
    return int((depth[rows, columns] > lines.radii[ends] + 1 + RIM * np.sqrt(view.sum())).sum())
