"""Kernels as Python calls them. The machine code of a kernel comes from the cache, without Numba.

Numba compiles a kernel only if the cache does not contain the kernel.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any

from shoal.jit.machine_code import kinds_of_arguments, load_machine_code
from shoal.jit.watch import Compiling

_lock = threading.RLock()


class Kernel:
    """A function to be compiled. A call from Python runs the kernel's entry.

    A call from another kernel makes the kernel a part of the caller.
    """

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        update_wrapper(self, function)
        self._function, self._options = function, options
        self._loaded: dict[Any, Callable[..., Any]] = {}  # by the kinds of the arguments

    def __call__(self, *arguments: Any) -> Any:
        """Call the entry. The first call for each combination of argument types loads or compiles the kernel."""
        try:
            kinds = kinds_of_arguments(arguments)
        except TypeError:
            return self.entry(*arguments)
        found = self._loaded.get(kinds)
        if found is None:
            with _lock, Compiling():
                found = self._loaded[kinds] = load_machine_code(self._function, kinds) or self._compile(kinds, arguments)
        return found(*arguments)

    def _compile(self, kinds: Any, arguments: tuple[Any, ...]) -> Any:
        self.entry._cache.kinds = kinds
        return self.entry.compile(tuple(self.entry.typeof_pyval(one) for one in arguments))

    @cached_property
    def _forms(self) -> Any:
        from shoal.jit.compiler import CompiledForms  # Numba is slow to import

        return CompiledForms(self._function, **self._options)

    @property
    def entry(self) -> Any:
        """The compiled function that Python calls."""
        return self._forms.entry

    @property
    def _numba_type_(self) -> Any:
        """The Numba type of this kernel in compiled code."""
        return self._forms.part_type

    def __reduce__(self) -> str:
        return self.__qualname__  # type: ignore[attr-defined, no-any-return]  # which module it is in, pickle knows


def _named_apart(function: Callable[..., Any]) -> None:
    """Add the names of the enclosed kernels to the name of a kernel that was made inside a function.

    Machine code is linked by name. Numba distinguishes such kernels by a number that starts again in each process. Without this
    name, a kernel from the cache could be confused with another one that the process compiles.
    """
    if "<locals>" in function.__qualname__:
        made_of = [cell.cell_contents for cell in function.__closure__ or ()]
        names = [one.__qualname__.split(".")[-1] if callable(one) else repr(one) for one in made_of]
        function.__qualname__ = f"{function.__qualname__}_{'_'.join(names)}"


def _compiled(function: Callable[..., Any], **options: bool) -> Any:
    _named_apart(function)
    return function if int(os.environ.get("NUMBA_DISABLE_JIT") or 0) else Kernel(function, **options)


def kernel(function: Callable[..., Any]) -> Any:
    """Mark a function for compilation at its first call."""
    return _compiled(function)


def in_place_kernel(function: Callable[..., Any]) -> Any:
    """Mark a function for compilation without reference counting. The function must not create arrays."""
    return _compiled(function, _nrt=False)
