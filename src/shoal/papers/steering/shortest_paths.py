"""Paper W: shortest paths that touch a wall (section V, figures 11 and 12), and the worst case of a
square (section IV.D).
"""

from __future__ import annotations

from itertools import pairwise
from math import inf, pi, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from shoal.core.dataclass import dataclass
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.claims import claim
from shoal.papers.recipe import (
    NO_DATA,
    Outcome,
    Recipe,
    Settings,
    Table,
    function_sweep,
    measuring,
    trials_of,
    trials_table,
)
from shoal.steering import (
    ContactWorld,
    ConvexWorkspace,
    SteeringProblem,
    open_workspace,
    shortest_reflected_path,
)
from shoal.steering.delta_space import toucher_shares
from shoal.steering.run import run
from shoal.steering.workspaces.convex import Points
from shoal.views.drawing.charts import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    bare_axes,
    padded_figure,
    plain_axes,
    set_title,
)
from shoal.views.steering.figures import (
    PARTICLES,
    arrow_between,
    draw_trajectories,
    draw_workspace,
    legend_below,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes


SQUARE: ConvexWorkspace = open_workspace("square")  # type: ignore[assignment]  # it is convex
# starts, and the goal of particle 2
START, FIXED = (np.array([(0.3, 0.55), (0.6, 0.7)]), np.array((0.55, 0.3)))
WORST = sqrt(2) + 2
INSETS = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
EXAMPLE = (0.6, 0.75, 2.0)  # s, e and β of Fig. 12
_TILT = 1e-9


def shortest_crossing(start: Points, goal: Points) -> tuple[float, int, Points, bool] | None:
    """Return the shortest path of three moves in the unit square: the path's length, the toucher,
    the contact and a flag.

    The toucher (0 or 1) is the particle that touches a wall. The contact is where the straight line
    from the toucher's start to the mirror image of its goal crosses the wall. While the wall holds
    the toucher, the second move displaces the other particle. If the second move is impossible at
    this contact, the contact moves to the nearest possible point of the wall, and the flag is
    False. The result is None if no wall allows a path of three moves.
    """
    best = None
    before, after = start[1] - start[0], goal[1] - goal[0]
    corners = SQUARE.vertices
    for toucher, sign in ((0, 1.0), (1, -1.0)):
        low, high = toucher_shares(SQUARE, (sign * before, sign * after))
        for wall in range(4):
            normal, along = SQUARE.normals[wall], np.roll(corners, -1, axis=0)[wall] - corners[wall]
            if (
                not 0 <= sign * (normal @ after) <= sign * (normal @ before) > 0
                or high[wall] < low[wall]
            ):
                continue
            heights = [
                float(normal @ (point - corners[wall])) for point in (start[toucher], goal[toucher])
            ]
            ends = [
                float(along @ (point - corners[wall])) for point in (start[toucher], goal[toucher])
            ]
            ideal = (ends[0] * heights[1] + ends[1] * heights[0]) / max(sum(heights), _TILT)
            share = float(np.clip(ideal, low[wall], high[wall]))
            contact = corners[wall] + share * along
            legs = sum(
                float(np.hypot(*(contact - point))) for point in (start[toucher], goal[toucher])
            )
            length = legs + float(np.hypot(*(after - before)))
            if best is None or length < best[0]:
                best = length, toucher, contact, abs(share - ideal) < _TILT
    return best


def crossing_moves(start: Points, goal: Points, toucher: int, contact: Points) -> list[Points]:
    """Return the three moves of a path: one particle's move to the wall, an adjustment, and a
    translation to the goals.

    The adjustment displaces the other particle until the position difference of the particles
    equals the difference of the goals.
    """
    change = (goal[1] - goal[0]) - (start[1] - start[0])
    return [contact - start[toucher], change if toucher == 0 else -change, goal[toucher] - contact]


@measuring("solved", "off", "tilt", "reflected")
def crossing_check(*, seed: int) -> dict[str, float | None]:
    """Return the final error of the shortest path for a random problem, and the difference of the
    sines of its two wall angles.
    """
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(0.02, 0.98, (2, 2)), rng.uniform(0.02, 0.98, (2, 2))
    crossing = shortest_crossing(start, goal)
    if crossing is None:
        return {"solved": 0, "off": None, "tilt": None, "reflected": None}
    _, toucher, contact, reflected = crossing
    moves = crossing_moves(start, goal, toucher, contact)
    end = ContactWorld(SQUARE).play(start, moves)[-1]
    wall = int(np.argmin(SQUARE.wall_distances(contact)))
    sines = [
        float(SQUARE.normals[wall] @ (point - contact)) / float(np.hypot(*(point - contact)))
        for point in (start[toucher], goal[toucher])
    ]
    return {
        "solved": 1,
        "off": float(np.abs(end - goal).max()),
        "tilt": abs(sines[0] - sines[1]),
        "reflected": int(reflected),
    }


def _fig11(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    trials = [trial for trial in trials_of(store, sweeps[0]) if trial["solved"]]
    reflected = [trial for trial in trials if trial["reflected"]]
    claims = (
        claim(
            f"largest difference of the sines at the wall, {len(reflected)} random paths by"
            " reflection",
            "0: equal angles",
            max(t["tilt"] for t in reflected),
            within=(0, 1e-6),
            why="exact up to rounding",
        ),
        claim(
            f"largest error at the goals, {len(reflected)} paths played",
            "0: three moves deliver both",
            max(t["off"] for t in reflected),
            within=(0, 1e-6),
            why="exact up to rounding",
        ),
        claim(
            "share of problems of three moves whose shortest path is reflected",
            "1: others are invalid",
            len(reflected) / len(trials),
            within=(1, 1),
            why="a contact that is moved to where the adjustment can be made serves, too",
        ),
    )
    figure = padded_figure(9.0, 4.3)
    left, right = figure.subplots(1, 2)
    _draw_reflection(left, np.array([(0.48, 0.2), FIXED]))
    share = _draw_touchers(right, 61 if settings.quick else 161)
    table = trials_table(trials, ["trial", "off", "tilt", "reflected"])
    sentence = (
        f"Of the goals drawn {100 * share:.0f} % have no path of three moves; they are left white."
    )
    return Outcome(figure, claims, sentence, (table,), NO_DATA)


def _draw_reflection(axes: Axes, goal: Points) -> None:
    """Draw a path of three moves, and the mirror image of the touching particle's goal
    in the wall.
    """
    path = shortest_crossing(START, goal)
    assert path is not None  # this goal has a path
    _, toucher, contact, _ = path
    states = ContactWorld(SQUARE).play(START, crossing_moves(START, goal, toucher, contact))
    draw_workspace(axes, SQUARE)
    for particle, colour in enumerate(PARTICLES[:2]):
        for begin, end in pairwise(states[:, particle]):
            arrow_between(axes, begin, end, colour)
        axes.plot(
            *START[particle], "s", color=colour, ms=8, zorder=4, label=f"particle {particle + 1}"
        )
        axes.plot(*goal[particle], "o", mfc="white", mec=colour, mew=2, ms=9, zorder=4)
    wall = int(np.argmin(SQUARE.wall_distances(contact)))
    mirrored = (
        goal[toucher] - 2 * float(SQUARE.wall_distances(goal[toucher])[wall]) * SQUARE.normals[wall]
    )
    axes.plot(*np.array([contact, mirrored]).T, ":", color=MUTED, lw=1.4)
    axes.plot(*mirrored, "o", mfc="none", mec=MUTED, ms=9, label="goal, reflected")
    legend_below(axes)
    set_title(axes, "equal angles at the wall")


def _draw_touchers(axes: Axes, samples: int) -> float:
    """Draw a map that shows, for each goal of particle 1, which particle touches the wall on the
    shortest path.

    The function returns the fraction of goals for which no path of three moves exists.
    """
    from matplotlib.colors import ListedColormap

    steps = (np.arange(samples) + 0.5) / samples
    paths = [[shortest_crossing(START, np.array([(x, y), FIXED])) for x in steps] for y in steps]
    codes = np.array([[np.nan if path is None else path[1] for path in row] for row in paths])
    draw_workspace(axes, SQUARE)
    colours = ListedColormap(PARTICLES[:2])
    axes.imshow(
        codes,
        origin="lower",
        extent=(0, 1, 0, 1),
        cmap=colours,
        vmin=0,
        vmax=1,
        alpha=0.45,
        interpolation="nearest",
        zorder=1,
    )
    for particle, colour in enumerate(PARTICLES[:2]):
        axes.plot(*START[particle], "s", color=colour, mec="white", ms=8, zorder=4)
    axes.plot(*FIXED, "o", mfc="white", mec=PARTICLES[1], mew=2, ms=9, zorder=4)
    set_title(axes, "who touches first, by the goal of particle 1")
    return float(np.isnan(codes).mean())


def length_by_contact(
    theta: float | NDArray[np.float64], s: float, e: float, beta: float
) -> NDArray[np.float64]:
    """Return the length of a path from (s, 0) via the unit circle at the angle θ to e (cos β, sin
    β) (paper W, equation 9).
    """
    touch = np.exp(1j * np.asarray(theta))
    return np.asarray(np.abs(s - touch) + np.abs(e * np.exp(1j * beta) - touch))


def best_angle(s: float, e: float, beta: float) -> float:
    """Return the contact angle θ, in radians, of the shortest path via the unit circle, from a
    numerical search.
    """
    around = np.linspace(-pi, pi, 2001)
    near = around[np.argmin(length_by_contact(around, s, e, beta))]
    bounds = (near - 0.01, near + 0.01)
    minimum = minimize_scalar(
        lambda t: float(length_by_contact(t, s, e, beta)),
        bounds=bounds,
        method="bounded",
        options={"xatol": 1e-12},
    )
    return float(minimum.x)


@measuring("s", "e", "beta", "theta", "angles", "equation", "excess")
def circle_check(*, seed: int) -> dict[str, float]:
    """Return data of the shortest path between two random points S and E via the unit circle.

    The data contain the contact angle θ, the difference of the path's two angles at the contact,
    the residual of the equation for θ in paper W, and how much longer than the searched path that
    of the quartic is.
    """
    rng = np.random.default_rng(seed)
    s, e, beta = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9), rng.uniform(-3.0, 3.0)
    theta = best_angle(s, e, beta)
    touch, end = np.exp(1j * theta), e * np.exp(1j * beta)
    angles = abs(np.angle((s - touch) / -touch)) - abs(np.angle((end - touch) / -touch))
    equation = s * np.sin(theta) - e * (s * np.sin(2 * theta - beta) + np.sin(beta - theta))
    return {
        "s": s,
        "e": e,
        "beta": beta,
        "theta": theta,
        "angles": abs(float(angles)),
        "equation": abs(float(equation)),
        "excess": shortest_reflected_path((s, 0), (end.real, end.imag)).length
        - float(length_by_contact(theta, s, e, beta)),
    }


def _fig12(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    trials = trials_of(store, sweeps[0])
    simple = [
        abs(best_angle(*case)) for case in ((1.0, 0.5, 1.2), (0.5, 0.0, 0.0), (0.5, 0.7, 0.0))
    ]
    simple += [abs(best_angle(*case) - case[2]) for case in ((0.5, 1.0, 1.2), (0.0, 0.5, 1.2))]
    claims = (
        claim(
            f"largest difference of both angles at the contact, {len(trials)} random pairs",
            "0",
            max(t["angles"] for t in trials),
            within=(0, 1e-4),
            why="the search finds angles to 1e-6",
        ),
        claim(
            "largest residual of s sin θ = e (s sin(2θ-β) + sin(β-θ))",
            "0",
            max(t["equation"] for t in trials),
            within=(0, 1e-4),
            why="as above",
        ),
        claim(
            "path by the roots of the quartic less the searched path, largest difference",
            "0",
            max(abs(t["excess"]) for t in trials),
            within=(0, 1e-9),
            why="rounding",
        ),
        claim(
            "s = 1, e = 0 or β = 0: θ* = 0; e = 1 or s = 0: θ* = β; largest error",
            "0",
            max(simple),
            within=(0, 1e-4),
            why="as above",
        ),
    )
    s, e, beta = EXAMPLE
    theta = best_angle(s, e, beta)
    around = np.linspace(-pi, pi, 721)
    figure = padded_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    left.plot(np.cos(around), np.sin(around), color=INK, lw=1.6)
    points = np.array(
        [(s, 0.0), (np.cos(theta), np.sin(theta)), (e * np.cos(beta), e * np.sin(beta))]
    )
    left.plot(*points.T, "-", color=BLUE, lw=1.8)
    left.plot(*np.array([(0, 0), points[1]]).T, ":", color=MUTED, lw=1.2)
    for point, name, colour in zip(
        (*points, (0.0, 0.0)), "SPEO", (ORANGE, INK, GREEN, MUTED), strict=True
    ):
        left.plot(*point, "o", color=colour, ms=6, zorder=4)
        left.annotate(
            name, point, xytext=(7, 5), textcoords="offset points", color=colour, fontweight="bold"
        )
    bare_axes(left)
    set_title(left, "shortest path by way of the circle")
    right.plot(around, length_by_contact(around, s, e, beta), color=BLUE, lw=1.8)
    right.plot(
        theta,
        length_by_contact(theta, s, e, beta),
        "o",
        color=ORANGE,
        ms=7,
        label=f"θ* = {theta:.3f}, length {float(length_by_contact(theta, s, e, beta)):.3f}",
    )
    right.set(xlabel="contact θ, radians", ylabel="length of the path")
    right.legend(frameon=False, fontsize=9)
    plain_axes(right)
    set_title(right, f"s = {s}, e = {e}, β = {beta}")
    table = trials_table(trials, ["s", "e", "beta", "theta", "angles", "equation", "excess"])
    return Outcome(
        figure,
        claims,
        "Angles are found by a search that knows neither the law of reflection nor the equation.",
        (table,),
        NO_DATA,
    )


LONG_FOR_GREEDY = [(0.332, 0.0255), (0.3258, 0.7226)], [(0.8713, 0.9975), (0.1789, 0.0677)]
"""Starts and goals in the unit square for which algorithm 1 takes a plan longer than the printed
bound.
"""


@measuring("length", "moves")
def corner_swap(*, seed: int, planner: str, inset: float) -> dict[str, float]:
    """Return the length and the number of moves of a plan that exchanges two particles near
    opposite corners of the unit square.
    """
    corners = np.array([(inset, inset), (1 - inset, 1 - inset)])
    episode = run(SteeringProblem(SQUARE, corners, corners[::-1], planner=planner, tolerance=1e-6))
    return {"length": float(episode.length), "moves": episode.moves}


@measuring("length", "moves")
def near_walls(*, seed: int) -> dict[str, float | None]:
    """Return the length and the number of moves of algorithm 1's plan for random starts and goals,
    mostly near walls.
    """
    points = np.random.default_rng(seed).beta(0.4, 0.4, (2, 2, 2)).clip(0.001, 0.999)
    episode = run(SteeringProblem(SQUARE, points[0], points[1], planner="greedy", tolerance=1e-3))
    solved = str(episode.status) == "solved"
    return {
        "length": float(episode.length) if solved else None,
        "moves": episode.moves if solved else None,
    }


@measuring("length", "moves")
def long_for_greedy(*, seed: int) -> dict[str, float]:
    """Return the length and the number of moves of algorithm 1's plan for a problem that a search
    for long plans found.
    """
    episode = run(SteeringProblem(SQUARE, *LONG_FOR_GREEDY, planner="greedy", tolerance=1e-3))
    return {"length": float(episode.length), "moves": episode.moves}


def _swap_sweeps(settings: Settings) -> list[Sweep]:
    return [
        function_sweep(
            "w-swap.corners",
            corner_swap,
            {"planner": ["greedy", "shortest"], "inset": [*INSETS]},
            1,
            settings,
        ),
        function_sweep("w-swap.random", near_walls, {}, settings.of(400, 40), settings),
        function_sweep("w-swap.long", long_for_greedy, {}, 1, settings),
    ]


def _swap(store: Store, sweeps: list[Sweep], settings: Settings) -> Outcome:
    swaps, random_problems, long_problems = (trials_of(store, sweep) for sweep in sweeps)
    lengths = {
        name: np.array([trial["length"] for trial in swaps if trial["planner"] == name])
        for name in ("greedy", "shortest")
    }
    solved = [trial for trial in random_problems if trial["length"] is not None]
    most = max(
        trial["moves"]
        for trial in [
            *solved,
            *long_problems,
            *(swap for swap in swaps if swap["planner"] == "greedy"),
        ]
    )
    claims = (
        claim(
            f"length of the shortest plan for the swap {INSETS[-1]:g} from the corners",
            f"{WORST:.3f}: (√2+2)L",
            lengths["shortest"][-1],
            within=(0.995 * WORST, WORST),
            why="it tends to that as the corners are approached, and stays below",
        ),
        claim(
            f"longest plan of algorithm 1 for {len(solved)} random problems, all swaps and a"
            " problem that a search found",
            f"{WORST:.3f} at most",
            max(*(t["length"] for t in [*solved, *long_problems]), lengths["greedy"].max()),
            within=(-inf, WORST),
            why="one longer plan refutes it",
        ),
        claim(
            "most moves of algorithm 1",
            "5 at most",
            most,
            within=(-inf, 5),
            why="one plan of more refutes it",
        ),
    )
    figure = padded_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    corners = np.array([(0.15, 0.15), (0.85, 0.85)])
    episode = run(
        SteeringProblem(SQUARE, corners, corners[::-1], planner="shortest", tolerance=1e-6)
    )
    draw_workspace(left, SQUARE)
    draw_trajectories(left, episode)
    set_title(left, f"swap of opposite corners: length {episode.length:.2f}")
    looks = ((BLUE, 5.0), (ORANGE, 1.5))  # the second may cover the first
    for (name, values), (colour, width) in zip(lengths.items(), looks, strict=True):
        right.plot(INSETS, values, "o-", color=colour, ms=2 + width, lw=width, label=name)
    right.axhline(WORST, color=INK, lw=1.2, ls="--", label="printed: (√2+2)L")
    right.set(
        xscale="log", xlabel="distance from the walls, sides", ylabel="length of the plan, sides"
    )
    right.legend(frameon=False, fontsize=9)
    plain_axes(right)
    set_title(right, "towards the corners")
    rows = [
        [trial["planner"], trial["inset"], round(trial["length"], 5), trial["moves"]]
        for trial in swaps
    ]
    table = Table("swaps", ["planner", "distance from the walls", "length", "moves"], rows)
    data = trials_table(
        random_problems, ["trial", "length", "moves"], title="random problems by algorithm 1"
    )
    return Outcome(
        figure,
        claims,
        "The bound is the supremum of the shortest plans: no plan takes it, as starts in the"
        " corners are held. Algorithm 1 may take longer plans.",
        (table, data),
        "the paper has no figure of it",
    )


RECIPES = (
    Recipe(
        "w-fig11",
        "paper W, Fig. 11",
        "Shortest paths of three moves in a square",
        lambda s: [function_sweep("w-fig11", crossing_check, {}, s.of(2000, 300), s)],
        _fig11,
    ),
    Recipe(
        "w-fig12",
        "paper W, Fig. 12",
        "The shortest path by way of a circle",
        lambda s: [function_sweep("w-fig12", circle_check, {}, s.of(500, 50), s)],
        _fig12,
    ),
    Recipe("w-swap", "paper W, section IV.D", "The worst case of a square", _swap_sweeps, _swap),
)


# Fig. 14: starts of the particles, and goals of particle 1.
DISK_START = ((0.2, 0.2), (-0.1, -0.1))
DISK_GOALS = ((0.0, 0.0), (-0.2, 0.0))
# Fig. 16: starts, and the goal of particle 2. The paper does not print its three cases; these are
# ours.
SQUARE_CASES = (
    (((0.25, 0.25), (0.75, 0.75)), (0.5, 0.5)),
    (((0.2, 0.8), (0.3, 0.3)), (0.8, 0.2)),
    (((0.2, 0.4), (0.85, 0.5)), (0.15, 0.55)),
)


@dataclass(frozen=True, eq=False)
class GoalSweep:
    """Costs of plans for many goals of one particle, with all other settings fixed.

    Parameters
    ----------
    problem : SteeringProblem
        A problem with the workspace, the starts and the tolerance of all plans. In this problem,
        both particles have the goal of the particle whose goal does not vary.
    varied : int
        Number of the particle whose goal varies, 1 or 2.
    planner : str
    x, y : ndarray of float64, shape (n,)
        The x coordinates and the y coordinates of the goals.
    moves : ndarray of float64, shape (n, n)
        Number of moves of the plan for each y (row) and x (column) of the goal, or NaN outside the
        workspace and where no plan succeeds.
    lengths : ndarray of float64, shape (n, n)
        Length of the plan for each y (row) and x (column) of the goal, or NaN outside the workspace
        and where no plan succeeds.
    unsolved : int
        Number of goals inside the workspace without a successful plan.
    """

    problem: SteeringProblem
    varied: int
    planner: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    moves: NDArray[np.float64]
    lengths: NDArray[np.float64]
    unsolved: int


def goals(
    name: str,
    workspace: str,
    start: Any,
    fixed: Any,
    varied: int,
    settings: Settings,
    *,
    either: bool = False,
) -> Sweep:
    """Return a sweep that varies the goal of one particle over a square grid that covers the
    workspace.
    """
    samples = (
        (21 if settings.quick else 61) if workspace == "disk" else (17 if settings.quick else 41)
    )
    opened = open_workspace(workspace)
    assert isinstance(opened, ConvexWorkspace)  # named workspaces are
    low, high = (-0.5, 0.5) if opened.round else (0.0, 1.0)
    steps = [
        round(float(low + (high - low) * (2 * k + 1) / (2 * samples)), 12) for k in range(samples)
    ]
    problem = {
        "kind": "steering",
        "workspace": workspace,
        "start": [list(point) for point in start],
        "goal": [list(fixed)] * 2,
        "varied": varied,
        "planner": "greedy",
        "tolerance": 1e-3,
        "interchangeable": either,
    }
    return Sweep(
        name=f"{name}.{samples}",
        problem=problem,
        axes={"goal_y": steps, "goal_x": steps},
        seed=settings.seed,
    )


def goal_sweep(store: Store, sweep: Sweep) -> GoalSweep:
    """Read the results of a sweep over goals from a store, and return the costs for the figure."""
    problem: Any = sweep.points[0].problem
    x, y = np.array(sweep.axes["goal_x"]), np.array(sweep.axes["goal_y"])
    workspace = open_workspace(problem.workspace)
    columns = store.columns(sweep.name)
    at = {name: columns.index(name) for name in ("status", "moves", "length")}
    moves, lengths = np.full((len(x), len(x)), np.nan), np.full((len(x), len(x)), np.nan)
    unsolved = 0
    for k, row in enumerate(store.rows(sweep.name)):
        if row[at["status"]] == "solved":
            moves.flat[k], lengths.flat[k] = row[at["moves"]], row[at["length"]]
        else:
            unsolved += bool(workspace.contains((x[k % len(x)], y[k // len(x)])))
    steered = SteeringProblem(
        workspace, problem.start, problem.goal, problem.tolerance, problem.interchangeable
    )
    return GoalSweep(steered, problem.varied, problem.planner, x, y, moves, lengths, unsolved)


def goal_table(names: list[str], sweeps: list[GoalSweep]) -> Table:
    """Return a table that summarizes, for each sweep, the numbers of moves and the lengths of the
    plans to all goals.
    """
    rows = [
        [
            name,
            f"{np.nanmean(s.moves):.2f} ± {np.nanstd(s.moves):.2f}",
            int(np.nanmax(s.moves)),
            f"{np.nanmean(s.lengths):.3f} ± {np.nanstd(s.lengths):.3f}",
            f"{np.nanmax(s.lengths):.3f}",
            s.unsolved,
        ]
        for name, s in zip(names, sweeps, strict=True)
    ]
    return Table(
        "over all goals: mean ± standard deviation",
        ["", "moves", "most moves", "length", "longest", "without a plan"],
        rows,
    )


def goal_data(names: list[str], sweeps: list[GoalSweep]) -> Table:
    """Return a table of the number of moves and the length of the plan for each goal of
    each sweep.
    """
    rows = []
    for name, s in zip(names, sweeps, strict=True):
        for row, column in np.argwhere(np.isfinite(s.moves)):
            rows.append(
                [
                    name,
                    s.x[column],
                    s.y[row],
                    int(s.moves[row, column]),
                    round(float(s.lengths[row, column]), 6),
                ]
            )
    return Table("goal by goal", ["panel", "x", "y", "moves", "length"], rows, shown=False)
