"""Trials of swarms on maps."""

from __future__ import annotations

import json
from typing import Any, Literal

from pydantic import Field, FiniteFloat, StrictInt

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import Problem, Values, is_file


class SwarmProblem(Problem):
    """Mapping or coverage of a map by a swarm: the arguments of `shoal.swarm.run` and of `shoal.swarm.maps.open.open_map`."""

    measures = ("status", "moves", "scans", "cost", "distance")

    kind: Literal["swarm"]
    map: str
    particles: StrictInt = Field(default=100, ge=1)
    task: str = "mapping"
    policy: str = "closest-frontier"
    placement: str = "uniform"
    rule: str = "block"
    max_moves: StrictInt = Field(default=1_000_000, ge=1)
    scan_every: StrictInt | str = 1
    scan_cost: FiniteFloat = 10.0
    move_cost: FiniteFloat = 1.0
    vessels: bool = False
    width: StrictInt | None = None
    threshold: FiniteFloat = 0.5
    invert: bool = False
    scale: FiniteFloat = 1.0
    largest_component: bool = False

    def source(self) -> str:
        """Return the map, and how it is read."""
        fields = ("map", "vessels", "width", "threshold", "invert", "scale", "largest_component")
        return json.dumps(self.model_dump(include={*fields}, exclude_defaults=True), sort_keys=True)

    def opened(self) -> Any:
        """Return the workspace."""
        from shoal.swarm.maps.open import open_map

        workspace = open_map(
            self.map, vessels=self.vessels, width=self.width, threshold=self.threshold, invert=self.invert, scale=self.scale
        )
        return workspace.largest_component() if self.largest_component else workspace

    def digest(self, opened: Any) -> bytes:
        """Return the shape and the free cells."""
        return bytes(repr(opened.shape).encode() + opened.free.tobytes())

    def is_file(self) -> bool:
        """Tell whether the map is a file."""
        return is_file(self.map)

    def check(self, opened: Any) -> None:
        """Refuse unknown names, and more particles than cells."""
        from shoal.swarm import PLACEMENTS, RULES, make_policy, make_task
        from shoal.swarm.grid.scans import ScanRule

        make_policy(self.policy), make_task(self.task)
        PLACEMENTS.get(self.placement)
        ScanRule.parse(self.scan_every, scan_cost=self.scan_cost, move_cost=self.move_cost)
        if self.rule not in RULES:
            raise InvalidInputError(f"rule: expected one of {', '.join(RULES)}, got {self.rule!r}")
        if self.rule != "merge" and self.particles > opened.n_free:
            raise InvalidInputError(
                f"particles: expected at most {opened.n_free}, the free cells of {opened.name}, got {self.particles}"
            )

    def play(self, opened: Any, seed: int) -> Values:
        """Play an episode; ``shoal map`` with this seed plays the same one."""
        from shoal.swarm.problem import SwarmProblem as Declared
        from shoal.swarm.run import run

        problem = Declared(
            opened, task=self.task, policy=self.policy, particles=self.particles, placement=self.placement, rule=self.rule,
            max_moves=self.max_moves, scan_every=self.scan_every, scan_cost=self.scan_cost, move_cost=self.move_cost,
        )  # fmt: skip
        metrics = run(problem, seed=seed).metrics
        return [metrics[name] for name in self.measures]
