"""Proofs that no plan is shorter than a bound: the search for them, and their checker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from itertools import count
from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np

from shoal.core.checks import check_integer, check_kind, check_number
from shoal.core.dataclass import dataclass
from shoal.core.episode import Verification
from shoal.core.errors import InvalidInputError, ShoalError, import_extra
from shoal.core.version import count_processors
from shoal.steering.certificates.geodesics import geodesic_bound
from shoal.steering.certificates.verdict import KIND, check_certificate
from shoal.steering.episode import SteeringEpisode
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex import Points

if TYPE_CHECKING:
    from shoal.steering.certificates.search import PatternTree
    from shoal.steering.planners.task import SteeringTask

CERTIFIED = 1e-3
"""Largest gap of a certified plan."""
FOR_MOVES = 0.1
"""Share of the time of a search that is left for the number of moves."""
FOR_WIDER = 0.5
"""Largest share of the time of a search in a disk for plans, before the search for a bound."""
MOST_WORKERS = 8
"""Largest default number of threads; beside more, the search for patterns would wait for Python's lock."""
FOR_PLANS = 0.3
"""Share of the time of a search with obstacles that is left for other plans, if there is a gap."""
_ENOUGH = 1e-4  # gap at which the search ends
_SLACK = 1e-9  # relative: what rounding errors may take from a bound
_REFUTED = 1e-6  # relative: a bound that is so far above a plan is wrong


@dataclass(frozen=True, eq=False)
class Certificate:
    """A lower bound on the length of all plans, with its proof.

    Parameters
    ----------
    episode : SteeringEpisode
        The plan: that of the given episode, or a shorter one if the search found one.
    lower_bound : float
        No plan is shorter, in the unit of the workspace.
    proof : dict or None
        JSON object for `check_certificate`; None if the bound has no proof tree.
    moves_lower_bound : int
        No plan has fewer moves. The proof is part of ``proof``; without it, this is at most 1.
    bound : str
        What ``lower_bound`` is: "certificate", proven by ``proof``; "shortest", the bound of the
        planner `Shortest`, if it is greater or there is no proof; or "shortest paths" of one or two
        particles.
    """

    episode: SteeringEpisode
    lower_bound: float
    proof: dict[str, Any] | None
    moves_lower_bound: int
    bound: str

    @property
    def gap(self) -> float | None:
        """How much longer than the lower bound the plan is, relative; None without a plan."""
        if not self.episode or not self.lower_bound:
            return 0.0 if self.episode and not self.episode.length else None
        return max(self.episode.length / self.lower_bound - 1, 0.0)

    @property
    def certified(self) -> bool:
        """Whether a proof that was checked shows that no plan is more than 0.1 % shorter."""
        length = self.episode.length if self.episode else inf
        proven = 0.0 if self.proof is None else self.proof["lower_bound"]
        return not length or length <= proven * (1 + CERTIFIED)

    @property
    def sentence(self) -> str:
        """One sentence about the bound and the gap."""
        moves = ""
        if self.moves_lower_bound > 1:
            moves = f"; no plan has fewer than {self.moves_lower_bound} moves"
        if self.gap is None:
            return f"no plan is shorter than {self.lower_bound:.6g}{moves}"
        source = {
            "certificate": "a proof that was checked",
            "shortest": "the bound of the planner shortest",
            "shortest paths": "the shortest paths of one or two particles",
        }[self.bound]
        less = ""
        if self.proof is not None and self.bound != "certificate":
            less = f"; the proof that was checked shows {self.proof['lower_bound']:.6g}"
        return (
            f"at most {100 * self.gap:.3g} % longer than the shortest plan, by {source}"
            f" (lower bound {self.lower_bound:.6g}{less}){moves}"
        )

    def report(self) -> dict[str, Any]:
        """Return the JSON object that ``shoal steer --certify`` prints."""
        return self.episode.report() | {
            "lower_bound": self.lower_bound,
            "bound": self.bound,
            "moves_lower_bound": self.moves_lower_bound,
            "gap": self.gap,
            "certified": self.certified,
            "certificate": None,
        }


