"""Machine code for this processor: made by LLVM, kept on disk, and loaded."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path

import llvmlite
import llvmlite.binding as llvm

from ocptip.numerics.jit.private import CACHE, read_private, trusted, write_private

KEPT = 300  # files in the folder at most
_VERSION = 2  # of what is generated here


@cache
def processor() -> tuple[str, str]:
    """Name and features of this processor."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def target(effort: int = 1) -> llvm.TargetMachine:
    """What LLVM generates code for, with an effort of 0 or 1."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    name, features = processor()
    triple = llvm.Target.from_triple(llvm.get_process_triple())
    return triple.create_target_machine(cpu=name, features=features, opt=effort, jit=True)


class Library:
    """Functions in machine code."""

    def __init__(self, code: bytes) -> None:
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), target())
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def function(self, name: str, *arguments: type) -> Callable[..., None]:
        """One of them, with such arguments."""
        function = ctypes.CFUNCTYPE(None, *arguments)(self._engine.get_function_address(name))
        setattr(function, "engine", self._engine)  # noqa: B010  # owns the code, as long as that is called
        return function


def kept_code(key: bytes) -> bytes | None:
    """The code in a file that is whole, in a folder where only this user can have put it."""
    path = _path(key)
    text = (path and read_private(path)) or b""
    digest, code = text[:32], text[32:]
    if path is None or not code or hashlib.sha256(code).digest() != digest:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return code


def keep_code(key: bytes, code: bytes) -> None:
    """Put the code where a later process finds it, whole or not at all; those long unread make room."""
    if (path := _path(key)) is None:
        return
    with contextlib.suppress(OSError):
        write_private(path, hashlib.sha256(code).digest() + code)
        files = sorted(path.parent.glob("*.code"), key=lambda one: one.stat().st_mtime)
        for old in files[:-KEPT]:
            old.unlink(missing_ok=True)


def _path(key: bytes) -> Path | None:
    """Where such code is, or would be; None where there is no such place."""
    base = os.environ.get(CACHE) or os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        folder = (Path(base) if base else Path.home() / ".cache") / "ocptip"
    except RuntimeError:  # no home
        return None
    made_by = f"{_VERSION} {llvmlite.__version__} {llvm.get_process_triple()} {' '.join(processor())} "
    return trusted(folder) / f"{hashlib.sha256(made_by.encode() + key).hexdigest()}.code"
