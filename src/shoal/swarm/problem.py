"""SwarmProblem: all settings of a mapping or coverage run except its seed; and SwarmSetup: the map,
the task and the policy that the settings name, opened once.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_number, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.core.problem import Problem, option, option_of
from shoal.core.registry import Registry, name_of
from shoal.swarm.grid.board import RULES, GridLayout
from shoal.swarm.grid.scans import DEAREST, MOVE_COST, SCAN_COST, ScanRule
from shoal.swarm.grid.tasks import (
    PLACEMENTS,
    TASKS,
    Gathering,
    Inlet,
    Mapping,
    SubsetCoverage,
    Target,
    Task,
    make_placement,
    make_task,
    place,
)
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.reading import HIGH, LOW, MAX_CELLS, REASONS, MapOptions
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import CONFIDENCE, MOST, PRIOR, SUREST, Noise

# The policies bring the kernels of all planners, and `open_map` the readers of all files. They are
# imported on use, because help and commands without a policy would start a tenth slower.
if TYPE_CHECKING:
    from numpy.random import Generator

    from shoal.swarm.policies import Policy

Cells = tuple[tuple[int, ...], ...]

READING = tuple(REASONS)
"""Names of the problem fields that control the reading of a map file."""

DRIVEN = (
    "task",
    "subset",
    "target",
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

RIG = "rig"
"""Map of a problem whose place is a rig: nothing but the size of the place is known."""

NOISE_MEASURES = ("right", "false_free", "false_obstacles", "undecided")


def _check_map(value: Any) -> Any:
    if isinstance(value, str | GridWorkspace | os.PathLike):
        return os.fspath(value) if isinstance(value, os.PathLike) else value
    return GridWorkspace.from_dict(value) if isinstance(value, dict) else GridWorkspace(value)


def _registry_field(
    find: Callable[[], tuple[Registry[Any], Callable[[Any], Any]]],
) -> dict[str, Any]:
    """Return how a field checks, dumps and lists the values that a registry names.

    ``find`` returns the registry, and the function that makes the object of a name.
    """

    def check(value: Any) -> Any:
        if isinstance(value, str) and value == "auto":
            return value
        registry, make = find()
        # objects in third-party modules are not imported yet
        if not isinstance(value, str) or value.partition(":")[0] in registry or ":" not in value:
            make(value)
        return value

    return {
        "check": check,
        "dump": lambda value: name_of(value, find()[0]),
        # the others as registered
        "names": lambda: sorted(find()[0], key=lambda name: name != "best"),
    }


def _policies() -> tuple[Registry[Any], Callable[[Any], Any]]:
    from shoal.swarm.policies import POLICIES, make_policy

    return POLICIES, make_policy


def _name_for_people(value: Any) -> str:
    return (
        value
        if isinstance(value, str)
        else str(getattr(value, "name", getattr(value, "__name__", "custom")))
    )


def _check_cells_of(value: Any, what: str) -> Cells:
    try:
        cells = np.asarray(value)
    except ValueError:
        cells = np.zeros(0)
    if cells.ndim != 2 or not np.issubdtype(cells.dtype, np.integer):
        raise InvalidInputError(
            f"{what}: expected cells of 2 or 3 whole numbers each, got {shortened(value)}"
        )
    return tuple(tuple(int(number) for number in cell) for cell in cells)


def _check_start(value: Any) -> Cells | Inlet:
    if isinstance(value, str):
        return Inlet.parse(value)
    return value if isinstance(value, Inlet) else _check_cells_of(value, "start")


def _parse_start(text: str) -> Any:
    from shoal.swarm.maps.files import open_map

    if text.startswith("inlet:"):
        return text
    if os.path.exists(text):
        return open_map(text).cells
    return _parse_cells(text, ", inlet:ROW,COLUMN or the file of a map")


def _parse_region(text: str) -> Any:
    from shoal.swarm.maps.files import open_map

    if os.path.exists(text):
        return open_map(text).cells
    return _parse_cells(text, " or the file of a map")


def _parse_cells(text: str, alternatives: str = "") -> list[list[int]]:
    try:
        return [[int(number) for number in cell.split(",")] for cell in text.split()]
    except ValueError:
        raise ValueError(
            f"expected row,column pairs such as '0,3 0,4'{alternatives}, got {shortened(text)}"
        ) from None


def _parse_cell_size(text: str) -> float | tuple[float, ...]:
    sizes = tuple(float(size) for size in text.split(","))
    return sizes if len(sizes) > 1 else sizes[0]


def _check_cell_size(value: Any) -> float | tuple[float, ...]:
    if isinstance(value, list | tuple) and len(value) in (2, 3):
        return tuple(check_number(size, what="cell_size", above=0, most=1e6) for size in value)
    return check_number(value, what="cell_size", above=0, most=1e6)


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


def _check_scan_every(value: Any) -> int | str:
    rule = ScanRule.parse(value)
    return rule.step if rule.kind == "equal" else rule.kind


def _rate(help: str) -> Any:  # noqa: A002 - as in option
    return option(0.0, help=help, least=0, most=MOST)


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
        dump=lambda value: value if isinstance(value, str) else value.to_dict(),
    )
    task: Any = option(
        "mapping",
        help="Task: {names} or MODULE:ATTRIBUTE.",
        **_registry_field(lambda: (TASKS, make_task)),
    )
    subset: float | None = option(
        None,
        help="For coverage: random share of the free cells that must be visited.",
        above=0,
        most=1,
    )
    target: Cells | None = option(
        None,
        help=(
            "Cells to each of which a particle must be brought, for the task target: row,column"
            " pairs such as '0,3 0,4' (in three dimensions layer,row,column)."
        ),
        metavar="CELLS",
        parse=_parse_cells,
        check=lambda value: _check_cells_of(value, "target"),
        dump=lambda value: [list(cell) for cell in value],
    )
    region: Cells | None = option(
        None,
        help=(
            "Cells into which all particles must be brought, for the task gathering: row,column"
            " pairs such as '0,3 0,4' (in three dimensions layer,row,column), or a map whose free"
            " cells are the region. By default the particles gather in any one cell, under the rule"
            " merge."
        ),
        metavar="CELLS",
        parse=_parse_region,
        check=lambda value: _check_cells_of(value, "region"),
        dump=lambda value: [list(cell) for cell in value],
    )
    particles: int = option(100, help="Number of particles.", short="-n", least=1, most=MAX_CELLS)
    placement: Any = option(
        "uniform",
        help="Placement of the particles: {names} or MODULE:ATTRIBUTE.",
        **_registry_field(lambda: (PLACEMENTS, make_placement)),
    )
    start: Cells | Inlet | None = option(
        None,
        help=(
            "Start cells of the particles, in place of a placement: row,column pairs such as '0,3"
            " 0,4' (in three dimensions layer,row,column), a map whose free cells are the start"
            " cells, or inlet:ROW,COLUMN for particles that have filled the map from there."
        ),
        metavar="CELLS",
        parse=_parse_start,
        check=_check_start,
        dump=lambda value: (
            str(value) if isinstance(value, Inlet) else [list(cell) for cell in value]
        ),
    )
    rule: str = option(
        "block",
        help="Move rule of the particles. Without a region, the task gathering sets the rule merge.",
        choices=tuple(RULES),
    )
    policy: Any = option(
        "auto",
        help=(
            "Policy: auto, {names} or MODULE:ATTRIBUTE. Options of a policy follow a colon, as in"
            " closest-frontier:ties=row-major, manual:llurr or model:FILE. The policy offline is for coverage"
            " only, and pairwise and gather-beam are for gathering. auto stands for best if the task"
            " is mapping with a scan after each move and with rule block or merge, on huge maps with"
            " a smaller budget, for gather-beam in a gathering (for pairwise on maps of more than"
            " 6000 cells), and for closest-frontier in all other cases."
        ),
        **_registry_field(_policies),
    )
    budget: float | None = option(
        None,
        help=(
            "For the planners best and offline: mean number of simulated moves for each move sent,"
            " with 1000 particles. The planner best multiplies the budget by up to 10 with fewer"
            " than 1000 particles, and by up to 4 with more than 1000 particles."
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
        CONFIDENCE,
        help=(
            "Under noise: probability from which a cell counts as known to be free, or as known to"
            " be an obstacle."
        ),
        above=1 - PRIOR,
        most=SUREST,
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
        LOW,
        help=(
            "With --vessels: lower threshold of the filter response, as a multiple of the automatic"
            " threshold. A vessel ends where its response falls below the lower threshold."
        ),
        above=0,
        most=10,
    )
    high: float = option(
        HIGH,
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
    threshold: float | None = option_of(MapOptions, "threshold")
    invert: bool = option_of(MapOptions, "invert")
    scale: float = option_of(MapOptions, "scale")
    join_diagonals: bool = option_of(MapOptions, "join_diagonals")
    level: float | None = option_of(MapOptions, "level")
    label: int | None = option_of(MapOptions, "label")
    channel: int | str | None = option_of(MapOptions, "channel")
    frame: int | None = option_of(MapOptions, "frame")
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
        dump=lambda value: list(value) if isinstance(value, tuple) else value,
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
            n_start = self.particles if isinstance(self.start, Inlet) else len(self.start)
            if "particles" in self.given and self.particles != n_start:
                raise InvalidInputError(
                    f"particles: expected {n_start}, the number of start cells, got"
                    f" {self.particles}"
                )
            object.__setattr__(self, "particles", n_start)
        if self.subset is not None and self.task not in ("coverage", "subset-coverage"):
            task = _name_for_people(self.task)
            raise InvalidInputError(
                f"subset: expected the task coverage together with a subset, got the task {task}"
            )
        if self.target is not None:
            if self.subset is not None:
                raise InvalidInputError("target: expected target cells or a subset, got both")
            if "task" in self.given and self.task not in ("target", "coverage"):
                raise InvalidInputError(
                    "target: expected the task target together with target cells, got the task"
                    f" {_name_for_people(self.task)}"
                )
        elif self.task == "target":
            raise InvalidInputError(
                "target: expected cells together with the task target, such as '0,3', got none"
            )
        if self.task_name == "gathering":
            if self.region is None and "rule" not in self.given:
                object.__setattr__(self, "rule", "merge")
        elif self.region is not None:
            raise InvalidInputError(
                "region: expected the task gathering together with a region, got the task"
                f" {self.task_name}"
            )
        if self.budget is not None and self.time_per_move is not None:
            raise InvalidInputError("budget: expected a budget or a time per move, got both")
        if not self.noise:
            stated = self.given & {"slip", "misplace", "miss"} or self.map == RIG
            if "confidence" in self.given and not stated:
                raise InvalidInputError(
                    "confidence: expected a confidence only together with noise (slip, misplace or"
                    f" miss), got {self.confidence:g}"
                )
            return
        object.__setattr__(self, "measures", (*self.measures, *NOISE_MEASURES))
        if self.rule != "block" and not (self.rule == "merge" and self.map == RIG):
            raise InvalidInputError(f"noise: expected rule block, got {self.rule}")
        if self.task_name != "mapping" and self.map != RIG:
            raise InvalidInputError(f"noise: expected the task mapping, got {self.task_name}")
        if isinstance(self.scan_every, str):
            raise InvalidInputError(
                "noise: expected scan-every as a number of commands, because no outcome is certain"
                f" beforehand, got {self.scan_every}"
            )

    def to_dict(self, *, defaults: bool = False) -> dict[str, Any]:
        """Return the problem's fields and its ``kind`` as JSON data, without a placement if the
        problem has start cells, which exclude it.
        """
        fields = super().to_dict(defaults=defaults)
        if self.start is not None:
            fields.pop("placement", None)
        return fields

    @cached_property
    def scanning(self) -> ScanRule:
        """The problem's scan rule, with the costs of scans and moves."""
        return ScanRule.parse(self.scan_every, scan_cost=self.scan_cost, move_cost=self.move_cost)

    @cached_property
    def noise(self) -> Noise | None:
        """The noise model of the problem, or None for a problem without noise."""
        return Noise(self.slip, self.misplace, self.miss) or None

    @property
    def task_name(self) -> str:
        """Name of the task. The property returns the name of a third-party task without importing
        the task.
        """
        if self.subset is not None:
            return "subset-coverage"
        if self.target is not None:
            return "target"
        name = _name_for_people(self.task)
        return name.partition(":")[0] if name.startswith("subset-coverage:") else name

    @property
    def placement_name(self) -> str:
        """Name of the placement, or "given" if the problem has start cells."""
        if self.start is not None:
            return "inlet" if isinstance(self.start, Inlet) else "given"
        return _name_for_people(self.placement)

    @cached_property
    def setup(self) -> SwarmSetup:
        """The map, the task and the policy of the problem, opened and checked together.

        Raises
        ------
        InvalidInputError, UnknownNameError
            Raised if a name is unknown, if the task, the map or the rules exclude the policy, if a
            start cell is not free, or if there are more particles than free cells.
        """
        from shoal.swarm.policies import Offline, check_gathers, check_rules, check_scanning

        workspace: GridWorkspace = self.place
        if self.target is not None:
            task: Task = Target(self.target)
        elif self.task == "gathering":
            task = Gathering(self.region or ())
        else:
            task = make_task(self.task) if self.subset is None else SubsetCoverage(self.subset)
        setup = SwarmSetup(self, workspace, task, *self._choose_policy(workspace, task))
        if isinstance(setup.policy, Offline) and setup.mapping:
            raise InvalidInputError(
                "policy offline: expected a task whose map is known, such as coverage, got a"
                " mapping"
            )
        check_gathers(setup.policy, gathering=isinstance(task, Gathering))
        check_rules(setup.policy, GridLayout(workspace.shape), self.rule)
        check_scanning(self.scanning, setup.policy, self.rule)
        if isinstance(self.start, Inlet) and self.map != RIG:
            self.start.check(workspace)
        if isinstance(self.start, tuple):
            check_start(workspace, self.start, rule=self.rule)
        elif self.particles > workspace.n_free and self.map != RIG:
            raise InvalidInputError(
                f"particles: expected 1 to {workspace.n_free} (the free cells of {workspace.name}),"
                f" got {self.particles}"
            )
        return setup

    def _choose_policy(self, workspace: GridWorkspace, task: Task) -> tuple[Policy, bool]:
        """Return the policy, and whether it is ``auto`` and the size of the map decided."""
        from shoal.swarm.grid.pairs import MOST_CELLS
        from shoal.swarm.policies import make_policy, with_budget
        from shoal.swarm.policies.planners.beam_rollout import fit_planner

        options = {"budget": self.budget, "milliseconds": self.time_per_move}
        limits = {name: value for name, value in options.items() if value is not None}
        if isinstance(task, Gathering) and isinstance(self.policy, str):
            name = "gather-beam" if self.policy in ("auto", "best") else self.policy
            if self.policy == "auto" and workspace.n_free > MOST_CELLS and self.rule == "merge":
                name = "pairwise"
            return with_budget(make_policy(name), **limits), False
        if not isinstance(self.policy, str) or self.policy != "auto":
            return with_budget(make_policy(self.policy), **limits), False
        plannable = isinstance(task, Mapping) and self.rule != "tilt" and self.scanning.every_move
        if plannable and not limits and self.map != RIG:
            size = (workspace.shape, workspace.n_free, self.particles)
            fitting = fit_planner(*size, noisy=self.noise is not None)
            return fitting or make_policy("closest-frontier"), True
        # only planners have limits
        best = plannable or (bool(limits) and isinstance(task, Mapping))
        return with_budget(make_policy("best" if best else "closest-frontier"), **limits), False

    @property
    def reading(self) -> dict[str, Any]:
        """The given options for reading the map, by name."""
        return {name: getattr(self, name) for name in READING if name in self.given}

    def open_place(self) -> GridWorkspace:
        """Open the problem's map and return the workspace."""
        from shoal.swarm.maps.files import open_map

        workspace = open_map(self.map, **self.reading)
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

    def place_files(self) -> tuple[str, ...]:
        """Return the file or the folder of the problem's map, if it has one."""
        # unlike Path.exists, it accepts names of any length
        return (self.map,) if isinstance(self.map, str) and os.path.exists(self.map) else ()

    def place_digest(self) -> bytes:
        """Return the shape and the free cells of the map as bytes."""
        return repr(self.place.shape).encode() + bytes(self.place.free.tobytes())

    def other_files(self) -> dict[str, bytes]:
        """Return the content of the file of a policy that is a neural network."""
        from shoal.swarm.policies import Model

        policy = self.setup.policy
        return {policy.name: policy.content()} if isinstance(policy, Model) else {}

    def check_at_place(self) -> None:
        """Refuse a policy that the task, map or rules exclude, start cells that are not free, and
        more particles than free cells.
        """
        assert self.setup


