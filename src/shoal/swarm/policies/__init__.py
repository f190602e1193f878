"""Policies: methods that choose the next commands of a swarm."""

from __future__ import annotations

from dataclasses import replace

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured
from shoal.swarm.policies.compiled import (
    ClosestFrontier,
    Compiled,
    ElectParticle,
    RandomMoves,
    check_rules,
    check_scanning,
)
from shoal.swarm.policies.planners.beam_rollout import BeamRollout
from shoal.swarm.policies.planners.greedy_classify import GreedyClassify
from shoal.swarm.policies.planners.offline import Offline
from shoal.swarm.policies.planners.planner_policy import Budgeted, PlannerPolicy
from shoal.swarm.policies.planners.rollout import Rollout
from shoal.swarm.policies.protocol import Decision, Policy, View
from shoal.swarm.policies.walks import DepthFirst, Manual, WallSweep

POLICIES: Registry[type[Policy]] = Registry("policy")
for _policy in (
    ClosestFrontier,
    ElectParticle,
    RandomMoves,
    DepthFirst,
    WallSweep,
    GreedyClassify,
    Rollout,
    BeamRollout,
    Manual,
):
    POLICIES.add(_policy.kind, _policy)
POLICIES.add(Offline.kind, Offline)
POLICIES.add("best", BeamRollout)  # an alias, which may denote another policy in a later version


def make_policy(policy: str | Policy) -> Policy:
    """Return the policy object for a name. If ``policy`` is already a policy object, return this
    object.

    Parameters
    ----------
    policy : str or Policy
        A name such as "closest-frontier", "closest-frontier:ties=row-major" or "manual:llurr"; a
        text "module:attribute" that names a third-party object or class; or an object with the
        methods of `Policy`. If the attribute is a class, the policy is an object of this class,
        made without arguments.

    Raises
    ------
    UnknownNameError, InvalidInputError
    """
    made = configured(POLICIES, policy) if isinstance(policy, str) else policy
    if not isinstance(made, Policy):
        raise InvalidInputError(
            "policy: expected a name, or an object with a name and a method decide, got"
            f" {shortened(made)}"
        )
    return made


def shown_name(policy: Policy, given: str | Policy) -> str:
    """Return the name of a policy for output that people read.

    If ``given`` is a text "module:attribute:options", the name ends with the options.

    Parameters
    ----------
    policy : Policy
        The policy object that a problem uses.
    given : str or Policy
        The policy as the user named it.
    """
    module, *rest = given.split(":", 2) if isinstance(given, str) else ("",)
    added = rest[1] if len(rest) == 2 and module not in POLICIES else ""
    return policy.name if not added or policy.name.endswith(added) else f"{policy.name}:{added}"


def with_budget(policy: Policy, **wanted: float) -> Policy:
    """Return a copy of the policy with new planning limits: ``budget`` in simulated moves per move,
    or ``milliseconds`` per move.

    Raises
    ------
    InvalidInputError
        Raised if the policy has no planning limit, or if a limit is out of range.
    """
    for name, value in wanted.items():
        if name not in getattr(policy, "__dataclass_fields__", {}):
            able = "best, beam-rollout, rollout" + (" or offline" if name == "budget" else "")
            option = "budget" if name == "budget" else "time-per-move"
            raise InvalidInputError(f"{option}: expected a planner ({able}), got {policy.name}")
        # a policy with this field is a dataclass
        policy = replace(policy, **{name: value})  # type: ignore[type-var]
    return policy


__all__ = [
    "POLICIES",
    "BeamRollout",
    "Budgeted",
    "ClosestFrontier",
    "Compiled",
    "Decision",
    "DepthFirst",
    "ElectParticle",
    "GreedyClassify",
    "Manual",
    "Offline",
    "PlannerPolicy",
    "Policy",
    "RandomMoves",
    "Rollout",
    "View",
    "WallSweep",
    "check_rules",
    "check_scanning",
    "make_policy",
    "shown_name",
    "with_budget",
]