def certify(
    episode: SteeringEpisode,
    *,
    seconds: float = 60.0,
    progress: Callable[[float, float], None] | None = None,
    clock: Callable[[], float] = monotonic,
    workers: int | None = None,
) -> Certificate:
    """Return a lower bound on the length of all plans for the problem of an episode, and its proof.

    Parameters
    ----------
    episode : SteeringEpisode
        The plan whose gap is wanted.
    seconds : float
        Time of the search, which also ends at a gap of 0.01 %.
    progress : callable, optional
        Called about once in a second with the seconds so far and the lower bound.
    clock : callable, optional
        Returns the seconds that ``seconds`` limits, in every part of the search; `time.process_time`
        counts the time of the processor, so that a busy computer changes nothing.
    workers : int, optional
        Threads that look for potentials at round walls; by default one for each processor,
        but at most 8.

    Raises
    ------
    InvalidInputError
        If the problem has noise, an uneven field or stated errors: its plans have no least length.
    MissingExtraError
        If the search needs Clarabel, and it is not installed (``pip install 'shoal[certify]'``).

    Examples
    --------
    >>> from shoal.steering import SteeringProblem, certify
    >>> from shoal.steering.run import run
    >>> problem = SteeringProblem("square", [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)])
    >>> certificate = certify(run(problem), seconds=20)
    >>> certificate.certified, round(certificate.lower_bound, 3)
    (True, 1.709)
    """
    problem = check_kind(episode, SteeringEpisode, what="episode").problem
    check_certifiable(problem, seconds)
    if workers is not None:
        check_integer(workers, what="workers", least=1)
    workers = min(count_processors(), MOST_WORKERS) if workers is None else workers
    place = problem.place
    start, goal = problem.endpoints(episode.seed)
    # with more particles, there is no proof
    orders: Sequence[tuple[int, ...]] = [(0, 1), (1, 0)] if problem.interchangeable else [(0, 1)]
    by_moves = getattr(problem.chosen_planner, "prefers", "length") == "moves"
    begun = reported = clock()
    if episode and has_proof(problem) and not by_moves:
        episode = _plan_wider(episode, orders, FOR_WIDER * seconds, clock)
    limit = episode.length
    ends = [goal[list(order)] for order in orders]
    least_moves = int(_is_away(problem, start, goal))
    pool = ThreadPoolExecutor(workers)
    searches, more = (
        _searches(problem, start, ends, limit, pool, workers)
        if (episode and has_proof(problem))
        else ([], {})
    )
    bound_of_planner = episode.lower_bound or 0.0
    if not searches:
        bounds = {
            "shortest": bound_of_planner,
            "shortest paths": geodesic_bound(problem, start, goal),
        }
        return _with_bound(episode, bounds, None, least_moves)
    shares = {"polygon": 1 - FOR_MOVES, "region": 1 - FOR_PLANS}
    for_length = seconds * shares.get(place.kind, 1.0)
    try:
        while (now := clock()) - begun < for_length:
            search = min(searches, key=lambda search: search.lower)
            least = search.lower
            if least * (1 + _ENOUGH) >= min(search.upper for search in searches):
                break
            search.step(clock)
            if progress is not None and now - reported > 1:
                reported = now
                progress(now - begun, least)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    bound = max(min(search.lower for search in searches) * (1 - _SLACK), 0.0)
    proof = {
        "kind": KIND,
        **_statement(problem, start, goal),
        **more,
        "limit": limit,
        "unit": searches[0].relaxation.scale,
        "lower_bound": bound,
        "trees": [
            {"order": [k + 1 for k in order], "proof": search.proof(bound)}
            for order, search in zip(orders, searches, strict=True)
        ],
    }
    if place.kind == "polygon":
        # of plans with as few moves as possible, the given one may have more
        end = clock() + FOR_MOVES * seconds
        least_moves, proofs = _least_moves(
            problem, start, ends, episode.moves, lambda: clock() >= end
        )
        if proofs:
            stated = [
                {"order": [k + 1 for k in order], "proof": moves_proof}
                for order, moves_proof in zip(orders, proofs, strict=True)
            ]
            proof["moves"] = {"lower_bound": least_moves, "proofs": stated}
    if not (checked := check_certificate(proof)):
        raise ShoalError(
            f"the search made a wrong certificate; please report it: {checked.message}"
        )
    order, search = min(zip(orders, searches, strict=True), key=lambda pair: pair[1].upper)
    if place.kind == "polygon" and not by_moves:
        episode = _shorten(episode, order, search.shortest)
    if place.kind == "prism" and not by_moves and search.upper * (1 + CERTIFIED) < episode.length:
        episode = plan_with_holds(episode, order, search.shortest or ())
    if place.kind == "region" and not by_moves and episode.length > bound * (1 + _ENOUGH):
        episode = _plan_again(episode, orders, begun + seconds, clock)
    return _with_bound(
        episode, {"certificate": bound, "shortest": bound_of_planner}, proof, least_moves
    )


