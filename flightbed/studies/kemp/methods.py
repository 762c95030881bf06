"""Identifiers under comparison, by name, and their estimates over a record."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from flightbed.estimation.plid.factored import FACTORED
from flightbed.estimation.plid.identify import Plid, PlidConfig, Tracking
from flightbed.studies.kemp import printed
from flightbed.studies.kemp.plants import Record
from flightbed.studies.methods.rml import Rml, RmlConfig

Array = npt.NDArray[np.float64]

PLID, UD, RML, RLS = "PLID", "U-D", "RML", "RLS"
SINGLE, UD_SINGLE = "PLID, single precision", "U-D, single precision"
BLOCK, UD_BLOCK, WHOLE, FADING_RML = "block fade", "U-D, block fade", "whole fade", "fading RML"
PSEUDONOISE, RESET, RESET_SMALL = "pseudonoise", "reset every 20", "reset of a small gain"
# The thesis does not give the settings of the alternatives: forgetting factor of the fading RML; pseudonoise variance; reset period,
# samples; norm of the gains below which the covariance is reset.
FORGETTING = 0.98
GAMMA, RESET_EVERY, RESET_BELOW = 1e-4, 20, 1e-2


class Identifier(Protocol):
    """Interface of an identifier of order n."""

    def update(self, y: float, u_before: float, /) -> None:
        """Update the estimate with the reading at the next sample and the input one sample before it."""

    @property
    def parameters(self) -> Array:
        """Estimate of a_0 .. a_(n-1), b_0 .. b_(n-1), (2n,)."""


def _plid(
    order: int, r: float, q: float, *, factored: bool = False, tracking: Tracking | None = None, **more: Any
) -> Plid:
    config = PlidConfig(
        order, process_var=q, output_var=r, prior_var=printed.PRIOR_VAR, tracking=tracking or Tracking(), **more
    )
    return Plid(config, FACTORED) if factored else Plid(config)


def _rml(
    order: int, _r: float, _q: float, *, noise_prior_var: float = printed.NOISE_PRIOR_VAR, forgetting: float = 1.0
) -> Rml:
    return Rml(RmlConfig(order, printed.PRIOR_VAR, noise_prior_var, forgetting))


_FADE = Tracking(printed.FADE)
_MAKE: MappingProxyType[str, Callable[[int, float, float], Identifier]] = MappingProxyType(
    {
        PLID: _plid,
        UD: partial(_plid, factored=True),
        SINGLE: partial(_plid, dtype="float32"),
        UD_SINGLE: partial(_plid, factored=True, dtype="float32"),
        RML: _rml,
        RLS: partial(_rml, noise_prior_var=0.0),
        BLOCK: partial(_plid, tracking=_FADE),
        UD_BLOCK: partial(_plid, factored=True, tracking=_FADE),
        WHOLE: partial(_plid, tracking=Tracking(whole_fade=printed.FADE)),
        PSEUDONOISE: partial(_plid, tracking=Tracking(pseudonoise_var=GAMMA)),
        RESET: partial(_plid, tracking=Tracking(reset_every=RESET_EVERY)),
        RESET_SMALL: partial(_plid, tracking=Tracking(reset_below=RESET_BELOW)),
        FADING_RML: partial(_rml, forgetting=FORGETTING),
    }
)


def make(method: str, order: int, r: float, q: float) -> Identifier:
    """Return an identifier with initial estimates of zero, eqs (3.5) and (3.15), and known noise variances r and q (unused by RML)."""
    return _MAKE[method](order, r, q)


def estimates(identifier: Identifier, record: Record) -> Array:
    """Update an identifier over a record and return its estimate at every sample, (N, 2n)."""
    found = np.empty_like(record.theta)
    u_before = 0.0
    for k, (y, u) in enumerate(zip(record.y.tolist(), record.u.tolist(), strict=True)):
        identifier.update(y, u_before)
        found[k] = identifier.parameters
        u_before = u
    return found
