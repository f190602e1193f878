"""Compilation of kernels with Numba: a kernel is either an entry, which Python calls, or a part of
another kernel.

Numba infers the types of a part and translates the part to LLVM code. LLVM optimizes an entry once,
together with all parts of the entry. Plain Numba would optimize each kernel again at every level of
calls, and would make machine code, a Python wrapper and a cache file for each kernel.

Named tuples pass from kernel to kernel by pointer. Plain Numba passes each number of each array of
a named tuple on its own: of the LLVM code of the planner, two fifths only took named tuples apart
and put them together again.

The files docs/adr/0012-kernels-compiled-once.md and docs/adr/0017-kernels-keyed-by-content.md
contain the measurements.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

from llvmlite import binding, ir
from llvmlite.binding import Linkage
from llvmlite.ir.instructions import ExtractValue, GEPInstr, LoadInstr
from numba import _dynfunc, njit, types  # type: ignore[attr-defined]
from numba.core.cgutils import get_item_pointer2, unpack_tuple
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.datamodel.models import TupleModel
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.typed_passes import NativeLowering
from numba.cpython.slicing import fix_index
from numba.extending import register_model

from shoal.jit.loader import MachineCode

_OPTIONS = {"nopython": True, "nogil": True, "error_model": "numpy"}
_WRAPPER = "_ZN7cpython"  # prefix of the names of functions that accept Python objects
_RUNTIME = "NRT_"  # prefix of the names of functions that count references
_UNUSED_PASSES = {
    "with_lifting",
    "inline_inlinables",
    "make_function_op_code_to_jit_function",
    "Rewrite dynamic raises",
    "literal_unroll",
    "LiteralPropagation",
    "find_literally",
    "dump_parfor_diagnostics",
    "annotate_types",
}


class PlainForms:
    """The compiled form of a kernel by Numba alone, for versions of Numba that Shoal
    does not know.
    """

    def __init__(self, function: Callable[..., Any], **_options: bool) -> None:
        self.entry = njit(nogil=True, error_model="numpy")(function)

    @property
    def part_type(self) -> Any:
        """The Numba type of the kernel in other kernels."""
        return types.Dispatcher(self.entry)


class CompiledForms:
    """The two compiled forms of a kernel: an entry, which Python calls, and a part, which other
    kernels contain.
    """

    def __init__(self, function: Callable[..., Any], **options: bool) -> None:
        self._function, self._options = function, {**_OPTIONS, "no_cfunc_wrapper": True, **options}

    @cached_property
    def entry(self) -> Any:
        """The compiled form of the kernel that Python calls."""
        return _Dispatcher(
            self._function, targetoptions=self._options, pipeline_class=_EntryCompiler
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

    def compile(self, arguments: tuple[Any, ...]) -> tuple[Any, bytes | None, bytes]:
        """Compile the entry for some arguments.

        Returns
        -------
        entry : callable
            The compiled function.
        machine_code : bytes or None
            A pickled `MachineCode`, or None if the machine code is of no use in another process.
        lowered : bytes
            The same with lowered code in place of machine code, if `Entry.keep_lowered` is set.
        """
        kinds = tuple(_by_pointer(self.entry.typeof_pyval(one)) for one in arguments)
        with _garbage_collector_paused():
            entry = self.entry.compile(kinds)
            result = self.entry.overloads[kinds]
            bound = result.library.has_dynamic_globals or result.reload_init
            if bound:
                return entry, None, b""
            stored = _machine_code(result)
            code = result.library.lowered
            return entry, bytes(dumps(stored)), code and bytes(dumps(replace(stored, code=code)))


@cache
def _codegen() -> Any:
    return JITCPUCodegen("shoal")


def finish(lowered: MachineCode) -> MachineCode:
    """Return the machine code that LLVM makes of lowered code for this processor."""
    with _garbage_collector_paused():
        library = Entry(_codegen(), lowered.name)
        library.optimize(binding.parse_bitcode(lowered.code))
        module = library._final_module
        code = library._codegen._tm.emit_object(module)
        return replace(lowered, code=code, required=_required(module))


@contextmanager
def _garbage_collector_paused() -> Iterator[None]:
    """Pause Python's garbage collector, which else takes an eighth of the compilation time and
    finds hardly any garbage.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _machine_code(result: Any) -> MachineCode:
    """Return the machine code of a compiled kernel, with the data that a call of the
    kernel needs.
    """
    description = result.fndesc
    # Environments are Numba's objects for constants. Those without constants are useless, and would
    # take imports to load.
    environments = [each for each in result._find_referenced_environments() if each.consts]
    return MachineCode(
        code=result.library._get_compiled_object(),
        name=description.qualname.split(".")[-1],
        entry=description.llvm_cpython_wrapper_name,
        own=description.env_name,
        constants={
            each.env_name: list(each.consts) for each in (result.environment, *environments)
        },
        required=_required(result.library._final_module),
    )