def _with_bound(
    episode: SteeringEpisode,
    bounds: dict[str, float],
    proof: dict[str, Any] | None,
    least_moves: int,
) -> Certificate:
    """Return a certificate with the greatest of some bounds; with the first of equal ones.

    Raises
    ------
    ShoalError
        If a bound is above the length of the plan, which refutes the bound.
    """
    name = max(bounds, key=lambda source: bounds[source])
    least = bounds[name]
    # bounds of planners are for plans to the goals themselves
    allowed = 4 * episode.problem.tolerance + _REFUTED * episode.length
    if episode and least > episode.length + allowed:
        raise ShoalError(
            f"the bound {name!r} of {least:.9g} is above the length of a plan, {episode.length:.9g};"
            " please report it"
        )
    return Certificate(replace(episode, lower_bound=least), least, proof, least_moves, name)


def _is_away(problem: SteeringProblem, start: Points, goal: Points) -> bool:
    """Return whether some particle must move."""
    from scipy.optimize import linear_sum_assignment

    away = np.abs(goal[None] - start[:, None]).max(axis=2) > problem.tolerance
    if problem.interchangeable:
        return bool(away[linear_sum_assignment(away)].any())
    return bool(away.diagonal().any())


def check_certifiable(problem: SteeringProblem, seconds: float) -> None:
    """Refuse a problem whose plans have no least length, and a search without the Clarabel that it
    needs.
    """
    check_number(seconds, what="certify", above=0)
    if _has_no_least_length(problem):
        raise InvalidInputError(
            "certify: expected a problem without noise, uneven field and stated errors, because"
            " only its plans have a least length"
        )
    if has_proof(problem):
        import_extra("clarabel", "certificates need Clarabel", extra="certify")


def _has_no_least_length(problem: SteeringProblem) -> bool:
    return problem.noisy or problem.bounds is not None


def has_proof(problem: SteeringProblem) -> bool:
    """Return whether the bounds of such problems have proof trees.

    A region has none if its obstacles touch each other or the outline, or if there are too many
    routes around them.
    """
    place = problem.place
    return (
        place.kind in ("polygon", "disk", "region", "prism", "cylinder")
        and problem.n_particles == 2
        and not problem.particle_radius
        and problem.friction == inf
    )


def _searches(
    problem: SteeringProblem,
    start: Points,
    goals: Sequence[Points],
    limit: float,
    pool: Executor,
    workers: int,
) -> tuple[list[Any], dict[str, Any]]:
    """Return a search for each assignment of goals, and what else their certificate states; no
    search if there is no proof.
    """
    place, tolerance = problem.place, problem.tolerance
    if place.kind in ("polygon", "disk"):
        from shoal.steering.certificates.relaxation import Relaxation, round_directions
        from shoal.steering.certificates.search import Search

        searches = [
            Search(Relaxation(place, start, goal, tolerance, limit), pool, workers)
            for goal in goals
        ]
        more = {"directions": round_directions().tolist()} if place.round else {}
        return list(searches), more | {"runs": searches[0].relaxation.walls.runs}
    from shoal.steering.certificates.cells import cells_of_place
    from shoal.steering.certificates.route_search import RouteSearch

    cells = cells_of_place(place, start[:, -1], limit)
    if cells is None or not limit:
        return [], {}
    searches_by_routes = [RouteSearch(cells, start, goal, tolerance, limit) for goal in goals]
    return searches_by_routes if all(
        search.possible for search in searches_by_routes
    ) else [], cells.stated


