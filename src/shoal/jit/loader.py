"""What Shoal takes from Numba's inside in order to call machine code without Numba.

The import of Numba takes longer than most commands of Shoal. The machine code of kernels needs only
LLVM's loader, which is public (llvmlite), and three modules of Numba that are written in C:
`_dynfunc` makes the function object and holds its constants, `_helperlib` and `_nrt_python` define
the symbols that machine code calls. No other module of Shoal uses them. `compiler` subclasses
Numba's compiler.

Tested with the versions of Numba in `TESTED`. With any other version, and if the environment
variable SHOAL_PLAIN_KERNELS is set, Shoal uses neither this module nor its own compiler:
`numba.njit` compiles and calls kernels, in each process again.
"""

from __future__ import annotations

import builtins
import ctypes
import pickle
import re
import sys
from collections.abc import Callable
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from operator import attrgetter
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass

TESTED = ("0.68.",)
"""Beginnings of the versions of Numba whose inside is as this module expects it."""

# NumPy's array flags that change the compiled code
_C_ORDER, _FORTRAN_ORDER, _ALIGNED_AND_WRITABLE = 0x1, 0x2, 0x100 | 0x400
_SAME = {int: np.int64, float: np.float64, bool: np.bool_}
_of_array = attrgetter("dtype", "ndim", "flags.num")
_dtype_of = np.generic.dtype.__get__  # a record looks among its fields first, which takes longer
_PLAIN = frozenset([bool, float, type(None), *(np.dtype(name).type for name in "?bhilBHILfd")])


@dataclass(frozen=True)
class MachineCode:
    """The machine code of a kernel, and the data that a call of the kernel needs."""

    code: bytes
    name: str  # name of the function
    entry: str  # symbol of the function that accepts Python objects
    own: str  # symbol of the variable that points to the kernel's constants
    # lists of constants, by the symbol of the variable that points to the list
    constants: dict[str, list[Any]]
    required: tuple[str, ...]  # symbols that the machine code uses but does not define


