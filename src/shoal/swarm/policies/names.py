"""The names of the policies. A line in `POLICIES` makes a policy known to commands, help, studio and
docs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured
from shoal.swarm import policies
from shoal.swarm.policies.protocol import Policy

POLICIES: Registry[type[Policy]] = Registry("policy")
POLICIES.add_later("closest-frontier", lambda: policies.ClosestFrontier)
POLICIES.add_later("elect-particle", lambda: policies.ElectParticle)
POLICIES.add_later("random-moves", lambda: policies.RandomMoves)
POLICIES.add_later("depth-first", lambda: policies.DepthFirst)
POLICIES.add_later("sweep", lambda: policies.WallSweep)
POLICIES.add_later("greedy-classify", lambda: policies.GreedyClassify)
POLICIES.add_later("beam-rollout", lambda: policies.BeamRollout)
POLICIES.add_later("manual", lambda: policies.Manual)
POLICIES.add_later("offline", lambda: policies.Offline)
POLICIES.add_later("model", lambda: policies.Model)
POLICIES.add_later("pairwise", lambda: policies.Pairwise)
POLICIES.add_later("gather-beam", lambda: policies.GatherBeam)
# an alias, which may denote another policy in a later version
POLICIES.add_later("best", lambda: policies.BeamRollout)


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
    instance = configured(POLICIES, policy) if isinstance(policy, str) else policy
    if not isinstance(instance, Policy):
        raise InvalidInputError(
            "policy: expected a name, or an object with a name and a method decide, got"
            f" {shortened(instance)}"
        )
    return instance


def display_name(policy: Policy, specification: str | Policy) -> str:
    """Return the name of a policy for output that people read.

    If ``specification`` is a text "module:attribute:options", the name ends with the options.

    Parameters
    ----------
    policy : Policy
        The policy object that a problem uses.
    specification : str or Policy
        The policy as the user named it.
    """
    module, *parts = specification.split(":", 2) if isinstance(specification, str) else ("",)
    options = parts[1] if len(parts) == 2 and module not in POLICIES else ""
    return (
        policy.name if not options or policy.name.endswith(options) else f"{policy.name}:{options}"
    )


def with_budget(policy: Policy, **limits: float) -> Policy:
    """Return a copy of the policy with new planning limits: ``budget`` in simulated moves per move,
    or ``milliseconds`` per move.

    Raises
    ------
    InvalidInputError
        Raised if the policy has no planning limit, or if a limit is out of range.
    """
    for name, value in limits.items():
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
