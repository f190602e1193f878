"""Policies: methods that choose the next commands of a swarm. A line in `POLICIES` makes a policy
known to commands, help, studio and docs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured
from shoal.swarm.policies.compiled import (
    ClosestFrontier,
    Compiled,
    DepthFirst,
    ElectParticle,
    Manual,
    RandomMoves,
    WallSweep,
    check_rules,
    check_scanning,
)
from shoal.swarm.policies.planners.beam_rollout import BeamRollout, GreedyClassify, PlannerPolicy
from shoal.swarm.policies.planners.offline import Offline
from shoal.swarm.policies.protocol import Decision, Policy, View

POLICIES: Registry[type[Policy]] = Registry("policy")
POLICIES.add("closest-frontier", ClosestFrontier)
POLICIES.add("elect-particle", ElectParticle)
POLICIES.add("random-moves", RandomMoves)
POLICIES.add("depth-first", DepthFirst)
POLICIES.add("sweep", WallSweep)
POLICIES.add("greedy-classify", GreedyClassify)
POLICIES.add("beam-rollout", BeamRollout)
POLICIES.add("manual", Manual)
POLICIES.add("offline", Offline)
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
        if name not in _fields_of(policy):
            able = [kind for kind in POLICIES if name in _fields_of(POLICIES.get(kind))]
            option = "budget" if name == "budget" else "time-per-move"
            raise InvalidInputError(
                f"{option}: expected a planner ({', '.join(able)}), got {policy.name}"
            )
        # a policy with this field is a dataclass
        policy = replace(policy, **{name: value})  # type: ignore[type-var]
    return policy


def _fields_of(policy: object) -> Collection[str]:
    return getattr(policy, "__dataclass_fields__", ())


__all__ = [
    "POLICIES",
    "BeamRollout",
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
    "View",
    "WallSweep",
    "check_rules",
    "check_scanning",
    "make_policy",
    "shown_name",
    "with_budget",
]
