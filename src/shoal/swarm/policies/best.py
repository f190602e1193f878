"""best: the planner."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

from shoal.swarm.policies.planner import PlannerPolicy


@dataclass(frozen=True)
class Best(PlannerPolicy):
    """dev."""

    kind: ClassVar[str] = "best"
    code: ClassVar[int] = 7
    budget: float = 1e9
    few: float = 200.0
    horizon: float = 150.0
    discount: float = 0.99
    near: float = 60.0
    neardiscount: float = 0.98
    share: float = 30.0
    width: float = 24.0
    depth: float = 12.0
    leaves: float = 6.0
    ahead: float = 0.0
    rate: float = 0.9
    cap: float = 8.0
    variations: float = 8.0
    charge: float = 1.0
    likely: float = 0.75
    layers: float = 12.0
    runs_: float = 1.0
    renew: float = 8.0
    patience: float = 450.0
    sure: float = 0.0

    @property
    def settings(self) -> tuple[float, ...]:
        return tuple(getattr(self, f.name) for f in fields(self))
