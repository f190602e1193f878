"""Code of kernels in two forms: a part, which is only linked into others, and an entry, which is optimized with all its parts."""

from __future__ import annotations

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary


class LinkedPart(JITCodeLibrary):
    """Code that is only linked into other code: it is neither optimized as a whole nor made into machine code."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class Entry(JITCodeLibrary):
    """Code that Python calls. No other code links it, so that it is kept as machine code alone."""

    lowered = b""
    """LLVM's code of the entry and all its parts before it was optimized, which no processor's features have gone into."""

    def _optimize_final_module(self) -> None:
        self.lowered = self._final_module.as_bitcode()
        super()._optimize_final_module()

    @classmethod
    def of_lowered(cls, codegen: Any, name: str, lowered: bytes) -> Entry:
        """Optimize code that was lowered before, for this processor, and make machine code of it."""
        self = cls(codegen, name)
        self.enable_object_caching()
        self._final_module = binding.parse_bitcode(lowered)
        super(Entry, self)._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()
        return self

    @classmethod
    def of_machine_code(cls, codegen: Any, name: str, code: bytes, symbols: tuple[str, ...]) -> Entry:
        """Load machine code that has these symbols."""
        self = cls(codegen, name)
        self.enable_object_caching()
        self._set_compiled_object(code)
        self._finalize_final_module()
        codegen._engine._defined_symbols.update(symbols)
        return self
