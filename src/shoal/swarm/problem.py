"""SwarmProblem: all settings of a mapping or coverage run except its seed."""

from __future__ import annotations

import os
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from shoal.core.checks import check_number, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.core.problem import Problem, option
from shoal.core.registry import Registry, name_of
from shoal.swarm.grid.board import RULES, GridLayout
from shoal.swarm.grid.scans import DEAREST, MOVE_COST, SCAN_COST, ScanRule
from shoal.swarm.maps.reading import MAX_CELLS, check_channel
from shoal.swarm.maps.workspace import GridWorkspace

# Tasks, placements and policies call kernels, whose compiler takes a second to load. They are
# imported when a field is checked, so that commands, which only read the declarations below, start
# fast.
if TYPE_CHECKING:
    from shoal.swarm.grid.tasks import Task
    from shoal.swarm.noise.model import Noise
    from shoal.swarm.policies import Policy

Cells = tuple[tuple[int, ...], ...]

READING = (
    "vessels",
    "width",
    "low",
    "high",
    "bright",
    "thickest",
    "threshold",
    "invert",
    "scale",
    "level",
    "label",
    "channel",
    "frame",
    "join_diagonals",
)
"""Names of the problem fields that control the reading of a map file."""

DRIVEN = (
    "policy",
    "budget",
    "time_per_move",
    "max_moves",
    "scan_every",
    "scan_cost",
    "move_cost",
    "slip",
    "misplace",
    "miss",
    "confidence",
)
"""Names of the problem fields that a run on a rig uses. The rig itself determines all other
settings of the run.
"""

TASK_NAMES = ("mapping", "coverage", "subset-coverage")
PLACEMENT_NAMES = ("uniform", "flood-fill", "region-fill", "left-wall")
POLICY_NAMES = (
    "best",
    "beam-rollout",
    "rollout",
    "greedy-classify",
    "closest-frontier",
    "elect-particle",
    "random-moves",
    "depth-first",
    "sweep",
    "offline",
    "manual",
)
RIG = "rig"
"""Map of a problem whose place is a rig: nothing but the size of the place is known."""

STRONG_NOISE = 0.6
"""Sum of the error probabilities above which the planner best needs no fewer moves than the policy
closest-frontier.

The command `python -m benchmarks.noise --policies` compares the two policies.
"""

NOISE_MEASURES = ("right", "false_free", "false_obstacles", "undecided")


def _check_map(given: Any) -> Any:
    if isinstance(given, str | GridWorkspace | os.PathLike):
        return os.fspath(given) if isinstance(given, os.PathLike) else given
    return GridWorkspace.from_dict(given) if isinstance(given, dict) else GridWorkspace(given)


def _named(kind: str) -> dict[str, Any]:
    """Return the functions that check and dump the value of a field that holds a task, a placement
    or a policy.
    """

    def registry() -> tuple[Registry[Any], Any]:
        if kind == "task":
            from shoal.swarm.grid.tasks import TASKS, make_task

            return TASKS, make_task
        if kind == "placement":
            from shoal.swarm.grid.tasks import PLACEMENTS, make_placement

            return PLACEMENTS, make_placement
        from shoal.swarm.policies import POLICIES, make_policy

        return POLICIES, make_policy

    def check(given: Any) -> Any:
        known, make = registry()
        # objects in third-party modules are not imported yet
        if not isinstance(given, str) or (
            given != "auto" and (given.partition(":")[0] in known or ":" not in given)
        ):
            make(given)
        return given

    return {"check": check, "dump": lambda given: name_of(given, registry()[0])}


def _name_for_people(given: Any) -> str:
    return (
        given
        if isinstance(given, str)
        else str(getattr(given, "name", getattr(given, "__name__", "custom")))
    )


def _check_start(given: Any) -> Cells:
    try:
        cells = np.asarray(given)
    except ValueError:
        cells = np.zeros(0)
    if cells.ndim != 2 or not np.issubdtype(cells.dtype, np.integer):
        raise InvalidInputError(
            f"start: expected cells of 2 or 3 whole numbers each, got {shortened(given)}"
        )
    return tuple(tuple(int(number) for number in cell) for cell in cells)


def _parse_start(text: str) -> list[list[int]]:
    return [[int(number) for number in cell.split(",")] for cell in text.split()]


def _parse_cell_size(text: str) -> float | tuple[float, ...]:
    sizes = tuple(float(size) for size in text.split(","))
    return sizes if len(sizes) > 1 else sizes[0]


