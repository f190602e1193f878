"""Dataclasses with a one-line ``__repr__``, even for fields that hold large arrays."""

from __future__ import annotations

import dataclasses
import reprlib
from typing import TYPE_CHECKING, Any

__all__ = ["dataclass", "one_line"]

_COLLECTION = 6  # number of entries shown of a collection
_VALUE = 120  # number of characters shown of any other value


class _Brief(reprlib.Repr):
    """A short ``repr`` of values: it shows the dtype and shape of a large array, and the first
    entries of a collection.
    """

    def __init__(self) -> None:
        super().__init__()
        self.maxtuple = self.maxlist = self.maxdict = self.maxset = self.maxfrozenset = _COLLECTION
        self.maxother = self.maxstring = _VALUE

    def repr_ndarray(self, array: Any, _level: int) -> str:
        if array.size > _COLLECTION:
            return f"<{array.dtype} {'x'.join(map(str, array.shape))}>"
        return " ".join(repr(array).split())

    def repr_instance(self, value: Any, level: int) -> str:
        return " ".join(super().repr_instance(value, level).split())


_brief = _Brief().repr


def one_line(thing: Any) -> str:
    """Return the ``__repr__`` of a dataclass or named tuple: one line of text.

    Examples
    --------
    >>> import numpy as np
    >>> @dataclass
    ... class Path:
    ...     name: str
    ...     points: object
    >>> Path("a", np.zeros((90, 2)))
    Path(name='a', points=<float64 90x2>)
    """
    names = getattr(thing, "_fields", None) or [
        one.name for one in dataclasses.fields(thing) if one.repr
    ]
    return f"{type(thing).__name__}({', '.join(f'{name}={_brief(getattr(thing, name, None))}' for name in names)})"


if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(cls=None, /, *, repr=True, **options):  # noqa: A002 - as in dataclasses
        """Apply `dataclasses.dataclass` to a class. If the class defines no ``__repr__``, use
        `one_line` as its ``__repr__``.
        """

        def made(cls):
            if repr and "__repr__" not in vars(cls):
                cls.__repr__ = one_line
            return dataclasses.dataclass(cls, repr=False, **options)

        return made if cls is None else made(cls)
