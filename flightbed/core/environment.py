"""The environment of a flight: everything besides sources and settings that decides its last digits."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType

import numpy as np


@cache
def environment() -> Mapping[str, str]:
    """Return versions, CPU features, libc and BLAS kernels, as name -> text."""
    found = {
        "platform": f"{platform.system()} {platform.machine()}",
        "python": ".".join(platform.python_version_tuple()[:2]),  # the wheels of each are built apart
        "libc": _libc(),
        **{name: version(name) for name in ("jsbsim", "numpy", "scipy", "numba", "llvmlite")},
        "numpy features": _numpy_features(),
        "compiled for": _compiled_for(),
        "libm features": _libm_features(),
        **_blas(),
    }
    return MappingProxyType(dict(sorted(found.items())))


def _libc() -> str:
    with suppress(AttributeError, ValueError, OSError):  # no confstr, or no glibc
        named = os.confstr("CS_GNU_LIBC_VERSION")
        if named:
            return named
    return " ".join(platform.libc_ver()).strip() or f"{platform.system()} {platform.release()}"


def _numpy_features() -> str:
    """Return the CPU features for which numpy has code of its own, and that are present and not switched off."""
    simd = np.show_config(mode="dicts")["SIMD Extensions"]
    return " ".join([*simd.get("baseline", []), *simd.get("found", [])])


def _compiled_for() -> str:
    """Return the processor, and a digest of its features, for which numba compiles."""
    if os.environ.get("FLIGHTBED_PLAIN", "") not in ("", "0"):
        return "nothing (FLIGHTBED_PLAIN)"
    from numba.core.registry import cpu_target

    triple, processor, features = cpu_target.target_context.codegen().magic_tuple()
    return f"{triple} {processor} {hashlib.sha256(features.encode()).hexdigest()[:12]}"


def _libm_features() -> str:
    """Return the CPU features by which glibc chooses its sin, exp, pow, ..., and its tunables from the environment."""
    from llvmlite.binding import get_host_cpu_features  # type: ignore[import-untyped]

    features = get_host_cpu_features()
    present = [name for name in ("fma", "fma4", "avx2") if features.get(name)]
    return " ".join([*present, os.environ.get("GLIBC_TUNABLES", "")]).strip()


def _blas() -> dict[str, str]:
    """Return the BLAS libraries of numpy and scipy, each with version, kernel and threads where it is an OpenBLAS."""
    import scipy.linalg  # noqa: F401 - loads its library

    found = {f"BLAS {path.name}": _openblas(path) or "kernel not known" for path in _blas_libraries()}
    if found:
        return found
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    return {"BLAS": f"{blas.get('name')} {blas.get('version')}, kernel not known"}


def _blas_libraries() -> Iterator[Path]:
    """Yield the shared libraries of BLAS in this process; where these cannot be listed, those in the wheels of numpy and scipy."""
    maps = Path("/proc/self/maps")
    if maps.is_file():
        loaded = {Path(line.split(maxsplit=5)[5].strip()) for line in maps.read_text().splitlines() if "/" in line}
    else:
        site = Path(np.__file__).parents[1]
        folders = ("numpy.libs", "numpy/.dylibs", "scipy.libs", "scipy/.dylibs")
        loaded = {path for folder in folders for path in (site / folder).glob("*")}
    for path in sorted(loaded):
        if path.name.startswith("lib") and any(word in path.name for word in ("blas", "mkl_rt", "blis")):
            yield path


def _openblas(path: Path) -> str | None:
    """Return version, kernel and threads of a loaded OpenBLAS, None if the library is another."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError:
        return None
    for prefix in ("scipy_", ""):
        for suffix in ("64_", "_64", ""):
            with suppress(AttributeError):  # no such symbol
                config, kernel, threads = (
                    getattr(library, f"{prefix}openblas_get_{what}{suffix}")
                    for what in ("config", "corename", "num_threads")
                )
                config.restype = kernel.restype = ctypes.c_char_p
                built = (config() or b"").decode().split()
                return f"{' '.join(built[:2])} {(kernel() or b'').decode()}, threads: {threads()}"
    return None
