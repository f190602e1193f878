"""The figures of paper W as Shoal computes them: reachable sets (figures 4, 8 and 9) and costs of
plans (figures 14 to 16).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import pi
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_choice, check_integer, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import unit_vectors
from shoal.papers.steering.shortest_paths import GoalSweep
from shoal.steering.delta_space import DIRECTIONS, PolygonReach, disk_reach, polygon_reach
from shoal.steering.planners.chain_search import nearest_cycles
from shoal.steering.planners.chains import ChainQuery
from shoal.steering.workspaces.convex import ConvexWorkspace, Points, disk
from shoal.steering.workspaces.walls import normalize_walls
from shoal.views.drawing.charts import (
    BLUE,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    new_figure,
    padded_figure,
    plain_axes,
    set_title,
)
from shoal.views.steering.figures import PARTICLES, REACH_COLOURS, draw_workspace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Toucher = Literal["nearer", "second"]


@dataclass(frozen=True, eq=False)
class AntipodeSwap:
    """The approach of two particles on a disk to antipodal (opposite) goals, cycle by cycle.

    In a cycle, the first move brings one particle to the wall (contact), and the second move moves
    the other particle (adjustment).

    Parameters
    ----------
    toucher : str
        "second": particle 2 touches the wall in all cycles. "nearer": in each cycle, the particle
        that is nearer to its possible contact touches the wall.
    start, goal : ndarray of float64, shape (2, 2)
    moves : ndarray of float64, shape (2 cycles, 2)
        The moves of the plan, in which contacts and adjustments alternate.
    lengths : ndarray of float64, shape (cycles,)
        For each cycle, the length of the plan that ends after this cycle, including the final
        translation, in diameters of the disk.
    errors : ndarray of float64, shape (cycles,)
        The error δ after each cycle: the remaining distance of each particle from its goal after
        the final translation, in diameters of the disk.
    """

    toucher: Toucher
    start: Points
    goal: Points
    moves: Points
    lengths: NDArray[np.float64]
    errors: NDArray[np.float64]

    def law(self, *, below: float = 0.25) -> tuple[float, float]:
        """Return the constants a and b of the law error = a / length^b.

        The method fits the law as a straight line in logarithms, to all errors smaller than
        ``below``.

        Raises
        ------
        InvalidInputError
            If fewer than two errors are smaller than ``below``.
        """
        low = self.errors < below
        if np.count_nonzero(low) < 2:
            raise InvalidInputError(
                f"law: expected two errors or more below {below:g}, got {np.count_nonzero(low)}"
            )
        slope, level = np.polyfit(np.log(self.lengths[low]), np.log(self.errors[low]), 1)
        return float(np.exp(level)), -float(slope)

    def length_to(self, error: float) -> float:
        """Return the length of the shortest plan whose error is at most ``error``, or NaN if every
        plan has a larger error.
        """
        near = self.lengths[self.errors <= error]
        return float(near.min()) if near.size else np.nan


def swap_antipodes(
    *, toucher: Toucher = "nearer", cycles: int = 60, apart: float = 0.8, turn: float = 0.0
) -> AntipodeSwap:
    """Return the approach of two particles on a disk of diameter 1 to antipodal (opposite) goals,
    with algorithm 1 of paper W.

    Each cycle brings the position difference Δ of the particles as near as possible to the position
    difference of the goals. If the initial Δ had the length of one diameter and pointed exactly
    opposite to the difference of the goals, the nearest reachable difference would be Δ = 0. No
    move changes a position difference of zero. To avoid a position difference of zero, the
    particles start less than one diameter apart.

    Parameters
    ----------
    toucher : str
        The particle that touches the wall: "nearer" (the particle nearer to its contact) or
        "second" (always particle 2). The choice of the touching particle does not change the
        position differences.
    cycles : int
        Number of cycles (contact and adjustment), at least 1.
    apart : float
        Initial distance of the particles in diameters of the disk, above 0 and below 1. Both
        particles start equally far from the centre of the disk.
    turn : float
        Angle, in radians, between the initial position difference and the line through the goals.
        With the angle 0, the particles exchange sides.

    Notes
    -----
    Source: figure 15 in section VI of paper W.

    Examples
    --------
    >>> [round(swap_antipodes(toucher=who).length_to(0.01), 1) for who in ("second", "nearer")]
    [9.3, 4.4]
    """
    check_choice(toucher, what="toucher", choices=("nearer", "second"))
    check_integer(cycles, what="cycles", least=1)
    check_number(apart, what="apart", above=0, below=1)
    radius = 0.5
    ahead = apart / 2 * unit_vectors(turn)
    query = ChainQuery(
        normalize_walls(disk(radius)),
        np.stack([-ahead, ahead]),
        np.array([[radius, 0.0], [-radius, 0.0]]),
    )
    state, moves, lengths, errors = query.start, [], [], []
    for _ in range(cycles):
        # Δ is not zero, so some contact is possible
        cycle = nearest_cycles(query, state[1] - state[0], query.after)[0]
        delta = cycle.after
        who, contact = _contact(state, cycle.low / radius, radius, toucher)
        moves += [contact - state[who], (delta - (state[1] - state[0])) * (1 if who == 0 else -1)]
        state = np.stack([contact, contact + delta] if who == 0 else [contact - delta, contact])
        offsets = query.goal - state
        lengths.append(
            float(np.linalg.norm(moves, axis=1).sum() + np.linalg.norm(offsets.mean(axis=0)))
        )
        errors.append(float(np.linalg.norm(offsets[1] - offsets[0]) / 2))
    return AntipodeSwap(
        toucher, query.start, query.goal, np.array(moves), np.array(lengths), np.array(errors)
    )


def _contact(state: Points, angle: float, radius: float, toucher: Toucher) -> tuple[int, Points]:
    """Return the index of the touching particle, counted from 0, and the point at which this
    particle touches the wall.

    Particle 0 touches the wall at the angle ``angle``, and particle 1 touches the wall at the
    opposite point.
    """
    places = radius * np.array([[np.cos(angle + turn), np.sin(angle + turn)] for turn in (0.0, pi)])
    who = 1 if toucher == "second" else int(np.argmin(np.linalg.norm(places - state, axis=1)))
    return who, places[who]


FULL = 1 - 1e-6  # fraction of the area that counts as complete
_LEVEL = 1e-12


@dataclass(frozen=True, eq=False)
class DiskFractions:
    """Fraction of all position differences that two particles on a disk can reach, for each initial
    distance of the particles.

    Parameters
    ----------
    distances : ndarray of float64, shape (n,)
        Initial distances of the particles in diameters of the disk.
    moves : ndarray of int64, shape (k,)
        Numbers of moves: 2, 4, 6, ...
    fractions : ndarray of float64, shape (n, k)
        Reached fraction of the area of the Δ configuration space (all position differences), for
        each initial distance (row) and number of moves (column).
    """

    distances: NDArray[np.float64]
    moves: NDArray[np.int64]
    fractions: NDArray[np.float64]


def disk_fractions(
    distances: ArrayLike, *, moves: int = 14, directions: int = DIRECTIONS
) -> DiskFractions:
    """Return the fraction of all position differences that 2, 4, ..., ``moves`` moves reach on a
    disk.

    Parameters
    ----------
    distances : array_like of float, shape (n,)
        Initial distances of the particles in diameters of the disk, above 0 and at most 1.
    moves, directions : int
        Number of moves and number of sampled directions, as in `disk_reach`.

    Examples
    --------
    >>> (100 * disk_fractions([0.1], moves=6).fractions).round(1).tolist()
    [[6.3, 30.1, 55.8]]
    """
    values = np.atleast_1d(np.asarray(distances, dtype=np.float64))
    if not values.size:
        raise InvalidInputError("distances: expected at least one distance, got none")
    table = [
        [reach.fraction() for reach in disk_reach(float(d), moves=moves, directions=directions)]
        for d in values
    ]
    return DiskFractions(values, 2 * np.arange(1, moves // 2 + 1), np.array(table))


def largest_two_move_fraction() -> tuple[float, float]:
    """Return the initial distance from which two moves on a disk reach the largest fraction of
    position differences.

    The second returned value is this fraction.

    Notes
    -----
    The initial distance is in diameters of the disk. Section IV.F of paper W gives the fraction
    0.373 at an initial distance of about 0.81 diameters.

    Examples
    --------
    >>> distance, fraction = largest_two_move_fraction()
    >>> round(distance, 2), round(fraction, 3)
    (0.82, 0.377)
    """
    from scipy.optimize import minimize_scalar

    minimum = minimize_scalar(
        lambda d: -disk_reach(float(d), moves=2)[0].fraction(), bounds=(0.5, 0.99), method="bounded"
    )
    return float(minimum.x), -float(minimum.fun)


@dataclass(frozen=True, eq=False)
class PolygonFractions:
    """Growth of the set of reachable position differences on a polygon, from one start.

    Parameters
    ----------
    workspace : ConvexWorkspace
    before : ndarray of float64, shape (2,)
        The position difference Δ at the start.
    sets : list of PolygonReach
        The sets of position differences that the particles can reach after 2, 4, 6, ... moves.
    """

    workspace: ConvexWorkspace
    before: Points
    sets: list[PolygonReach]

    @cached_property
    def fractions(self) -> NDArray[np.float64]:
        """The area of each reachable set divided by the area of all position differences; float64,
        shape (sets,).
        """
        return np.array([reach.fraction() for reach in self.sets])

    @property
    def moves(self) -> int | None:
        """The smallest number of moves to reach the fraction `FULL` of all position differences, or
        None if no set is so large.
        """
        full = np.flatnonzero(self.fractions >= FULL)
        return self.sets[full[0]].moves if full.size else None


def polygon_fractions(
    workspace: ConvexWorkspace, before: ArrayLike, *, moves: int = 8, contacts: int = 512
) -> PolygonFractions:
    """Return the sets of position differences that two particles in a polygon reach in 2, 4, ...,
    ``moves`` moves.

    Parameters
    ----------
    workspace, before, moves, contacts
        The polygon, the position difference at the start, the number of moves, and the number of
        sample points on the boundary, as in `polygon_reach`.

    Notes
    -----
    Source: paper W, section IV.D and figure 4.

    Examples
    --------
    >>> from shoal.steering import regular_polygon
    >>> polygon_fractions(regular_polygon(6), (0.2, 0.1)).moves
    6
    """
    sets = polygon_reach(workspace, before, moves=moves, contacts=contacts)
    return PolygonFractions(workspace, sets[0].before, sets)


def border_point(space: ConvexWorkspace, ahead: ArrayLike) -> Points:
    """Return the point at which a ray from the origin leaves a workspace that contains the origin;
    float64, shape (2,).
    """
    unit = np.asarray(ahead, dtype=np.float64)
    rates = space.normals @ unit
    towards = rates < -_LEVEL
    return np.asarray(np.min(space.offsets[towards] / rates[towards]) * unit)


# Values printed in the paper (sections IV.F and VI), in %, for comparison with the computed ones.
PRINTED_FRACTIONS: Mapping[float, Mapping[int, str]] = {
    0.1: {2: "6.3", 4: "30", 6: "55", 8: "75", 10: "86", 12: "93", 14: "96"},
    0.001: {14: "90"},
    0.81: {2: "37.3"},
}
PRINTED_LAW = (8.66, 3)
EXAMPLES = (0.1, 0.3)  # distances of Fig. 9, marked in Fig. 8


def reachable_sets(fillings: Sequence[PolygonFractions]) -> Figure:
    """Return a figure of workspaces, each beside the sets of position differences that 2, 4, ...
    moves reach (paper W, figure 4).

    Raises
    ------
    InvalidInputError
        If ``fillings`` is empty.
    """
    if not fillings:
        raise InvalidInputError("reachable sets: expected at least one polygon, got none")
    rows = (len(fillings) + 1) // 2
    figure = padded_figure(10.4, 2.75 * rows + 0.6)
    grid = figure.subplots(
        rows,
        4 if len(fillings) > 1 else 2,
        squeeze=False,
        width_ratios=[2, 3] * min(2, len(fillings)),
    )
    panels = grid.reshape(-1, 2)
    for (left, right), filling in zip(panels, fillings, strict=False):
        _draw_start(left, filling)
        _draw_outlines(
            right, filling.workspace.differences.vertices, [reach.outline for reach in filling.sets]
        )
        right.plot(*filling.before, "s", color=ORANGE, ms=5, mec="white", mew=0.6, zorder=5)
        full = next(
            (k for k, reach in enumerate(filling.sets) if reach.moves == filling.moves),
            len(filling.sets) - 1,
        )
        shares = ", ".join(_percent(share) for share in filling.fractions[: full + 1])
        right.set_title(f"{shares} %", fontsize=9, color=INK, loc="center")
        left.set_title(
            f"{len(filling.workspace.vertices)} sides",
            fontsize=9,
            color=INK,
            loc="center",
            fontweight="bold",
            y=1.0,
        )
    for axes in panels[len(fillings) :].ravel():
        axes.set_axis_off()
    moves = [reach.moves for reach in max(fillings, key=lambda filling: len(filling.sets)).sets]
    _colour_key(figure, moves)
    return figure


def _percent(share: float) -> str:
    """Return a fraction as a text in percent. The text is "100" only for the fraction 1 (within
    1e-6).
    """
    return f"{min(100 * share, 99.9):.1f}" if share < 1 - 1e-6 else "100"


def _draw_start(axes: Axes, filling: PolygonFractions) -> None:
    draw_workspace(axes, filling.workspace)
    axes.set_axis_off()
    middle = filling.workspace.center
    for point, colour in zip(
        (middle - filling.before / 2, middle + filling.before / 2), PARTICLES, strict=False
    ):
        axes.plot(*point, "s", color=colour, ms=6, zorder=4)


def _draw_outlines(
    axes: Axes, border: NDArray[np.float64], outlines: Sequence[NDArray[np.float64]]
) -> None:
    """Draw the outlines of several sets inside the border of all position differences, the smallest
    set on top.
    """
    axes.fill(*border.T, facecolor="#f7f8fa", edgecolor="none", zorder=0)
    for k, outline in reversed([*enumerate(outlines)]):
        axes.fill(
            *outline.T,
            facecolor=REACH_COLOURS[k % len(REACH_COLOURS)],
            edgecolor="white",
            lw=0.3,
            zorder=1,
        )
    axes.fill(*border.T, facecolor="none", edgecolor=INK, lw=1.4, zorder=2)
    axes.set_aspect("equal")
    axes.set_axis_off()


def _colour_key(figure: Figure, moves: Sequence[int]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    keys: list[Patch | Line2D] = [
        Patch(facecolor=REACH_COLOURS[k % len(REACH_COLOURS)], label=f"{number} moves")
        for k, number in enumerate(moves)
    ]
    keys.append(Line2D([], [], marker="s", ls="", color=ORANGE, label="Δ at the start"))
    columns = len(keys) if len(keys) <= 5 else (len(keys) + 1) // 2
    figure.legend(
        handles=keys,
        loc="outside lower center",
        ncols=columns,
        frameon=False,
        labelcolor=INK,
        fontsize=9,
    )


def disk_sets(distances: Sequence[float] = EXAMPLES, *, moves: int = 14) -> Figure:
    """Return a figure of the sets of position differences that 2, 4, ..., ``moves`` moves reach on
    a disk (paper W, figure 9).

    The parameter ``distances`` contains the initial distances of the particles, in diameters of the
    disk.

    Raises
    ------
    InvalidInputError
        If a distance is 0 or less, or more than 1.
    """
    figure = padded_figure(4.2 * len(distances), 5.0)
    angles = np.linspace(0, 2 * np.pi, 361)
    border = unit_vectors(angles)
    for axes, distance in zip(
        figure.subplots(1, len(distances), squeeze=False)[0], distances, strict=True
    ):
        _draw_outlines(axes, border, [reach.outline for reach in disk_reach(distance, moves=moves)])
        axes.plot(distance, 0, "s", color=ORANGE, ms=6, mec="white", mew=0.6, zorder=5)
        set_title(axes, f"{distance:g} diameters apart")
    _colour_key(figure, range(2, moves + 1, 2))
    return figure


def fraction_curves(data: DiskFractions) -> Figure:
    """Return a figure of the fraction of all position differences that moves reach on a disk, drawn
    against the initial distance.

    The figure corresponds to figure 8 of paper W. Circles mark the numbers that paper W prints.
    Vertical lines mark the initial distances of figure 9 of paper W.
    """
    from matplotlib import colormaps

    figure = new_figure(7.8, 4.6)
    axes = figure.add_subplot()
    colours = colormaps["viridis"](np.linspace(0, 0.86, len(data.moves)))
    for moves, shares, colour in reversed(
        [*zip(data.moves, data.fractions.T, colours, strict=True)]
    ):
        axes.plot(
            data.distances, 100 * shares, color=colour, lw=1.8, zorder=3, label=f"{moves} moves"
        )
    for distance in EXAMPLES:
        axes.axvline(distance, color=ORANGE, lw=1.0, zorder=1)
    printed = [
        (d, float(share))
        for d, shares in PRINTED_FRACTIONS.items()
        for n, share in shares.items()
        if n in data.moves
    ]
    axes.plot(
        *np.array(printed).reshape(-1, 2).T,
        "o",
        mfc="white",
        mec=INK,
        ms=5,
        label="printed",
        zorder=4,
        clip_on=False,
    )
    distance, most = largest_two_move_fraction()
    axes.plot(
        distance,
        100 * most,
        "D",
        color=PURPLE,
        ms=5,
        zorder=5,
        label=f"most in two\nmoves: {100 * most:.1f} %\nat {distance:.2f}",
    )
    axes.set(
        xlabel="distance at the start, diameters",
        ylabel="reached, % of all differences",
        xlim=(0, 1),
        ylim=(0, 101),
    )
    axes.legend(
        frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1.0, 0.5), labelcolor=INK
    )
    set_title(axes, "What moves reach on a disk")
    plain_axes(axes)
    return figure


def goal_maps(rows: Sequence[Sequence[tuple[GoalSweep, str]]]) -> Figure:
    """Return a figure with maps of the costs of plans for many goals of one particle (paper W,
    figures 14 and 16).

    Parameters
    ----------
    rows : sequence of sequences of (GoalSweep, "moves" or "length")
        The data and the quantity ("moves" or "length") of each panel. All panels of lengths share
        one colour scale, and all panels of numbers of moves share another colour scale.

    Raises
    ------
    InvalidInputError
        If ``rows`` is empty, if the rows differ in length, or if the quantity of a panel is neither
        "moves" nor "length".
    """
    if not rows or not rows[0] or len({len(row) for row in rows}) != 1:
        raise InvalidInputError("goal maps: expected rows of equal length with at least one panel")
    panels = [panel for row in rows for panel in row]
    scales = {
        quantity: _Scale([sweep for sweep, shown in panels if shown == quantity], quantity)
        for quantity in dict.fromkeys(quantity for _, quantity in panels)
    }
    columns = len(rows[0])
    figure = padded_figure(3.2 * columns + 0.9, 3.05 * len(rows))
    grid = figure.subplots(len(rows), columns, squeeze=False)
    for axes, (sweep, quantity) in zip(grid.ravel(), panels, strict=True):
        scales[quantity].draw(axes, sweep)
    for axes in grid[-1]:
        axes.set_xlabel(f"x of the goal of particle {panels[0][0].varied}", color=INK, fontsize=9)
    for axes in grid[:, 0]:
        axes.set_ylabel("y of that goal", color=INK, fontsize=9)
    shown = np.array([[quantity for _, quantity in row] for row in rows])
    by_row = bool((shown == shown[:, :1]).all())
    for group, quantity in zip(
        grid if by_row else grid.T, shown[:, 0] if by_row else shown[0], strict=True
    ):
        _draw_bar(figure, [*group], scales[str(quantity)])
    figure.legend(
        handles=_goal_key(panels[0][0]),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        labelcolor=INK,
        fontsize=9,
    )
    return figure


def _draw_bar(figure: Figure, on: list[Axes], scale: _Scale) -> None:
    bar = figure.colorbar(
        scale.image,
        ax=on,
        shrink=0.9 if len(on) > 1 else 0.8,
        pad=0.02,
        aspect=18,
        ticks=scale.ticks,
    )
    bar.set_label({"moves": "moves", "length": "length of the plan"}[scale.quantity], color=INK)
    bar.outline.set_visible(False)
    bar.minorticks_off()
    bar.ax.tick_params(length=0, labelcolor=INK, labelsize=8)


class _Scale:
    """The common colour scale of all panels that show the same quantity."""

    def __init__(self, sweeps: Sequence[GoalSweep], quantity: str) -> None:
        if quantity not in {"moves", "length"}:
            raise InvalidInputError(f'goal maps: expected "moves" or "length", got {quantity!r}')
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import BoundaryNorm, Normalize

        self.quantity = quantity
        values = np.concatenate([self.values(sweep).ravel() for sweep in sweeps])
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        if quantity == "moves":
            edges = np.arange(np.floor(low), high + 2) - 0.5
            self.norm: Normalize = BoundaryNorm(edges, 256)
            self.ticks: list[float] | None = [float(tick) for tick in edges[:-1] + 0.5]
            self.levels = edges
        else:
            self.norm, self.ticks = Normalize(0, high), None
            self.levels = np.arange(0.25, high, 0.25)
        self.colours = colormaps["viridis_r" if quantity == "length" else "cividis_r"]
        self.image = ScalarMappable(self.norm, self.colours)

    def values(self, sweep: GoalSweep) -> NDArray[np.float64]:
        """Return the values of a sweep that the scale shows: the numbers of moves, or the lengths
        of the plans.
        """
        return sweep.moves if self.quantity == "moves" else sweep.lengths

    def draw(self, axes: Axes, sweep: GoalSweep) -> None:
        """Draw one panel of a figure: the map of costs, contour lines for lengths, the starts and
        the fixed goal.
        """
        values, problem = self.values(sweep), sweep.problem
        half = (sweep.x[1] - sweep.x[0]) / 2, (sweep.y[1] - sweep.y[0]) / 2
        extent = (
            sweep.x[0] - half[0],
            sweep.x[-1] + half[0],
            sweep.y[0] - half[1],
            sweep.y[-1] + half[1],
        )
        draw_workspace(axes, problem.place)
        border, limits = axes.patches[0], (axes.get_xlim(), axes.get_ylim())
        border.set(facecolor="none", zorder=3)
        image = axes.imshow(
            _up_to_the_wall(sweep, values),
            origin="lower",
            extent=extent,
            cmap=self.colours,
            norm=self.norm,
            interpolation="nearest",
            zorder=1,
        )
        image.set_clip_path(border)
        axes.set(xlim=limits[0], ylim=limits[1])
        if self.quantity == "length":
            axes.contour(
                sweep.x,
                sweep.y,
                values,
                levels=self.levels,
                colors="white",
                linewidths=0.5,
                alpha=0.7,
                zorder=2,
            )
        for point, colour in zip(problem.start, PARTICLES, strict=False):
            axes.plot(*point, "s", color=colour, mec="white", mew=1, ms=7, zorder=5)
        fixed = 2 - sweep.varied
        axes.plot(
            *problem.goal[fixed], "o", mfc="white", mec=PARTICLES[fixed], mew=2, ms=7, zorder=5
        )
        either = ", interchangeable" if problem.interchangeable else ""
        set_title(axes, f"{self.quantity} ≤ {np.nanmax(values):.3g}{either}")


def _up_to_the_wall(sweep: GoalSweep, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``values`` in which each cell outside the workspace has the value of the nearest cell
    inside the workspace.
    """
    from scipy.ndimage import distance_transform_edt

    outside = ~sweep.problem.place.contains(np.stack(np.meshgrid(sweep.x, sweep.y), axis=-1))
    row, column = distance_transform_edt(outside, return_distances=False, return_indices=True)
    return np.asarray(values[row, column])


