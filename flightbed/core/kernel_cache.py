"""Compiled kernels on disk, in the user's cache folder; the name of a file is a hash of everything that its machine code depends on.

The key of a kernel holds the sources of its module and of all of flightbed that the module imports (a kernel calls kernels of other
files, and their code is part of its own), the versions of numba, llvmlite, numpy and Python, the processor, and the types of the
arguments, and, of a function inside another one, the plain values that it takes from there. A changed source therefore gives another
file: no file is ever stale, and several source trees share the folder. numba's own cache checks only the file of the kernel itself, and
keeps an index that two processes may overwrite; here each kernel is one file, renamed into place.

``NUMBA_CACHE_DIR`` moves the folder, as it does for numba's own cache. A folder that cannot be written means compiling without it.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numba.core import compiler, event
from numba.core.caching import NullCache
from numba.core.serialize import dumps

from flightbed.core.compilation import WATCHERS
from flightbed.core.files import cache_folder, touch_used, write_cached
from flightbed.core.sources import SourcesChangedError, closure_sha256

SUFFIX = ".kernel"
MOST_BYTES = 400_000_000  # of all files together


def folder() -> Path:
    """Return the folder of the compiled kernels. Raises OSError if the user has no home folder."""
    named = os.environ.get("NUMBA_CACHE_DIR", "")
    return (Path(named) / "flightbed" if named else cache_folder()) / "kernels"


class KernelCache(NullCache):
    """The compiled forms of one kernel on disk; the interface is that of numba's ``_Cache``."""

    def __init__(self, function: Callable[..., Any]) -> None:
        """Read nothing yet: keys are computed at the first call of the kernel."""
        self._function = function

    @property
    def cache_path(self) -> str:
        """Folder of the files."""
        return str(folder())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled kernel for a signature; None if it is not there or cannot be read."""
        target_context.refresh()
        path = self._path(sig, target_context.codegen())
        if path is None:
            return None
        try:
            payload = pickle.loads(path.read_bytes())
            found = compiler.CompileResult._rebuild(target_context, *payload)  # type: ignore[no-untyped-call]
        except Exception:  # no file, or a damaged one, whatever error that makes: it is compiled and written again
            return None
        touch_used(path)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write the compiled kernel for a signature; without effect if the folder cannot be written."""
        path = self._path(sig, data.codegen)
        if path is not None and not data.library.has_dynamic_globals and not data.lifted:
            content: bytes = dumps(data._reduce())  # type: ignore[no-untyped-call]
            with suppress(OSError):
                write_cached(path, content, pattern=f"*{SUFFIX}", most_bytes=MOST_BYTES)

    def _path(self, sig: Any, codegen: Any) -> Path | None:
        """Return the file of the compiled kernel for a signature; None if it has none."""
        function, types = self._function, str(sig)
        enclosed = [cell.cell_contents for cell in function.__closure__ or ()]
        if " at 0x" in types or not all(isinstance(value, bool | int | float | str) for value in enclosed):
            return None  # depends on objects of this process
        try:
            sources, place = closure_sha256(function.__module__), folder()
        except (OSError, SourcesChangedError):
            return None
        which = f"{function.__module__}.{function.__qualname__}:{function.__code__.co_firstlineno}"
        parts = (which, types, repr(enclosed), sources, *_versions(), repr(codegen.magic_tuple()))
        key = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]
        return place / f"{function.__module__.rpartition('.')[2]}.{function.__name__}-{key}{SUFFIX}"


@cache
def _versions() -> tuple[str, ...]:
    packages = (f"{name} {version(name)}" for name in ("numba", "llvmlite", "numpy"))
    return (*packages, f"Python {platform.python_version()} {sys.implementation.cache_tag}")


class _Listener(event.Listener):
    """Calls the watchers around the compilation of a kernel that is called from Python."""

    def __init__(self) -> None:
        self._depth = 0  # a kernel compiles the kernels that it calls; numba's lock excludes other threads
        self._open = ExitStack()

    def on_start(self, event: Any) -> None:
        kernel = event.data["dispatcher"]
        if self._depth or isinstance(getattr(kernel, "_cache", None), KernelCache):
            self._depth += 1
        if self._depth == 1:
            for watcher in WATCHERS:
                self._open.enter_context(watcher(f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"))

    def on_end(self, event: Any) -> None:  # noqa: ARG002 - the interface of numba
        if self._depth:
            self._depth -= 1
            if not self._depth:
                self._open.close()


event.register("numba:compile", _Listener())  # type: ignore[no-untyped-call]


def use_cache(dispatcher: Any) -> None:
    """Give a dispatcher of numba this cache, or numba's own if its function is not one of flightbed's."""
    if dispatcher.py_func.__module__.startswith("flightbed."):
        dispatcher._cache = KernelCache(dispatcher.py_func)
    else:
        dispatcher.enable_caching()
