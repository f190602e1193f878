"""What becomes of a kernel: a part of another one, or an entry that Python calls.

A kernel that other kernels call is only typed and lowered; what Python calls is optimized with all that it calls, once.
Numba's own way optimizes a kernel, and all below it, again at every level, makes machine code and a Python wrapper of each, and
caches each: two thirds of the time. docs/adr/0012-kernels-compiled-once.md has the measurements.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cached_property, update_wrapper
from typing import Any

from numba import _dynfunc, config, types  # type: ignore[attr-defined]
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

from shoal.jit.cache import cached
from shoal.jit.libraries import Entry, LinkedPart

_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


@register_pass(mutates_CFG=True, analysis_only=False)
class _EntryLowering(NativeLowering):
    """Lower a kernel that Python calls."""

    _name = "entry_lowering"
    library_class: type[Any] = Entry

    def run_pass(self, state: Any) -> bool:
        state.library = self.library_class(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(_EntryLowering):
    """Lower a kernel that other kernels call."""

    _name = "part_lowering"
    library_class = LinkedPart

    def run_pass(self, state: Any) -> bool:
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        libraries = (state.library,)
        key = _dynfunc.make_function(lowered.fndesc.lookup_module(), name, "", 0, lowered.env, libraries)  # never called
        state.targetctx.insert_user_function(key, lowered.fndesc, libraries)
        state["cr"] = lowered._replace(cfunc=key)
        return True


def _load_array_functions() -> None:
    """Have Numba load what it knows of arrays without SciPy's linear algebra, a third of a second: only ``np.cov`` looks for it."""
    blas = "scipy.linalg.cython_blas"
    if blas in sys.modules or "numba.np.arraymath" in sys.modules:
        return
    sys.modules[blas] = None  # type: ignore[assignment]  # what is None here is not there
    try:
        from numba.np import arraymath
    finally:
        del sys.modules[blas]
    arraymath._HAVE_BLAS = True  # SciPy is there


class _EntryCompiler(CompilerBase):
    """Numba's pipeline with another lowering."""

    lowering: type[Any] = _EntryLowering

    def __init__(self, *given: Any) -> None:
        _load_array_functions()
        super().__init__(*given)

    def define_pipelines(self) -> list[Any]:
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [(self.lowering if each is NativeLowering else each, text) for each, text in pipeline.passes]
        pipeline._finalized = False
        pipeline.finalize()
        return [pipeline]


class _PartCompiler(_EntryCompiler):
    lowering = _PartLowering


class _Dispatcher(CPUDispatcher):
    """Numba's compiled function, which looks for other people's extensions of Numba when it compiles, not when it loads."""

    def _compilation_chain_init_hook(self) -> None:
        pass


class _PartDispatcher(_Dispatcher):
    """What a kernel calls: compiled once for all values, not once more for each number that is written in a call."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(one) for name, one in kws.items()}
        return super().get_call_template(tuple(types.unliteral(one) for one in args), plain)


class Kernel:
    """A function to be compiled: called from Python an entry of its own, called from another kernel a part of that one's."""

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        update_wrapper(self, function)
        self._function, self._options = function, {**_OPTIONS, **options}

    @cached_property
    def entry(self) -> Any:
        """The compiled function that Python calls."""
        return cached(_Dispatcher(self._function, targetoptions=self._options, pipeline_class=_EntryCompiler))

    @cached_property
    def _part(self) -> Any:
        options = {**self._options, "no_cpython_wrapper": True}
        return _PartDispatcher(self._function, targetoptions=options, pipeline_class=_PartCompiler)

    @property
    def _numba_type_(self) -> Any:
        """What compiled code takes this object for."""
        return types.Dispatcher(self._part)

    def __call__(self, *arguments: Any) -> Any:
        """Call the entry, which is compiled when that is first done."""
        return self.entry(*arguments)

    def __reduce__(self) -> str:
        return self.__qualname__  # type: ignore[attr-defined, no-any-return]  # which module it is in, pickle knows


def _named_apart(function: Callable[..., Any]) -> None:
    """Give a kernel that was made within a function a name that tells which kernels it was made of.

    Machine code is linked by name, and Numba tells such kernels apart by a number that each process counts anew: one from the
    cache could otherwise stand for another one that this process compiles.
    """
    if "<locals>" in function.__qualname__:
        made_of = [cell.cell_contents for cell in function.__closure__ or ()]
        names = [one.__qualname__.split(".")[-1] if callable(one) else repr(one) for one in made_of]
        function.__qualname__ = f"{function.__qualname__}_{'_'.join(names)}"


def _compiled(function: Callable[..., Any], **options: bool) -> Any:
    _named_apart(function)
    return function if config.DISABLE_JIT else Kernel(function, **options)  # type: ignore[attr-defined]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function when it is first called."""
    return _compiled(function)


def in_place_kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays, but works in those that it is given: no references are counted."""
    return _compiled(function, _nrt=False)