def _least_moves(
    problem: SteeringProblem,
    start: Points,
    goals: Sequence[Points],
    most: int,
    late: Callable[[], bool],
) -> tuple[int, list[Any]]:
    """Return the least number of moves that is proven, at most ``most``, with the proof for each
    assignment of goals.
    """
    from shoal.steering.certificates.moves import MOST_MOVES, MovePrograms, prove_more_moves

    corners = problem.place.vertices
    programs = [MovePrograms(corners, start, goal, problem.tolerance) for goal in goals]
    least, proofs = 0, list[Any]()
    while least < min(most, MOST_MOVES):
        more_proofs = []
        for program in programs:
            proof = prove_more_moves(program, least, len(corners), late)
            if proof is None:
                return least, proofs
            more_proofs.append(proof)
        least, proofs = least + 1, more_proofs
    return least, proofs


def _statement(problem: SteeringProblem, start: Points, goal: Points) -> dict[str, Any]:
    """Return the problem as a certificate states it."""
    place = problem.place
    if place.round:
        where = {"center": place.center.tolist(), "radius": place.radius}
    elif place.kind == "region":
        where = {"rings": [ring.tolist() for ring in place.rings]}
    else:
        where = {"corners": place.vertices.tolist()}
    if place.dimensions == 3:
        where |= {"height": place.height, "open_ends": place.open_ends}
    return {
        **where,
        "start": start.tolist(),
        "goal": goal.tolist(),
        "tolerance": problem.tolerance,
        "interchangeable": problem.interchangeable,
    }


def check_certificate_of(
    problem: SteeringProblem, certificate: Any, *, seed: int = 0
) -> Verification:
    """Check that a certificate is right, and that it is one of ``problem``."""
    if not isinstance(certificate, dict) or certificate.get("kind") != KIND:
        return Verification(False, f"the file is no {KIND}")
    start, goal = problem.endpoints(seed)
    if not has_proof(problem) or _has_no_least_length(problem):
        return Verification(
            False,
            "certificates are for two points, without sliding, noise, uneven field and stated"
            " errors",
        )
    for name, value in _statement(problem, start, goal).items():
        if certificate.get(name) != value:
            return Verification(False, f"the certificate is for another problem: see {name}")
    return check_certificate(certificate)


def _shorten(
    episode: SteeringEpisode, order: tuple[int, ...], tree: PatternTree
) -> SteeringEpisode:
    """Return an episode with the shortest plan of a tree, if this is shorter than ``episode``."""
    if tree.best is None or tree.upper * (1 + CERTIFIED) >= episode.length:
        return episode
    from shoal.steering.certificates.relaxation import Hold

    walls = len(episode.problem.place.vertices)
    holds = [item for item in tree.best.pattern if isinstance(item, Hold)]
    return plan_with_holds(
        episode, order, [(hold.arc.first % walls, hold.particle) for hold in holds]
    )


def plan_with_holds(
    episode: SteeringEpisode, order: tuple[int, ...], holds: Sequence[tuple[int, int]]
) -> SteeringEpisode:
    """Return an episode with a plan of the given holds, if it is shorter and as sure as the plan of
    ``episode``; else ``episode``.
    """
    from shoal.steering.planners.chains import Chain, refine_chain
    from shoal.steering.planners.task import plan_chain

    if not holds:  # a translation, which is shorter only by the tolerance of the goals
        return episode
    task = _task(episode, order, episode.seed)
    plans = []
    for initial_moves, query in task.departures():
        for repeats in (1, 2):  # a hold whose contact slides is several
            walls = np.repeat([wall for wall, _ in holds], repeats)
            touchers = np.repeat([particle for _, particle in holds], repeats)
            unknowns = query.guess(len(walls))
            length = query.optimize(unknowns, touchers, walls, enough=1e-9)
            if length < inf:
                chain = refine_chain(query, Chain(touchers, walls, unknowns, length))
                plans += plan_chain(task, initial_moves, chain, query)
    return _with_shortest(episode, task, order, plans)