def _check_cell_size(given: Any) -> float | tuple[float, ...]:
    if isinstance(given, list | tuple) and len(given) in (2, 3):
        return tuple(check_number(size, what="cell_size", above=0, most=1e6) for size in given)
    return check_number(given, what="cell_size", above=0, most=1e6)


def spacing_of(cell_size: float | tuple[float, ...] | None, ndim: int) -> tuple[float, ...] | None:
    """Return the size of a cell along each axis in mm, for a value of the field ``cell_size``.

    Raises
    ------
    InvalidInputError
        Raised if the number of sizes is neither 1 nor ``ndim``.
    """
    if cell_size is None:
        return None
    sizes = cell_size if isinstance(cell_size, tuple) else (cell_size,) * ndim
    if len(sizes) != ndim:
        raise InvalidInputError(
            f"cell_size: expected 1 size or {ndim} sizes for a {ndim}-D map, got {len(sizes)}:"
            f" {shortened(sizes)}"
        )
    return sizes


def _check_scan_every(given: Any) -> int | str:
    rule = ScanRule.parse(given)
    return rule.step if rule.kind == "equal" else rule.kind


def _rate(help: str) -> Any:  # noqa: A002 - as in option
    return option(0.0, help=help, least=0, most=0.5)


@dataclass(frozen=True, eq=False)
class SwarmProblem(Problem):
    """All settings, except the seed, of a run in which a swarm maps or covers a workspace.

    The options of the commands ``shoal map`` and ``shoal cover``, and the fields of sweeps and
    problem files, correspond to the fields of `SwarmProblem`. In Python, a map may be a
    `GridWorkspace` or an array, in addition to a name or a path. The task, the policy and the
    placement may be third-party objects.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if a field has the wrong type or is out of range, or if fields contradict each other.

    Notes
    -----
    Sources: paper M, and docs/concepts/world.md.

    Examples
    --------
    >>> problem = SwarmProblem("line:9", particles=3, policy="closest-frontier")
    >>> problem.canonical()
    '{"kind":"swarm","map":"line:9","particles":3,"policy":"closest-frontier"}'
    >>> problem.place
    <GridWorkspace 'line:9': 1x9, 9 free cells>
    """

    part: ClassVar[str] = "swarm"
    headings: ClassVar = {
        "task": "Task",
        "policy": "Policy",
        "scan_every": "Scans",
        "slip": "Noise",
        "vessels": "Map file",
    }
    measures: ClassVar[tuple[str, ...]] = ("status", "moves", "scans", "cost", "distance")
    censored: ClassVar[tuple[str, ...]] = ("moves", "scans", "cost", "distance")

    map: Any = option(
        help=(
            "Map: a generated map such as vessels:5000 (see 'shoal maps'), or a file: a picture,"
            " text, .map, .npy, .csv, .mat, NIfTI, NRRD, DICOM, a TIFF of several pages, or a"
            " folder of slices."
        ),
        argument=True,
        metavar="MAP",
        check=_check_map,
        dump=lambda given: given if isinstance(given, str) else given.to_dict(),
    )
    task: Any = option(
        "mapping",
        help=f"Task: {', '.join(TASK_NAMES)} or MODULE:ATTRIBUTE.",
        names=TASK_NAMES,
        **_named("task"),
    )
    subset: float | None = option(
        None,
        help="For coverage: random share of the free cells that must be visited.",
        above=0,
        most=1,
    )
    particles: int = option(100, help="Number of particles.", short="-n", least=1, most=MAX_CELLS)
    placement: Any = option(
        "uniform",
        help=f"Placement of the particles: {', '.join(PLACEMENT_NAMES)} or MODULE:ATTRIBUTE.",
        names=PLACEMENT_NAMES,
        **_named("placement"),
    )
    start: Cells | None = option(
        None,
        help=(
            "Start cells of the particles, in place of a placement: row,column pairs such as '0,3"
            " 0,4' (in three dimensions layer,row,column)."
        ),
        metavar="CELLS",
        parse=_parse_start,
        check=_check_start,
        dump=lambda given: [list(cell) for cell in given],
    )
    rule: str = option("block", help="Move rule of the particles.", choices=tuple(RULES))
    policy: Any = option(
        "auto",
        help=(
            "Policy: auto, best, beam-rollout, rollout, greedy-classify, closest-frontier,"
            " elect-particle, random-moves, depth-first, sweep, offline (coverage only),"
            " manual:COMMANDS or MODULE:ATTRIBUTE. Options of a policy follow a colon, as in"
            " closest-frontier:ties=row-major. auto stands for best if the task is mapping with a"
            " scan after each move, with rule block or merge and without strong noise, on huge maps"
            " with a smaller budget, and for closest-frontier in all other cases."
        ),
        names=POLICY_NAMES,
        **_named("policy"),
    )
    budget: float | None = option(
        None,
        help=(
            "For the planners best, rollout and offline: mean number of simulated moves for each"
            " move sent, with 1000 particles. The planners best and rollout multiply the budget by"
            " up to 10 with fewer than 1000 particles, and by up to 4 with more than 1000"
            " particles."
        ),
        above=0,
        most=1e12,
    )
    time_per_move: float | None = option(
        None,
        help=(
            "For planners: mean computation time for each move, in place of a budget. With a time"
            " per move, the commands depend on the speed of the machine."
        ),
        metavar="MS",
        unit="ms",
        above=0,
        most=1e9,
    )
    max_moves: int = option(
        1_000_000,
        help="Maximum number of moves; an episode that reaches it has the status limit.",
        least=0,
    )
    scan_every: int | str = option(
        1,
        help=(
            "Scan after this number of equal commands: a number, doubling (after 1, 2, 4, ..."
            " commands in one direction), hyper (after 1, 4, 27, ...) or adaptive (the number that"
            " classifies most cells for the price). Under noise, a given number is the maximum"
            " number of commands before each scan."
        ),
        metavar="RULE",
        check=_check_scan_every,
    )
    scan_cost: float = option(
        SCAN_COST, help="Price of a scan, in any unit.", least=0, most=DEAREST
    )
    move_cost: float = option(
        MOVE_COST,
        help="Price of a move, in the same unit as the price of a scan.",
        least=0,
        most=DEAREST,
    )
    slip: float = _rate("Probability that a particle does not move at a command.")
    misplace: float = _rate("Probability that a scan shows a particle in a neighbouring cell.")
    miss: float = _rate("Probability that a scan does not show a particle.")
    confidence: float = option(
        0.99,
        help=(
            "Under noise: probability from which a cell counts as known to be free, or as known to"
            " be an obstacle."
        ),
        above=0.75,
        most=0.99999,
    )
    vessels: bool = option(
        False,
        help="Read MAP as a photograph and find the vessels in it (needs the extra 'imaging').",
    )
    width: int | None = option(
        None,
        help=(
            "For files: maximum number of cells along the larger side of the map; a larger map is"
            " scaled down, and what was connected stays connected. With --vessels by default 160."
        ),
        unit="cells",
        least=1,
    )
    low: float = option(
        0.6,
        help=(
            "With --vessels: lower threshold of the filter response, as a multiple of the automatic"
            " threshold. A vessel ends where its response falls below the lower threshold."
        ),
        above=0,
        most=10,
    )
    high: float = option(
        1.2,
        help=(
            "With --vessels: upper threshold of the filter response, as a multiple of the automatic"
            " threshold. At least one pixel of each vessel exceeds the upper threshold. A smaller"
            " upper threshold gives more vessels."
        ),
        above=0,
        most=10,
    )
    bright: bool | None = option(
        None,
        help=(
            "With --vessels: vessels are brighter than their surroundings. By default, Shoal takes"
            " bright lines or dark lines as vessels, whichever are clearer."
        ),
    )
    thickest: float | None = option(
        None,
        help=(
            "With --vessels: width of the thickest vessel, as a fraction of the picture's larger"
            " side; by default 0.0185 if the picture shows a round field of view, else 0.035."
        ),
        above=0,
        most=0.5,
    )
    threshold: float | None = option(
        None,
        help=(
            "For pictures: minimum brightness of a free pixel, from 0 (black) to 1 (white). By"
            " default, a picture of two brightnesses is a mask, whose brighter pixels are free, and"
            " every other picture has the threshold 0.5."
        ),
        least=0,
        most=1,
    )
    invert: bool = option(
        False,
        help=(
            "For map files: exchange free cells and obstacles. In a picture, dark pixels are free."
        ),
    )
    scale: float = option(
        1.0,
        help=(
            "For pictures: number of cells for each pixel along each side; what was connected stays"
            " connected."
        ),
        above=0,
        most=64,
    )
    join_diagonals: bool = option(
        False,
        help=(
            "For files: where parts of the map touch only diagonally, open one cell, because"
            " particles cannot move diagonally."
        ),
    )
    level: float | None = option(
        None,
        help=(
            "For grey pictures, tables, arrays and volumes: minimum number of a free cell, as the"
            " file stores it."
        ),
    )
    label: int | None = option(
        None,
        help=(
            "For grey pictures, pictures with a palette, tables, arrays and volumes: number (label)"
            " of all free cells."
        ),
    )
    channel: int | str | None = option(
        None,
        help=(
            "For pictures, arrays and volumes of several channels: the channel that is read, by its"
            " number from 1 or by its name, such as red, green, blue or alpha."
        ),
        metavar="CHANNEL",
        parse=check_channel,
        check=check_channel,
    )
    frame: int | None = option(
        None,
        help="For pictures and volumes with a time axis: the point in time that is read, from 1.",
        least=1,
    )
    largest_component: bool = option(
        False, help="Keep the largest connected part of the free space, and remove all other parts."
    )
    cell_size: float | tuple[float, ...] | None = option(
        None,
        help=(
            "Side of a cell of the map, or its size along each axis, layers first, such as"
            " 2,0.5,0.5; by default as in the map file."
        ),
        unit="mm",
        metavar="MM",
        parse=_parse_cell_size,
        check=_check_cell_size,
        dump=lambda given: list(given) if isinstance(given, tuple) else given,
    )
    move_seconds: float | None = option(
        None, help="Time that the apparatus takes for a move.", unit="s", least=0, most=1e6
    )
    scan_seconds: float | None = option(
        None, help="Time that the apparatus takes for a scan.", unit="s", least=0, most=1e6
    )

    def check_together(self) -> None:
        """Refuse a problem whose fields contradict each other. Do not open the map file."""
        assert self.scanning
        if self.start is not None:
            if "placement" in self.given:
                raise InvalidInputError(
                    "placement: expected no placement together with start cells, got"
                    f" {_name_for_people(self.placement)}"
                )
            if "particles" in self.given and self.particles != len(self.start):
                raise InvalidInputError(
                    f"particles: expected {len(self.start)}, the number of start cells, got"
                    f" {self.particles}"
                )
            object.__setattr__(self, "particles", len(self.start))
        if self.subset is not None and self.task not in ("coverage", "subset-coverage"):
            task = _name_for_people(self.task)
            raise InvalidInputError(
                f"subset: expected the task coverage together with a subset, got the task {task}"
            )
        if self.budget is not None and self.time_per_move is not None:
            raise InvalidInputError("budget: expected a budget or a time per move, got both")
        if not self.noise:
            if "confidence" in self.given and not self.given & {"slip", "misplace", "miss"}:
                raise InvalidInputError(
                    "confidence: expected a confidence only together with noise (slip, misplace or"
                    f" miss), got {self.confidence:g}"
                )
            return
        object.__setattr__(self, "measures", (*self.measures, *NOISE_MEASURES))
        if self.rule != "block":
            raise InvalidInputError(f"noise: expected rule block, got {self.rule}")
        if self.task_name != "mapping":
            raise InvalidInputError(f"noise: expected the task mapping, got {self.task_name}")
        if isinstance(self.scan_every, str):
            raise InvalidInputError(
                "noise: expected scan-every as a number of commands, because no outcome is certain"
                f" beforehand, got {self.scan_every}"
            )

    @property
    def scanning(self) -> ScanRule:
        """The problem's scan rule, with the costs of scans and moves."""
        return ScanRule.parse(self.scan_every, scan_cost=self.scan_cost, move_cost=self.move_cost)

    @property
    def noise(self) -> Noise | None:
        """The noise model of the problem, or None for a problem without noise."""
        if not (self.slip or self.misplace or self.miss):
            return None
        from shoal.swarm.noise.model import Noise

        return Noise(self.slip, self.misplace, self.miss)

    @property
    def task_name(self) -> str:
        """Name of the task. The property returns the name of a third-party task without importing
        the task.
        """
        if self.subset is not None:
            return "subset-coverage"
        name = _name_for_people(self.task)
        return name.partition(":")[0] if name.startswith("subset-coverage:") else name

    @property
    def placement_name(self) -> str:
        """Name of the placement, or "given" if the problem has start cells."""
        return "given" if self.start is not None else _name_for_people(self.placement)

    @cached_property
    def chosen_task(self) -> Task:
        """The task of the problem, as a task object."""
        from shoal.swarm.grid.tasks import SubsetCoverage, make_task

        return make_task(self.task) if self.subset is None else SubsetCoverage(self.subset)

    @cached_property
    def chosen_policy(self) -> Policy:
        """The policy object of the problem: the requested policy, or the policy that the setting
        ``auto`` selects.

        Raises
        ------
        InvalidInputError, UnknownNameError
            Raised if the name of the policy is unknown, or if a policy that does not plan has a
            planning budget.
        """
        from shoal.swarm.policies import make_policy, with_budget

        thinking = {"budget": self.budget, "milliseconds": self.time_per_move}
        wanted = {name: value for name, value in thinking.items() if value is not None}
        policy: Any = self.policy
        if isinstance(policy, str) and policy == "auto":
            policy = self._automatic(planned=bool(wanted))
        return with_budget(make_policy(policy), **wanted)

    @property
    def chosen_for_size(self) -> bool:
        """Whether the policy is ``auto``, and the size of the map decides about it."""
        wanted = self.budget is not None or self.time_per_move is not None
        return (
            isinstance(self.policy, str)
            and self.policy == "auto"
            and not wanted
            and self._plannable
            and self.map != RIG
        )

    @property
    def _plannable(self) -> bool:
        """Whether the planner best works, and needs fewer moves than the policy closest-frontier on
        a small map.
        """
        from shoal.swarm.grid.tasks import Mapping

        quiet = self.slip + self.misplace + self.miss <= STRONG_NOISE
        return (
            isinstance(self.chosen_task, Mapping)
            and self.rule != "tilt"
            and self.scanning.every_move
            and quiet
        )

    def _automatic(self, *, planned: bool) -> Any:
        """Return the policy that ``auto`` stands for. If ``planned`` is true, the user has set a
        limit that only planners have.
        """
        from shoal.swarm.grid.tasks import Mapping
        from shoal.swarm.policies.planners.cost import fit_planner

        if self.chosen_for_size:
            workspace: GridWorkspace = self.place
            size = (workspace.shape, workspace.n_free, self.particles)
            return fit_planner(*size, noisy=self.noise is not None) or "closest-frontier"
        return (
            "best"
            if self._plannable or (planned and isinstance(self.chosen_task, Mapping))
            else "closest-frontier"
        )

    def open_place(self) -> GridWorkspace:
        """Open the problem's map and return the workspace."""
        from shoal.swarm.maps.files import open_map

        reading = {name: getattr(self, name) for name in READING if name in self.given}
        workspace = open_map(self.map, **reading)
        if self.cell_size is not None:
            workspace = GridWorkspace(
                workspace.free,
                name=workspace.name,
                spacing=spacing_of(self.cell_size, workspace.ndim),
            )
        if not self.largest_component:
            return workspace
        largest = workspace.largest_component()
        parts, dropped = int(workspace.components.max()), workspace.n_free - largest.n_free
        if dropped:
            share = (
                f"{100 * largest.n_free / workspace.n_free:.4g} % of {workspace.n_free} free cells"
            )
            cells = (
                "1 free cell is dropped" if dropped == 1 else f"{dropped} free cells are dropped"
            )
            tell_once(
                f"shoal: notice: {workspace.name}: the largest of {parts} parts is kept, {share};"
                f" {cells}"
            )
        return largest

    def place_key(self) -> str | None:
        """Return a text with the map's name and the options for reading the map, or None if the map
        is an open `GridWorkspace`.
        """
        if isinstance(self.map, GridWorkspace):
            return None
        read = ("map", "largest_component", "cell_size", *READING)
        return self.canonical(
            without=("kind", *(name for name in self.declarations() if name not in read))
        )

    def place_is_file(self) -> bool:
        """Return whether the problem's map is a file or a folder."""
        return isinstance(self.map, str) and os.path.exists(
            self.map
        )  # unlike Path.exists, it accepts names of any length

    def place_digest(self) -> bytes:
        """Return the shape and the free cells of the map as bytes."""
        return repr(self.place.shape).encode() + bytes(self.place.free.tobytes())

    def check_at_place(self) -> None:
        """Refuse a policy that the task, map or rules exclude, start cells that are not free, and
        more particles than free cells.

        Raises
        ------
        InvalidInputError, UnknownNameError
        """
        from shoal.swarm.grid.world import check_start

        workspace: GridWorkspace = self.place
        self.check_policy(GridLayout(workspace.shape))
        if self.start is not None:
            check_start(workspace, self.start, rule=self.rule)
        elif self.particles > workspace.n_free:
            raise InvalidInputError(
                f"particles: expected 1 to {workspace.n_free} (the free cells of {workspace.name}),"
                f" got {self.particles}"
            )

    def check_policy(self, layout: GridLayout) -> None:
        """Refuse a policy that does not support the task, the move rule, the scan rule or the
        workspace's dimensions.
        """
        from shoal.swarm.policies import Offline, check_rules, check_scanning

        policy = self.chosen_policy
        if isinstance(policy, Offline) and getattr(self.chosen_task, "mapping", True):
            raise InvalidInputError(
                "policy offline: expected a task whose map is known, such as coverage, got a"
                " mapping"
            )
        check_rules(policy, layout, self.rule)
        check_scanning(self.scanning, policy, self.rule)
