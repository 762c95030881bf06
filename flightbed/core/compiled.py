"""Functions with one source that run compiled (numba, cached on disk: ``core/kernel_cache.py``) or as plain Python."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
P_ = ParamSpec("P_")
R_ = TypeVar("R_")

PLAIN = os.environ.get("FLIGHTBED_PLAIN", "") not in ("", "0")


def compiled(function: Callable[P_, R_]) -> Callable[P_, R_]:
    """Compile a function at its first call, unless FLIGHTBED_PLAIN is set; ``plain`` returns the Python function in both cases."""
    if PLAIN:
        function.py_func = function  # type: ignore[attr-defined]
        return function
    from numba import njit

    from flightbed.core.kernel_cache import use_cache

    dispatcher = njit(error_model="numpy")(function)
    use_cache(dispatcher)
    return cast(Callable[P_, R_], dispatcher)


def plain(function: Callable[P_, R_]) -> Callable[P_, R_]:
    """Return the Python function of a compiled one: for a few scalars, calling compiled code takes longer than their arithmetic."""
    return cast(Callable[P_, R_], function.py_func)  # type: ignore[attr-defined]
