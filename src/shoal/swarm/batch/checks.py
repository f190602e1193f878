"""Checks of the arguments of batches. Each check returns the checked value, or raises an error with a one-sentence message."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.swarm.problem import SwarmProblem

LARGEST = 2**62
ALIKE = ("rule", "task", "slip", "misplace", "miss", "confidence")
"""Names of the problem fields that must be equal in all problems of a batch."""


def check_problems(problems: list[SwarmProblem]) -> None:
    """Refuse problems that Shoal cannot simulate in one batch."""
    if not problems or not all(isinstance(one, SwarmProblem) for one in problems):
        raise InvalidInputError(f"problem: expected a SwarmProblem, or several, got {shortened(problems)}")
    first = problems[0]
    for one in problems:
        one.check_at_place()
        for name in ALIKE:
            mine, theirs = getattr(first, name), getattr(one, name)
            if mine != theirs:
                raise InvalidInputError(
                    f"problems: expected the same {name} in all of them, got {shortened(mine)} and {shortened(theirs)}"
                )


def check_out(out: Any, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return the array ``out`` after checking its dtype and shape. If ``out`` is None, return a new uint8 array."""
    if out is None:
        return np.empty(shape, dtype=np.uint8)
    good = isinstance(out, np.ndarray) and out.dtype == np.uint8 and out.shape == shape
    if not good or not out.flags.c_contiguous or not out.flags.writeable:
        got = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else shortened(out)
        if good:
            got += ", which is not contiguous" if not out.flags.c_contiguous else ", which cannot be written to"
        raise InvalidInputError(f"out: expected a C-contiguous array of uint8 {shape}, got {got}")
    filled: NDArray[np.uint8] = out
    return filled


def check_where(where: Any, count: int) -> NDArray[np.int64]:
    """Return the indices of the worlds that the mask ``where`` selects."""
    mask = np.asarray(where)
    if mask.dtype != np.bool_ or mask.shape != (count,):
        raise InvalidInputError(f"where: expected {count} booleans, one per world, got {mask.dtype} {mask.shape}")
    return mask.nonzero()[0]


def check_numbers(
    given: Any, chosen: NDArray[np.int64], count: int, *, what: str, least: int, below: int = LARGEST, single: bool = True
) -> NDArray[np.integer[Any]]:
    """Return one whole number for each selected world. If ``single`` is true, one number may stand for all worlds.

    ``chosen`` contains the indices of the selected worlds. The check ignores the numbers of worlds that are not selected.
    """
    numbers = np.asarray(given)
    if numbers.dtype.kind not in "iu" or not ((single and numbers.ndim == 0) or numbers.shape == (count,)):
        raise InvalidInputError(f"{what}: expected {count} whole numbers, one per world, got {numbers.dtype} {numbers.shape}")
    if numbers.ndim == 0:
        numbers = np.full(len(chosen), numbers)
    elif len(chosen) < count:
        numbers = numbers[chosen]
    if len(chosen) and not least <= numbers.min() <= numbers.max() < below:
        bad = int(np.argmax((numbers < least) | (numbers >= below)))
        expected = f"{least} to {below - 1}" if below < LARGEST else f"{least} or more"
        raise InvalidInputError(f"{what}: expected {expected}, got {numbers[bad]} for world {chosen[bad]}")
    return numbers
