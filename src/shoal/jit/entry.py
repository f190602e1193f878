"""Kernels in the form that Python calls, and a stopwatch that does not count their compilation.

Shoal loads the machine code of a kernel from the cache, without Numba. If the cache does not
contain the kernel, LLVM makes machine code of the kernel's lowered code in an archive; if no archive
contains the kernel either, Numba compiles it.
"""

from __future__ import annotations

import os
import pickle
import threading
import time
from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any

from shoal.core.notices import tell_once
from shoal.jit.cache import load_machine_code, save_machine_code
from shoal.jit.loader import kinds_of_arguments, link, numba_is_tested
from shoal.jit.lowered import is_lowered, is_recording, load_lowered, note_lowered

COMPILING = "compiling kernels: once after an installation, some seconds for each kind of run ..."
PLAIN = "SHOAL_PLAIN_KERNELS"
"""Name of the environment variable with which Numba alone compiles and calls kernels, in each
process again.
"""

_lock = threading.RLock()
_times = threading.local()


class Kernel:
    """A function that Shoal compiles at its first call. A call from Python runs the function's own
    machine code.

    If another kernel calls the function, the code of the function becomes a part of the code of the
    caller.
    """

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        update_wrapper(self, function)
        self.function, self.options = function, options
        self._loaded: dict[Any, Callable[..., Any]] = {}  # machine code, by the argument types

    def __call__(self, *arguments: Any) -> Any:
        """Call the kernel. The first call for each combination of argument types loads or compiles
        the kernel.
        """
        try:
            kinds = kinds_of_arguments(arguments)
        except TypeError:  # only Numba can tell the types
            return self._compile(arguments)(*arguments)
        compiled = self._loaded.get(kinds)
        if compiled is None:
            with _lock, Compiling():
                stored = not _is_plain() and (not is_recording() or is_lowered(self, kinds))
                compiled = load_machine_code(self, kinds) if stored else None
                self._loaded[kinds] = compiled = compiled or self._compile(arguments, kinds)
        return compiled(*arguments)

    def _compile(self, arguments: tuple[Any, ...], kinds: Any = None) -> Any:
        """Compile the kernel for some arguments, store the machine code, and return the compiled
        function.
        """
        with _lock, Compiling():
            tell_once(COMPILING)
            if _is_plain():
                return self.entry
            lowered = None if kinds is None else load_lowered(self, kinds)
            if lowered is not None:
                save_machine_code(self, kinds, pickle.dumps(lowered))
                return link(lowered, self.function)
            entry, machine_code, lowered_code = self._forms.compile(arguments)
            if machine_code is not None and kinds is not None:
                save_machine_code(self, kinds, machine_code)
                note_lowered(self, kinds, lowered_code)
            return entry

    @cached_property
    def _forms(self) -> Any:
        from shoal.jit import compiler  # imported only here, because the import of Numba is slow

        return (compiler.PlainForms if _is_plain() else compiler.CompiledForms)(
            self.function, **self.options
        )

    @property
    def entry(self) -> Any:
        """Numba's compiled form of the kernel that Python calls."""
        return self._forms.entry

    @property
    def _numba_type_(self) -> Any:
        """The Numba type of this kernel in compiled code."""
        return self._forms.part_type

    def __reduce__(self) -> str:
        # pickle adds the name of the module
        return self.__qualname__  # type: ignore[attr-defined, no-any-return]


def _is_plain() -> bool:
    return bool(os.environ.get(PLAIN)) or not numba_is_tested()


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


class Compiling:
    """A context manager that measures the time for loading or compiling kernels. The time of nested
    blocks counts only once.
    """

    def __enter__(self) -> None:
        _times.depth = getattr(_times, "depth", 0) + 1
        if _times.depth == 1:
            _times.began = time.perf_counter()

    def __exit__(self, *error: object) -> None:
        _times.depth -= 1
        if _times.depth == 0:
            _times.spent = seconds_compiling() + time.perf_counter() - _times.began


def seconds_compiling() -> float:
    """Return how many seconds the current thread has spent on loading and compiling kernels."""
    return float(getattr(_times, "spent", 0.0))


def working_time() -> float:
    """Return seconds on a clock that stands still while the current thread loads or compiles
    kernels; its zero has no meaning.

    Time limits are compared with this clock. On any other clock, a limit of two seconds is over
    before a first use has compiled its kernels.
    """
    return time.perf_counter() - seconds_compiling()


class Stopwatch:
    """Measure the time since the creation of the stopwatch, without the time for loading and
    compiling kernels.

    Examples
    --------
    >>> watch = Stopwatch()
    >>> 0 <= watch.seconds < 1
    True
    """

    def __init__(self) -> None:
        self._began = working_time()

    @property
    def seconds(self) -> float:
        """Return the seconds since the creation of the stopwatch, without the time for loading and
        compiling kernels.
        """
        return working_time() - self._began
