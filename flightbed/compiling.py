"""Functions that run compiled (numba, cached on disk) and plain, from one source."""

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
    """Compile at first call, unless FLIGHTBED_PLAIN is set; ``plain`` gives back the function itself either way."""
    if PLAIN:
        function.py_func = function  # type: ignore[attr-defined]
        return function
    from numba import njit

    return cast(Callable[P_, R_], njit(cache=True, error_model="numpy")(function))


def plain(function: Callable[P_, R_]) -> Callable[P_, R_]:
    """Return a compiled function as it was written: on a few plain numbers the way into compiled code costs more than they do."""
    return cast(Callable[P_, R_], function.py_func)  # type: ignore[attr-defined]
