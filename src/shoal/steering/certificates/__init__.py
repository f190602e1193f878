"""Proofs that no plan is shorter than a bound: the search for them, and their checker."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations
from math import inf
from time import monotonic
from typing import Any

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.episode import Verification
from shoal.core.errors import InvalidInputError, ShoalError, import_extra
from shoal.steering.certificates.check import check_certificate
from shoal.steering.certificates.geodesics import geodesic_bound
from shoal.steering.episode import SteeringEpisode
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex import Points

KIND = "steering certificate"
CERTIFIED = 1e-3
"""Largest gap of a certified plan."""
_ENOUGH = 1e-4  # gap at which the search ends
_SLACK = 1e-9  # relative: what rounding errors may take from a bound


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
        JSON object for `check_certificate`; None if the bound has no proof tree, because the
        workspace is not a polygon.
    """

    episode: SteeringEpisode
    lower_bound: float
    proof: dict[str, Any] | None

    @property
    def gap(self) -> float | None:
        """How much longer than the lower bound the plan is, relative; None without a plan."""
        if not self.episode or not self.lower_bound:
            return 0.0 if self.episode and not self.episode.length else None
        return max(self.episode.length / self.lower_bound - 1, 0.0)

    @property
    def certified(self) -> bool:
        """Whether a proof shows that the plan is at most 0.1 % longer than the shortest."""
        return self.gap is not None and self.gap <= CERTIFIED

    @property
    def sentence(self) -> str:
        """One sentence about the bound and the gap."""
        if self.gap is None:
            return f"no plan is shorter than {self.lower_bound:.6g}"
        proof = "" if self.proof is None else ", by a proof that was checked"
        return (
            f"at most {100 * self.gap:.3g} % longer than the shortest plan{proof}"
            f" (lower bound {self.lower_bound:.6g})"
        )

    def report(self) -> dict[str, Any]:
        """Return the JSON object that ``shoal steer --certify`` prints."""
        return self.episode.report() | {
            "lower_bound": self.lower_bound,
            "gap": self.gap,
            "certified": self.certified,
            "certificate": None,
        }


