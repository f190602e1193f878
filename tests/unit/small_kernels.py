"""Two kernels in a file of their own, quick to compile, for the tests of the cache."""

from __future__ import annotations

import sys
from math import cos, sin, tan

import numpy as np

from shoal.core import notices

if __name__ == "__main__":  # as commands do, before any kernel is imported
    notices.listeners.append(lambda text: print(text, file=sys.stderr))

from shoal.jit import kernel


@kernel
def double(numbers):
    """Return twice each number."""
    out = np.empty_like(numbers)
    for k in range(len(numbers)):
        out[k] = 2 * numbers[k]
    return out


@kernel
def total(numbers):
    """Return the sum of twice each number."""
    found = 0
    for number in double(numbers):
        found += number
    return found


def made_of(change):
    """Return a kernel that is made of another one, as those of policies are."""

    @kernel
    def changed(numbers):  # too long to be put into its caller
        for k in range(len(numbers)):
            one = numbers[k]
            numbers[k] = (
                sin(one)
                + cos(one)
                + tan(one)
                + sin(2 * one)
                + cos(3 * one)
                + tan(4 * one)
                + sin(5 * one)
                + cos(6 * one)
            )
            numbers[k] += (
                sin(7 * one)
                + cos(8 * one)
                + tan(9 * one)
                + sin(10 * one)
                + cos(11 * one)
                + tan(12 * one)
                + sin(13 * one)
            )
            numbers[k] += (
                sin(14 * one)
                + cos(15 * one)
                + tan(16 * one)
                + sin(17 * one)
                + cos(18 * one)
                + tan(19 * one)
            )
        return change(numbers[0])

    return changed


@kernel
def add_one(number):
    """Return one more."""
    return number + 1


@kernel
def add_nine(number):
    """Return nine more."""
    return number + 9


_one_more, _nine_more = made_of(add_one), made_of(add_nine)


@kernel
def one_more(numbers):
    """Return one more than the sum of first numbers."""
    return _one_more(numbers) + 0 * _one_more(numbers)


@kernel
def nine_more(numbers):
    """Return nine more than the sum of first numbers."""
    return _nine_more(numbers) + 0 * _nine_more(numbers)


if __name__ == "__main__" and sys.argv[1:2] == ["made"]:
    made = {"one": one_more, "nine": nine_more}
    print(*(int(made[name](np.zeros(4))) for name in sys.argv[2:]))
    print("made")
elif __name__ == "__main__":
    kinds = {"int": np.int64, "float": np.float64, "short": np.int16}
    print(*(float(total(np.arange(4).astype(kinds[name]))) for name in sys.argv[1:] or ["int"]))
    print("compiled" if total.entry.overloads else "loaded")
