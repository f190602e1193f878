"""What packages offer says of each of its parameters what it is."""

from __future__ import annotations

import inspect
import re

import pytest

import shoal
import shoal.envs
import shoal.lab
import shoal.missions
import shoal.rigs
import shoal.search
import shoal.steering
import shoal.swarm
import shoal.views

PACKAGES = [
    shoal,
    shoal.envs,
    shoal.lab,
    shoal.search,
    shoal.missions,
    shoal.rigs,
    shoal.steering,
    shoal.swarm,
    shoal.views,
]
OFFERED = {
    f"{package.__name__}.{name}": getattr(package, name)
    for package in PACKAGES
    for name in package.__all__
}


def is_told_elsewhere(found):
    """Tell whether parameters are fields with a help of their own, or there are none but those of
    Python.
    """
    return isinstance(found, type) and (
        issubclass(found, Exception | str)
        or getattr(found, "_is_protocol", False)
        or hasattr(found, "declarations")
    )


@pytest.mark.parametrize("name", sorted(name for name, found in OFFERED.items() if callable(found)))
def test_all_parameters_are_described(name):
    found = OFFERED[name]
    if is_told_elsewhere(found):
        return
    told = found.__doc__ or ""
    names = [
        one
        for one in inspect.signature(found).parameters
        if one not in ("self", "cls") and not one.startswith("_")
    ]
    assert [one for one in names if not re.search(rf"\b{re.escape(one)}\b", told)] == []
