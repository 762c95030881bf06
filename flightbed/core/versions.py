"""Versions of the packages, and digest of the sources, that decide the last bits of a flight."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from types import MappingProxyType

from flightbed.core.sources import source_sha256


@cache
def versions() -> Mapping[str, str]:
    """Return package -> version, of flightbed, Python and the numerical packages."""
    packages = {package: version(package) for package in ("jsbsim", "numpy", "scipy", "numba")}
    return MappingProxyType({"flightbed": version("flightbed"), "python": platform.python_version(), **packages})


def identity() -> Mapping[str, str]:
    """Return the versions, and the digest of flightbed's sources: between two releases the version is the same."""
    return {**versions(), "sources of flightbed": source_sha256()}
