"""The checker of certificates of steering: exact, and without any code of the search."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from math import isfinite
from typing import Any

from shoal.core.episode import Verification
from shoal.steering.certificates.check import _Task, _values, _WrongError
from shoal.steering.certificates.check_moves import proven_moves
from shoal.steering.certificates.check_routes import route_values

KIND = "steering certificate"
_SIZES = ("lower_bound", "unit", "limit", "tolerance", "radius", "height")
_PLACES = ("center", "corners", "rings", "start", "goal", "directions")
_ROUND = {"center", "radius", "directions"}
_SOLID = {"height", "open_ends"}
_WORKSPACES = ({"corners"}, {"corners", *_SOLID}, _ROUND, {*_ROUND, *_SOLID}, {"rings"})
"""Fields of the workspaces. With those of two, a proof for one could be taken for the other's."""
_FIELDS = {
    *("kind", "start", "goal", "tolerance", "interchangeable", "limit", "unit", "lower_bound"),
    "trees",
}
_FIELDS_OF_PROOFS = {
    *("order", "proof", "proofs", "lower_bound"),
    *("place", "name", "wall", "known", "side", "choices"),  # cases of patterns
    *("norms", "slacks", "cones", "legs", "rounds"),  # multipliers
    *("covers", "ways", "cell", "nodes", "closed", "node", "door", "ends", "contact"),
    *("move", "particle"),
    *("potential", "cases", "squares", "zero", "holds", "limit", "parts", "direction"),
}
_MOST_NUMBERS = 100_000  # of the problem that a certificate states


def check_certificate(certificate: Mapping[str, Any]) -> Verification:
    """Check in exact arithmetic that no plan is shorter than the bound of a certificate, and that
    none has fewer moves, if it bounds these, too.

    The check uses only the certificate, which holds the workspace, the starts, the goals and the
    tolerance for which it is valid. The check computes the bound of every leaf of the proof again
    from its multipliers, and derives all cases that a proof must treat.

    Parameters
    ----------
    certificate : mapping
        The JSON object that `shoal.steering.certify` returns as `Certificate.proof`.
    """
    try:
        _check_numbers([certificate[name] for name in _SIZES if name in certificate], deepest=1)
        _check_numbers([certificate[name] for name in _PLACES if name in certificate], deepest=4)
        stated = set[str]().union(*_WORKSPACES) & set(certificate)
        if stated not in _WORKSPACES:
            raise _WrongError(f"expected the fields of one workspace, got {sorted(stated)}")
        _check_fields(certificate, _FIELDS | stated | _fields_of(stated))
        _check_proof_fields([certificate["trees"], certificate.get("moves", [])])
        if certificate["kind"] != KIND:
            raise _WrongError(f"expected the kind {KIND!r}, got {str(certificate['kind'])[:40]!r}")
        dimensions = 3 if "height" in certificate else 2
        for name in ("start", "goal"):
            if [len(place) for place in certificate[name]] != [dimensions] * 2:
                raise _WrongError(f"{name}: expected two places of {dimensions} coordinates")
        if len(certificate.get("center", [0, 0])) != 2:
            raise _WrongError("center: expected two coordinates")
        bound, limit = Fraction(certificate["lower_bound"]), Fraction(certificate["limit"])
        if bound > limit:
            raise _WrongError("the bound is above the limit")
        by_routes = "rings" in certificate or "height" in certificate
        orders = [tree["order"] for tree in certificate["trees"]]
        needed = [[1, 2], [2, 1]] if certificate["interchangeable"] else [[1, 2]]
        if sorted(orders) != needed:
            raise _WrongError(f"expected proofs for the orders {needed}, got {orders}")
        count = 0
        for tree in certificate["trees"]:
            values = (
                route_values(certificate, tree)
                if by_routes
                else _values(_Task(certificate, tree["order"]), tree["proof"])
            )
            for value in values:
                count += 1
                if value < bound and bound > 0:  # no length is negative
                    raise _WrongError(
                        f"a leaf proves {float(value):.9g}, less than {float(bound):.9g}"
                    )
        least_moves = proven_moves(certificate) if "moves" in certificate else 0
    except _WrongError as error:
        return Verification(False, f"the certificate is wrong: {error}")
    except KeyError as error:
        return Verification(False, f"the certificate is incomplete: it has no {error.args[0]!r}")
    except (TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        return Verification(False, f"the certificate is wrong: a field is no such value: {error}")
    message = (
        f"{count} cases, of all plans up to the limit {float(limit):.9g}, prove that no plan is"
        f" shorter than {float(bound):.9g}"
    )
    if least_moves:
        message += f", and none has fewer than {least_moves} moves"
    return Verification(True, message)


def _fields_of(workspace: set[str]) -> set[str]:
    """Return the fields of certificates of a workspace beside those of the workspace."""
    if "rings" in workspace:
        return {"cells", "hull"}
    if "height" in workspace:
        return set()
    return {"runs", "moves"} if "corners" in workspace else {"runs"}


def _check_proof_fields(proofs: Any) -> None:
    """Refuse a field that no proof has: it would have no effect on the bound."""
    stack = [proofs]
    while stack:
        item = stack.pop()
        if isinstance(item, Mapping):
            _check_fields(item, _FIELDS_OF_PROOFS)
            item = list(item.values())
        stack += [part for part in item if isinstance(part, Mapping | list | tuple)]


def _check_fields(item: Mapping[str, Any], known: set[str]) -> None:
    if unknown := set(item) - known:
        raise _WrongError(f"expected no field {min(unknown, key=str)!r}")


def _check_numbers(value: Any, *, deepest: int) -> int:
    """Refuse anything but numbers, in lists at most ``deepest`` levels deep; return their count."""
    if deepest and isinstance(value, list | tuple):
        count = 0
        for item in value:
            count += _check_numbers(item, deepest=deepest - 1)
            if count > _MOST_NUMBERS:
                raise _WrongError(f"expected at most {_MOST_NUMBERS} numbers in a problem")
        return count
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise _WrongError(f"expected numbers in the problem, got {str(value)[:40]}")
    return 1