def certify(
    episode: SteeringEpisode,
    *,
    seconds: float = 60.0,
    progress: Callable[[float, float], None] | None = None,
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

    Raises
    ------
    InvalidInputError
        If the problem has noise, an uneven field or stated errors: its plans have no least length.
    MissingExtraError
        If Clarabel is not installed (``pip install 'shoal[certify]'``).

    Examples
    --------
    >>> from shoal.steering import SteeringProblem, certify
    >>> from shoal.steering.run import run
    >>> problem = SteeringProblem("square", [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)])
    >>> certificate = certify(run(problem), seconds=20)
    >>> certificate.certified, round(certificate.lower_bound, 3)
    (True, 1.709)
    """
    problem = episode.problem
    check_certifiable(problem, seconds)
    place = problem.place
    start, goal = problem.endpoints(episode.seed)
    limit = episode.length
    search = _search_of(problem, start, goal, limit) if episode else None
    if search is None:
        least = max(geodesic_bound(problem, start, goal), episode.lower_bound or 0.0)
        return Certificate(replace(episode, lower_bound=least), least, None)
    from shoal.steering.certificates.relaxation import HoldGap

    trees = search.trees
    begun = told = monotonic()
    while (now := monotonic()) - begun < seconds:
        tree = min(trees, key=lambda one: one.least_open)
        if tree.least_open * (1 + _ENOUGH) >= min(one.upper for one in trees):
            break
        tree.step()
        if progress is not None and now - told > 1:
            told = now
            progress(now - begun, min(one.lower for one in trees))
    bound = max(min(one.lower for one in trees) * (1 - _SLACK), 0.0)
    proof = {
        "kind": KIND,
        **_stated(problem, start, goal),
        **search.proof(),
        "lower_bound": bound,
    }
    if not (checked := check_certificate(proof)):
        raise ShoalError(
            f"the search made a wrong certificate; please report it: {checked.message}"
        )
    order, tree = min(zip(search.orders, trees, strict=True), key=lambda pair: pair[1].upper)
    if tree.best is not None and tree.upper * (1 + CERTIFIED) < limit and place.kind == "polygon":
        episode = improved(
            episode, order, [item for item in tree.best.pattern if not isinstance(item, HoldGap)]
        )
    return Certificate(replace(episode, lower_bound=bound), bound, proof)


@dataclass(frozen=True, eq=False)
class _Search:
    """The trees of a search, of which each treats one case, and what makes a certificate of them."""

    trees: Sequence[Any]
    orders: Sequence[tuple[int, ...]]
    proof: Callable[[], dict[str, Any]]


def _search_of(problem: SteeringProblem, start: Points, goal: Points, limit: float) -> Any:
    """Return the search for a proof, or None if there is none for such problems."""
    place = problem.place
    if problem.n_particles != 2 or problem.particle_radius or problem.friction < inf:
        return None
    from shoal.steering.certificates.cells import cells_of
    from shoal.steering.certificates.relaxation import Relaxation
    from shoal.steering.certificates.routes import RouteSearch
    from shoal.steering.certificates.search import PatternTree

    orders = list(permutations(range(2))) if problem.interchangeable else [(0, 1)]
    if place.kind != "polygon":
        cells = cells_of(place)
        if cells is None or not limit:
            return None
        found = RouteSearch(cells, start, goal, orders, problem.tolerance, limit)
        return found if found.trees else None
    trees = [
        PatternTree(Relaxation(place.vertices, start, goal[list(order)], problem.tolerance, limit))
        for order in orders
    ]
    return _Search(
        trees,
        orders,
        lambda: {
            "limit": limit,
            "unit": trees[0].relaxation.scale,
            "trees": [
                {"order": [k + 1 for k in order], "proof": tree.root.proof()}
                for order, tree in zip(orders, trees, strict=True)
            ],
        },
    )


def _stated(problem: SteeringProblem, start: Points, goal: Points) -> dict[str, Any]:
    """Return the problem as a certificate states it."""
    place = problem.place
    rings = [ring.tolist() for ring in place.rings]
    where = {"rings": rings} if place.kind == "region" else {"corners": rings[0]}
    if place.dimensions == 3:
        where["height"] = place.height
    return {
        **where,
        "start": start.tolist(),
        "goal": goal.tolist(),
        "tolerance": problem.tolerance,
        "interchangeable": problem.interchangeable,
    }


def check_certifiable(problem: SteeringProblem, seconds: float) -> None:
    """Refuse a problem whose plans have no least length, and a search without Clarabel."""
    check_number(seconds, what="certify", above=0)
    if problem.noisy or problem.bounds is not None:
        raise InvalidInputError(
            "certify: expected a problem without noise, uneven field and stated errors, because"
            " only its plans have a least length"
        )
    import_extra("clarabel", "certificates need Clarabel", extra="certify")


def check_certificate_of(
    problem: SteeringProblem, certificate: Any, *, seed: int = 0
) -> Verification:
    """Check that a certificate is right, and that it is one of ``problem``."""
    if not isinstance(certificate, dict) or certificate.get("kind") != KIND:
        return Verification(False, f"the file is no {KIND}")
    if problem.place.round or problem.friction < inf or problem.particle_radius:
        return Verification(False, "certificates are for points and flat walls without sliding")
    for name, value in _stated(problem, *problem.endpoints(seed)).items():
        if certificate.get(name) != value:
            return Verification(False, f"the certificate is for another problem: see {name}")
    return check_certificate(certificate)


def improved(
    episode: SteeringEpisode, order: tuple[int, ...], holds: Sequence[tuple[int, int]]
) -> SteeringEpisode:
    """Return an episode with a plan of the given holds, if it is shorter and as sure as the plan of
    ``episode``; else ``episode``.
    """
    import numpy as np

    from shoal.steering.planners.chains import Chain, refine_chain
    from shoal.steering.planners.task import SteeringTask, path_length, plan_chain
    from shoal.steering.simulation import replay

    problem = episode.problem
    start, goal = problem.endpoints(episode.seed)
    task = SteeringTask(
        problem.world(gain=0.0),
        start,
        goal[list(order)],
        problem.tolerance,
        problem.max_moves,
        episode.seed,
        clearance=problem.clearance,
        margin=problem.clearance,
    )
    plans = []
    for first, query in task.departures():
        for repeats in (1, 2):  # a hold whose contact slides is several
            walls = np.repeat([wall for wall, _ in holds], repeats)
            touchers = np.repeat([particle for _, particle in holds], repeats)
            unknowns = query.guess(len(walls))
            length = query.optimize(unknowns, touchers, walls, enough=1e-9)
            if length < inf:
                chain = refine_chain(query, Chain(touchers, walls, unknowns, length))
                plans += plan_chain(task, first, chain, query)
    sure = [
        plan
        for plan in plans
        if task.error(task.world.play(start, plan)[-1]) <= task.tolerance and task.is_sure(plan)
    ]
    best = min(sure, key=path_length, default=None)
    if best is None or path_length(best) >= episode.length or len(best) > problem.max_moves:
        return episode
    return replace(
        episode,
        inputs=best,
        states=replay(problem, best, seed=episode.seed),
        order=np.array(order),
        reason=f"{len(best)} moves of length {path_length(best):.4g}, found by the search for a bound",
    )