def _goal_key(sweep: GoalSweep) -> list[object]:
    from matplotlib.lines import Line2D

    fixed = 2 - sweep.varied
    starts: list[object] = [
        Line2D([], [], marker="s", ls="", color=colour, label=f"particle {k + 1} at the start")
        for k, colour in zip(range(2), PARTICLES, strict=False)
    ]
    goal = Line2D(
        [],
        [],
        marker="o",
        ls="",
        mfc="white",
        mec=PARTICLES[fixed],
        mew=2,
        label=f"goal of particle {fixed + 1}",
    )
    return [*starts, goal]


def antipode_errors(
    second: AntipodeSwap, nearer: AntipodeSwap, *others: tuple[AntipodeSwap, str]
) -> Figure:
    """Return a figure of the final distance from antipodal goals, drawn against the length of the
    plan (paper W, figure 15).

    Parameters
    ----------
    second, nearer : AntipodeSwap
        Two approaches to antipodal goals: ``second``, in which particle 2 always touches the wall
        (as in paper W), and ``nearer``, in which the nearer particle touches the wall.
    *others : (AntipodeSwap, str)
        Additional approaches to antipodal goals, each with its name in the figure.
    """
    figure = new_figure(7.6, 4.4)
    axes = figure.add_subplot()
    coefficient, exponent = second.law()
    curves = [
        (
            second,
            ORANGE,
            f"particle 2 always touches: about {coefficient:.3g} / length^{exponent:.2g}",
        ),
        (nearer, BLUE, "the nearer particle touches"),
        *(
            (swap, colour, name)
            for (swap, name), colour in zip(others, (PURPLE, SKY), strict=False)
        ),
    ]
    for swap, colour, name in curves:
        axes.plot(
            swap.lengths, swap.errors, "o-", color=colour, lw=1.3, ms=3.2, label=name, zorder=3
        )
    high = float(second.lengths.max())
    lengths = np.linspace((PRINTED_LAW[0] / 0.5) ** (1 / PRINTED_LAW[1]), high, 200)
    axes.plot(
        lengths,
        PRINTED_LAW[0] / lengths ** PRINTED_LAW[1],
        "--",
        color=INK,
        lw=1.2,
        label="printed: 8.66 / length³",
        zorder=2,
    )
    axes.axhline(0.01, color=MUTED, lw=0.9, ls=":", zorder=1)
    for swap, colour, _ in curves:
        at = swap.length_to(0.01)
        axes.annotate(
            f"{at:.1f}",
            (at, 0.01),
            xytext=(3, 6),
            textcoords="offset points",
            color=colour,
            fontsize=9,
            fontweight="bold",
        )
    axes.set(
        xlabel="length of the plan, diameters",
        ylabel="distance to the goals δ, diameters",
        yscale="log",
        xlim=(0, None),
    )
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    set_title(axes, "Goals at antipodes of a disk")
    plain_axes(axes)
    return figure