def kinds_of_arguments(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return one key for each argument of a kernel. All keys together determine the compiled code.

    For example, the key of an array contains the dtype and the memory order of the array. Every
    call of a kernel runs this function, so the function must be fast.

    Raises
    ------
    TypeError
        If only Numba can determine the type of an argument.
    """
    kinds: list[Any] = []
    for value in values:
        kind = type(value)
        if kind is np.ndarray:
            kinds.append(_of_array(value))
        elif kind in _PLAIN:
            kinds.append(kind)
        elif kind is int:
            kinds.append(int if -(2**63) <= value < 2**63 else "large")
        elif issubclass(kind, tuple):
            kinds.append((kind, kinds_of_arguments(value)))
        elif issubclass(kind, np.ndarray):
            kinds.append((kind, _of_array(value)))
        elif kind is np.record:
            kinds.append((kind, _dtype_of(value)))
        elif kind is np.random.Generator:  # here, because NumPy imports its module `random` on use
            kinds.append(kind)
        else:
            raise TypeError(kind)
    return tuple(kinds)


def compiled_form(kinds: Any) -> Any:
    """Return a key for the code that Numba compiles for given argument types.

    Argument types for which Numba compiles equal code have equal keys. The key leaves out array
    flags that do not change the code. An array that is contiguous in row-major order and in
    column-major order counts as an array in row-major order. A Python number counts as the NumPy
    number with equal bits.
    """
    if not isinstance(kinds, tuple):
        return (
            (kinds, fields)
            if (fields := getattr(kinds, "_fields", None))
            else _SAME.get(kinds, kinds)
        )
    if kinds and isinstance(kinds[0], np.dtype):
        order = kinds[2] & _C_ORDER or kinds[2] & _FORTRAN_ORDER
        return *kinds[:2], order | kinds[2] & _ALIGNED_AND_WRITABLE
    return tuple(compiled_form(each) for each in kinds)


@cache
def version_of_numba() -> str:
    """Return the version of the installed Numba, without importing Numba."""
    version = re.search(r'"version": "([^"]+)"', (_folder_of_numba() / "_version.py").read_text())
    return version[1] if version else "unknown"


def numba_is_tested() -> bool:
    """Return whether Shoal knows the inside of the installed Numba."""
    return version_of_numba().startswith(TESTED)


def _folder_of_numba() -> Path:
    spec = find_spec("numba")
    if spec is None or spec.origin is None:
        raise ImportError("numba")
    return Path(spec.origin).parent


def _extension(name: str) -> ModuleType:
    """Import a module of Numba that is written in C, without the import of the whole
    Numba package.
    """
    if name in sys.modules:
        return sys.modules[name]
    spec = PathFinder.find_spec(name, [str(_folder_of_numba().joinpath(*name.split(".")[1:-1]))])
    if spec is None or spec.loader is None:
        raise ImportError(name)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return sys.modules.setdefault(name, module)


class _Linker:
    """LLVM's loader of machine code, and the symbols that Numba's machine code needs."""

    def __init__(self) -> None:
        # imported with the first kernel that is called: modules with kernels are also imported for
        # help and for the checks of a problem, which would take a fifth longer
        from llvmlite import binding

        self._binding = binding
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        target = binding.Target.from_default_triple()
        reloc = "static" if target.name.startswith("x86") else "default"
        machine = target.create_target_machine(reloc=reloc, codemodel="jitdefault", jit=True)
        self._engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
        self._functions = _extension("numba._dynfunc")
        helpers, runtime = (
            _extension("numba._helperlib").c_helpers,
            _extension("numba.core.runtime._nrt_python").c_helpers,
        )
        binding.add_symbol("_Py_NoneStruct", id(None))
        for name, address in (helpers | self._functions.c_helpers).items():
            binding.add_symbol(f"numba_{name}", address)
        for name, address in runtime.items():
            binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
        # Numba's own function imports the whole of Numba, at the first array that a kernel returns
        binding.add_symbol("numba_unpickle", ctypes.cast(_unpickle_from_c, ctypes.c_void_p).value)
        for name, error in vars(builtins).items():
            if isinstance(error, type) and issubclass(error, BaseException):
                binding.add_symbol(f"PyExc_{name}", id(error))

    def link(self, stored: MachineCode, function: Callable[..., Any]) -> Any:
        """Load machine code and return the kernel as a Python function."""
        binding = self._binding
        if not all(binding.address_of_symbol(name) for name in stored.required):
            from numba.core.registry import cpu_target

            # the access to this property tells LLVM all symbols that Numba knows
            _ = cpu_target.target_context
        self._engine.add_object_file(binding.ObjectFileRef.from_data(stored.code))
        self._engine.finalize_object()
        environments = {}
        for symbol, constants in stored.constants.items():
            environments[symbol] = self._functions.Environment(function.__globals__)
            environments[symbol].consts.extend(constants)
            address = self._engine.get_global_value_address(symbol)
            ctypes.c_void_p.from_address(address).value = id(environments[symbol])
        address = self._engine.get_function_address(stored.entry)
        own, module = environments[stored.own], SimpleNamespace(__name__=function.__module__)
        return self._functions.make_function(
            module, stored.name, "", address, own, (self._engine, environments)
        )


_constants: dict[int, Any] = {}  # by their addresses in machine code, which is never unloaded


def _unpickle(address: int, length: int, _: int) -> Any:
    """Return the pickled constant at an address of machine code, such as the class of an array that
    a kernel returns.
    """
    if address not in _constants:
        _constants[address] = pickle.loads(ctypes.string_at(address, length))
    return _constants[address]


_unpickle_from_c = ctypes.PYFUNCTYPE(
    ctypes.py_object, ctypes.c_void_p, ctypes.c_int, ctypes.c_void_p
)(_unpickle)


@cache
def _linker() -> _Linker:
    return _Linker()


def link(stored: MachineCode, function: Callable[..., Any]) -> Any:
    """Load machine code and return the kernel as a Python function."""
    return _linker().link(stored, function)
