"""Base class of problems whose trials return measures instead of episodes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.core.problem import Problem


@dataclass(frozen=True, eq=False)
class MeasuredProblem(Problem, ABC):
    """A problem whose trials return measures instead of episodes."""

    @abstractmethod
    def trial(self, seed: int) -> dict[str, Any]:
        """Run one trial and return the measures of the trial by name."""
