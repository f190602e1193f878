"""Kernels in the form that Python calls. Shoal loads the machine code of a kernel from the cache,
without Numba.

Shoal imports Numba and compiles a kernel only if the cache does not contain the kernel.
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
    """A function that Shoal compiles at its first call. A call from Python runs the function's own
    machine code.

    If another kernel calls the function, the code of the function becomes a part of the code of the
    caller.
    """

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        update_wrapper(self, function)
        self._function, self._options = function, options
        self._loaded: dict[Any, Callable[..., Any]] = {}  # machine code, by the argument types

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel. The first call for each combination of argument types loads or compiles
        the kernel.
        """
        try:
            kinds = kinds_of_arguments(arguments)
        except TypeError:
            return self.entry(*arguments)
        found = self._loaded.get(kinds)
        if found is None:
            with _lock, Compiling():
                found = self._loaded[kinds] = load_machine_code(
                    self._function, kinds
                ) or self._compile(kinds, arguments)
        return found(*arguments)

    def _compile(self, kinds: Any, arguments: tuple[Any, ...]) -> Any:
        self.entry._cache.kinds = kinds
        return self.entry.compile(tuple(self.entry.typeof_pyval(one) for one in arguments))

    @cached_property
    def _forms(self) -> Any:
        from shoal.jit.compiler import (
            CompiledForms,  # imported only here, because the import of Numba is slow
        )

        return CompiledForms(self._function, **self._options)

    @property
    def entry(self) -> Any:
        """The compiled entry of the kernel: the form that Python calls."""
        return self._forms.entry

    @property
    def _numba_type_(self) -> Any:
        """The Numba type of this kernel in compiled code."""
        return self._forms.part_type

    def __reduce__(self) -> str:
        # pickle adds the name of the module
        return self.__qualname__  # type: ignore[attr-defined, no-any-return]


def _named_apart(function: Callable[..., Any]) -> None:
    """Make the name of a kernel unique if the kernel is defined inside a function.

    The unique name contains the names of the objects in the kernel's closure. The linker finds
    machine code by name. Numba distinguishes kernels with equal names by a number, which starts
    again in each process. Without unique names, the linker could confuse a kernel from the cache
    with a kernel that the process has compiled.
    """
    if "<locals>" in function.__qualname__:
        made_of = [cell.cell_contents for cell in function.__closure__ or ()]
        names = [one.__qualname__.split(".")[-1] if callable(one) else repr(one) for one in made_of]
        function.__qualname__ = f"{function.__qualname__}_{'_'.join(names)}"


def _compiled(function: Callable[..., Any], **options: bool) -> Any:
    _named_apart(function)
    return (
        function if int(os.environ.get("NUMBA_DISABLE_JIT") or 0) else Kernel(function, **options)
    )


def kernel(function: Callable[..., Any]) -> Any:
    """Return ``function`` as a `Kernel`, which Shoal compiles at its first call."""
    return _compiled(function)


def in_place_kernel(function: Callable[..., Any]) -> Any:
    """Return ``function`` as a `Kernel` without reference counting. The function must not create
    arrays.
    """
    return _compiled(function, _nrt=False)
