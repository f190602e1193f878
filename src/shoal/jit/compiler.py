"""What becomes of a kernel: a part of another one, or an entry that Python calls.

A kernel that other kernels call is only typed and lowered; what Python calls is optimized with all that it calls, once.
Numba's own way optimizes a kernel, and all below it, again at every level, makes machine code and a Python wrapper of each, and
caches each: two thirds of the time. docs/adr/0012-kernels-compiled-once.md has the measurements.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from numba import _dynfunc, config, types  # type: ignore[attr-defined]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

from shoal.jit.cache import cached

_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def _load_array_functions() -> None:
    """Have Numba load what it knows of arrays without SciPy's linear algebra, a third of a second: only ``np.cov`` looks for it."""
    blas = "scipy.linalg.cython_blas"
    if blas in sys.modules:
        return
    sys.modules[blas] = None  # type: ignore[assignment]  # what is None here is not there
    try:
        from numba.np import arraymath
    finally:
        del sys.modules[blas]
    arraymath._HAVE_BLAS = True  # SciPy is there


_load_array_functions()


class _Part(JITCodeLibrary):
    """Code that is only linked into other code: it is neither optimized as a whole nor made into machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    """Lower a kernel that other kernels call."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        state.library = library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        key = _dynfunc.make_function(lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (library,))  # never called
        state.targetctx.insert_user_function(key, lowered.fndesc, [library])
        state["cr"] = lowered._replace(cfunc=key)
        return True


class _PartCompiler(CompilerBase):
    """Numba's pipeline with the other lowering."""

    def define_pipelines(self) -> list[Any]:
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [(_PartLowering if each is NativeLowering else each, text) for each, text in pipeline.passes]
        pipeline._finalized = False
        pipeline.finalize()
        return [pipeline]


class _PartDispatcher(CPUDispatcher):
    """What a kernel calls: compiled once for all values, not once more for each number that is written in a call."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(one) for name, one in kws.items()}
        return super().get_call_template(tuple(types.unliteral(one) for one in args), plain)


class Kernel(CPUDispatcher):
    """A compiled function: called from Python an entry of its own, called from another kernel a part of that one's."""

    _part: Any = None

    @property
    def _numba_type_(self) -> Any:
        """What compiled code takes this object for."""
        if self._part is None:
            options = {**self.targetoptions, "no_cpython_wrapper": True}
            self._part = _PartDispatcher(self.py_func, targetoptions=options, pipeline_class=_PartCompiler)
        return types.Dispatcher(self._part)


def _named_apart(function: Callable[..., Any]) -> None:
    """Give a kernel that was made within a function a name that tells which kernels it was made of.

    Machine code is linked by name, and Numba tells such kernels apart by a number that each process counts anew: one from the
    cache could otherwise stand for another one that this process compiles.
    """
    if "<locals>" in function.__qualname__:
        made_of = [cell.cell_contents for cell in function.__closure__ or ()]
        names = [one.py_func.__qualname__.split(".")[-1] if hasattr(one, "py_func") else repr(one) for one in made_of]
        function.__qualname__ = f"{function.__qualname__}_{'_'.join(names)}"


def _compiled(function: Callable[..., Any], **options: bool) -> Any:
    _named_apart(function)
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    return cached(Kernel(function, targetoptions={**_OPTIONS, **options}))


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function when it is first called."""
    return _compiled(function)


def in_place_kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays, but works in those that it is given: no references are counted."""
    return _compiled(function, _nrt=False)
