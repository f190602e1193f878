"""Compilation of kernels: a kernel is either an entry, which Python calls, or a part of another
kernel.

Numba infers the types of a part and translates the part to LLVM code, without optimization. LLVM
optimizes an entry once, together with all parts of the entry. Without this module, Numba would
optimize each kernel again at every level of calls. Without this module, Numba would make machine
code, a Python wrapper and a cache file for each kernel. Repeated optimization and additional files
for each kernel would take two thirds of Numba's compilation time. The file
docs/adr/0012-kernels-compiled-once.md contains the measurements of the compilation time.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cached_property
from typing import Any

from numba import _dynfunc, types  # type: ignore[attr-defined]
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import NativeLowering

from shoal.jit.cache import cached
from shoal.jit.libraries import Entry, LinkedPart

_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


@register_pass(mutates_CFG=True, analysis_only=False)
class _EntryLowering(NativeLowering):
    """The lowering pass for a kernel that Python calls. The pass translates the kernel to LLVM
    code.
    """

    _name = "entry_lowering"
    library_class: type[Any] = Entry

    def run_pass(self, state: Any) -> bool:
        state.library = self.library_class(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(_EntryLowering):
    """The lowering pass for a kernel that other kernels call. The pass translates the kernel to
    LLVM code.
    """

    _name = "part_lowering"
    library_class = LinkedPart

    def run_pass(self, state: Any) -> bool:
        state.flags.no_compile = True
        super().run_pass(state)
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        libraries = (state.library,)
        key = _dynfunc.make_function(
            lowered.fndesc.lookup_module(), name, "", 0, lowered.env, libraries
        )  # never called
        state.targetctx.insert_user_function(key, lowered.fndesc, libraries)
        state["cr"] = lowered._replace(cfunc=key)
        return True


def _load_array_functions() -> None:
    """Load Numba's array functions without SciPy's linear algebra.

    The import of SciPy's linear algebra takes a third of a second, and only ``np.cov`` needs the
    linear algebra.
    """
    blas = "scipy.linalg.cython_blas"
    if blas in sys.modules or "numba.np.arraymath" in sys.modules:
        return
    # until the entry is deleted, an import of ``blas`` fails
    sys.modules[blas] = None  # type: ignore[assignment]
    try:
        from numba.np import arraymath
    finally:
        del sys.modules[blas]
    arraymath._HAVE_BLAS = (
        True  # SciPy is installed, although the import of ``blas`` failed on purpose
    )


class _EntryCompiler(CompilerBase):
    """Numba's compiler pipeline with the pass ``lowering`` in place of Numba's own
    lowering pass.
    """

    lowering: type[Any] = _EntryLowering

    def __init__(self, *given: Any) -> None:
        _load_array_functions()
        super().__init__(*given)

    def define_pipelines(self) -> list[Any]:
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        pipeline.passes = [
            (self.lowering if each is NativeLowering else each, text)
            for each, text in pipeline.passes
        ]
        pipeline._finalized = False
        pipeline.finalize()
        return [pipeline]


class _PartCompiler(_EntryCompiler):
    lowering = _PartLowering


class _Dispatcher(CPUDispatcher):
    """Numba's dispatcher without the search for Numba extensions.

    Numba's own dispatcher searches for extensions even if it only loads a compiled function.
    """

    def _compilation_chain_init_hook(self) -> None:
        pass


class _PartDispatcher(_Dispatcher):
    """The dispatcher of a kernel that other kernels call. A literal number as an argument does not
    cause another compilation.
    """

    def get_call_template(self, args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(one) for name, one in kws.items()}
        return super().get_call_template(tuple(types.unliteral(one) for one in args), plain)


class CompiledForms:
    """The two compiled forms of a kernel: an entry, which Python calls, and a part, which other
    kernels contain.
    """

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        self._function, self._options = function, {**_OPTIONS, **options}

    @cached_property
    def entry(self) -> Any:
        """The compiled form of the kernel that Python calls."""
        return cached(
            _Dispatcher(self._function, targetoptions=self._options, pipeline_class=_EntryCompiler)
        )

    @cached_property
    def _part(self) -> Any:
        options = {**self._options, "no_cpython_wrapper": True}
        return _PartDispatcher(self._function, targetoptions=options, pipeline_class=_PartCompiler)

    @property
    def part_type(self) -> Any:
        """The Numba type of the part, which is the form of the kernel that other kernels contain.

        The Numba type has only a weak reference to the part, so ``CompiledForms`` keeps the part
        alive.
        """
        return types.Dispatcher(self._part)