def _plan_wider(
    episode: SteeringEpisode,
    orders: Sequence[tuple[int, ...]],
    seconds: float,
    clock: Callable[[], float],
) -> SteeringEpisode:
    """Return an episode with the shortest plan of a wider search of the planner `Shortest` for
    chains, where a search for a bound makes no plans of its own.

    In polygons with many sides, this took up to 3 of 10 s, and no plan of 33 became 0.04 % shorter.
    """
    from shoal.steering.planners.improvement import improved_chains
    from shoal.steering.planners.shortest import greedy_seeds
    from shoal.steering.planners.task import plan_chain

    if episode.problem.place.kind != "disk":
        return episode
    deadline = clock() + seconds
    for order in orders:
        task = replace(_task(episode, order, episode.seed), deadline=deadline, clock=clock)
        plans = [
            plan
            for initial_moves, query in task.departures()
            for chain in improved_chains(query, greedy_seeds(query, task), wide=True)
            for plan in plan_chain(task, initial_moves, chain, query)
        ]
        episode = _with_shortest(episode, task, order, plans)
    return episode


def _plan_again(
    episode: SteeringEpisode,
    orders: Sequence[tuple[int, ...]],
    deadline: float,
    clock: Callable[[], float],
) -> SteeringEpisode:
    """Return an episode with the shortest plan that the planner `Sampling` finds with other seeds
    until a deadline, if it is shorter and as sure as the plan of ``episode``.
    """
    from shoal.steering.planners.clearance import plan_with_clearance
    from shoal.steering.planners.sampling import Sampling

    for number in count(1):
        for order in orders:
            if clock() >= deadline:
                return episode
            task = _task(episode, order, episode.seed + number)
            task = replace(task, deadline=deadline, clock=clock)
            moves = plan_with_clearance(task, Sampling())
            plans = [] if moves is None else [moves]
            episode = _with_shortest(episode, task, order, plans)
    raise AssertionError


def _task(episode: SteeringEpisode, order: tuple[int, ...], seed: int) -> SteeringTask:
    from shoal.steering.planners.task import SteeringTask

    problem = episode.problem
    start, goal = problem.endpoints(episode.seed)
    return SteeringTask(
        problem.world(gain=0.0),
        start,
        goal[list(order)],
        problem.tolerance,
        problem.max_moves,
        seed,
        clearance=problem.clearance,
        margin=problem.clearance,
    )


def _with_shortest(
    episode: SteeringEpisode, task: SteeringTask, order: tuple[int, ...], plans: Sequence[Points]
) -> SteeringEpisode:
    """Return an episode with the shortest of some plans that reach the goals for sure, if it is
    shorter than that of ``episode``, and worth its moves.
    """
    from shoal.steering.planners.task import path_length, worthwhile
    from shoal.steering.simulation import replay

    problem = episode.problem
    sure = [
        plan
        for plan in plans
        if task.error(task.world.play(task.start, plan)[-1]) <= task.tolerance
        and task.is_sure(plan)
    ]
    best = min(sure, key=path_length, default=None)
    if best is None or path_length(best) >= episode.length or len(best) > problem.max_moves:
        return episode
    if not worthwhile([(len(inputs), path_length(inputs)) for inputs in (episode.inputs, best)]):
        return episode
    return replace(
        episode,
        inputs=best,
        states=replay(problem, best, seed=episode.seed),
        order=np.array(order),
        reason=f"{len(best)} moves of length {path_length(best):.4g}, found by the search for a bound",
    )