@dataclass(frozen=True, eq=False)
class SwarmSetup:
    """The things that a swarm problem names, each opened once. A run takes them from here.

    Parameters
    ----------
    problem : SwarmProblem
    workspace : GridWorkspace
        The map. Of a rig, only the shape has a meaning.
    task : Task
    policy : Policy
        The policy that the problem names, or that ``auto`` stands for.
    by_size : bool
        Whether the policy is ``auto``, and the size of the map decided about it.
    """

    problem: SwarmProblem
    workspace: GridWorkspace
    task: Task
    policy: Policy
    by_size: bool

    @property
    def mapping(self) -> bool:
        """Whether the map is unknown at the start."""
        return bool(getattr(self.task, "mapping", True))

    @property
    def policy_name(self) -> str:
        """Name of the policy for output that people read."""
        from shoal.swarm.policies import display_name

        return display_name(self.policy, self.problem.policy)

    def draw_start(self, rng: Generator) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None]:
        """Return the start cells (int64, shape (n, ndim)), and the mask of the target cells, or
        None for a task without target cells.

        Start cells that the problem gives are not drawn.
        """
        problem = self.problem
        if not isinstance(problem.start, tuple):
            placement = problem.start or problem.placement
            start = place(self.workspace, problem.particles, placement, rng)
        else:
            start = check_start(self.workspace, problem.start, rule=problem.rule)
        return start, self.task.choose_targets(self.workspace, rng)