def _required(module: Any) -> tuple[str, ...]:
    """Return the names of what a module uses but does not define."""
    outside = (one for one in (*module.functions, *module.global_variables) if one.is_declaration)
    return tuple(one.name for one in outside if not one.name.startswith("llvm."))


# Named tuples by pointer


class _Structure(types.NamedTuple):
    """The type of a named tuple that Python passes to a kernel, or that is a part of such a named
    tuple.
    """

    def __init__(self, kinds: Any, cls: Any) -> None:
        super().__init__(kinds, cls)
        self.name = f"Structure {self.name}"


def _by_pointer(kind: Any) -> Any:
    """Return the Numba type with which a kernel gets an argument of type ``kind``."""
    if isinstance(kind, types.NamedTuple):
        return _Structure([_by_pointer(each) for each in kind.types], kind.instance_class)
    return kind


@register_model(_Structure)
class _StructureModel(TupleModel):
    """The form of a structure in LLVM code: a pointer as an argument, all its values elsewhere."""

    def get_argument_type(self) -> Any:
        return self.get_value_type().as_pointer()

    def as_argument(self, builder: Any, value: Any) -> Any:
        place = _place_of(builder, value)
        if place is None:
            with builder.goto_entry_block():
                place = builder.alloca(value.type)
            builder.store(value, place)
        return place

    def from_argument(self, builder: Any, value: Any) -> Any:
        value.add_attribute("noalias")  # no kernel writes into a named tuple, only into its arrays
        return builder.load(value)


def _place_of(builder: Any, value: Any) -> Any:
    """Return a pointer to a structure in the memory of a caller, or None if the structure is not
    there.

    The memory of a caller does not change while the kernel runs, so the pointer stays right.
    """
    if isinstance(value, LoadInstr):
        place = base = value.operands[0]
        while isinstance(base, GEPInstr):
            base = base.pointer
        return place if isinstance(base, ir.Argument) else None
    if isinstance(value, ExtractValue):
        outer = _place_of(builder, value.aggregate)
        if outer is not None:
            index = ir.IntType(32)
            return builder.gep(
                outer, [index(0), *(index(each) for each in value.indices)], inbounds=True
            )
    return None


class _Lower(Lower):
    """Numba's translation to LLVM code, with less code for named tuples and for single elements of
    arrays.
    """

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        if self._may_point(name):
            place = _place_of(self.builder, value)
            if place is not None:
                self.varmap[name] = place
                return
        super().storevar(value, name, argidx)

    def _may_point(self, name: str) -> bool:
        if self.context.enable_nrt or name in self.varmap or name in self._singly_assigned_vars:
            return False
        return (
            isinstance(self.typeof(name), _Structure) and len(self.func_ir._definitions[name]) == 1
        )

    def delvar(self, name: str) -> None:
        # else zeros would be written to the caller's memory
        if not isinstance(self.varmap.get(name), ir.Argument | GEPInstr):
            super().delvar(name)

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        array = self.typeof(value.name)
        place = self._place_of_element(value, index)
        if place is None or not array.dtype == signature.return_type == resty:
            return super().lower_getitem(resty, expr, value, index, signature)
        return self.context.unpack_value(
            self.builder, array.dtype, place, align=None if array.aligned else 1
        )

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        array, kind = self.typeof(target_var.name), self.typeof(value_var.name)
        if not isinstance(kind, types.Number | types.Boolean) or not isinstance(
            getattr(array, "dtype", None), types.Number
        ):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        place = self._place_of_element(target_var, index_var)
        if place is None:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        value = self.context.cast(self.builder, self.loadvar(value_var.name), kind, array.dtype)
        align = None if array.aligned else 1
        return self.context.pack_value(self.builder, array.dtype, value, place, align=align)

    def _place_of_element(self, array_var: Any, index_var: Any) -> Any:
        """Return a pointer to the element of an array at whole numbers, or None for anything else.

        Numba's own code for this first copies the fields of the array to memory, which doubles the
        LLVM code of a typical kernel.
        """
        array, index = self.typeof(array_var.name), self.typeof(index_var.name)
        kinds = getattr(index, "types", (index,))
        if (
            type(array) is not types.Array
            or len(kinds) != array.ndim
            or self.context.enable_boundscheck
        ):
            return None
        if not all(isinstance(kind, types.Integer) for kind in kinds):
            return None
        builder, model = self.builder, self.context.data_model_manager[array]
        value, at = self.loadvar(array_var.name), self.loadvar(index_var.name)
        shape, strides = (
            unpack_tuple(builder, model.get(builder, value, name), array.ndim)
            for name in ("shape", "strides")
        )
        numbers = (
            unpack_tuple(builder, at, array.ndim) if isinstance(index, types.BaseTuple) else (at,)
        )
        indices = []
        for kind, number, length in zip(kinds, numbers, shape, strict=True):
            number = self.context.cast(  # noqa: PLW2901
                builder, number, kind, types.intp if kind.signed else types.uintp
            )
            indices.append(fix_index(builder, number, length) if kind.signed else number)
        data = model.get(builder, value, "data")
        return get_item_pointer2(self.context, builder, data, shape, strides, array.layout, indices)


# Code of entries and parts


class LinkedPart(JITCodeLibrary):
    """The code of a kernel that other kernels call.

    Numba never optimizes a part alone, and never generates machine code for a part alone.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class Entry(JITCodeLibrary):
    """The code of a kernel that Python calls. No other code links to an entry."""

    keep_lowered = False
    """Whether entries keep their lowered code, for the archives (see `shoal.jit.lowered`)."""
    lowered = b""

    def optimize(self, module: Any) -> None:
        """Optimize lowered code for this processor."""
        self._final_module = module
        self._optimize_final_module()
        self._final_module.verify()

    def _optimize_final_module(self) -> None:
        if self.keep_lowered:
            self.lowered = self._nameless()
        _hide_parts(self._final_module)
        super()._optimize_final_module()

    def _nameless(self) -> bytes:
        """Return the code without the names of values and parts, which take more than half of it.

        The functions of Numba's runtime keep their names, by which Numba's optimization finds the
        counts of references that it can leave out.
        """
        module = self._final_module.clone()
        _hide_parts(module, but=_RUNTIME)
        options = binding.create_pipeline_tuning_options()
        passes = binding.create_new_module_pass_manager()
        passes.add_strip_symbols_pass()
        passes.run(module, binding.create_pass_builder(self._codegen._tm, options))
        return bytes(module.as_bitcode())


def _hide_parts(module: Any, but: str = "\0") -> None:
    """Tell LLVM that no code outside the module calls the parts of an entry.

    Without calls from outside, LLVM inlines each part that has only one call, and removes unused
    arguments. In LLVM code, one array argument consists of seven arguments. Functions whose names
    begin with ``but`` are left as they are.
    """
    wrappers = [one.name for one in module.functions if one.name.startswith(_WRAPPER)]
    called = {*wrappers, *(name.replace(_WRAPPER, "_ZN", 1) for name in wrappers)}
    for function in module.functions:
        if not function.is_declaration and not (
            function.name in called or function.name.startswith(but)
        ):
            function.linkage = Linkage.internal


@register_pass(mutates_CFG=True, analysis_only=False)
class _EntryLowering(NativeLowering):
    """The lowering pass for a kernel that Python calls. The pass translates the kernel to LLVM
    code.
    """

    _name = "entry_lowering"
    library_class: type[Any] = Entry

    @property
    def lowering_class(self) -> type[Any]:
        return _Lower

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
            if each.name() not in _UNUSED_PASSES
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
