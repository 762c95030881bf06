"""The colours: contrast on white and on the viewer's near-black, and distinguishable with colour blindness."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest

from flightbed.document import palette

COLORS = {name: getattr(palette, name) for name in ("REFERENCE", "ACTUAL", "COMMAND", "TRUTH", "FAILURE", "OTHER")}
BACKGROUNDS = ("#ffffff", "#0d1011")
# Linear RGB as seen without one kind of cone, all of it missing: Machado, Oliveira and Fernandes (2009), Table 1.
SEEN = {
    "everyone": np.eye(3),
    "protanope": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranope": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanope": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def _linear(color: str) -> np.ndarray:
    c = np.array(palette.rgb(color)) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def _luminance(color: str) -> float:
    return float(_linear(color) @ [0.2126, 0.7152, 0.0722])


def _lab(rgb: np.ndarray) -> np.ndarray:
    """CIE L*a*b* of linear sRGB, D65."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(rgb, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("name", COLORS)
@pytest.mark.parametrize("background", BACKGROUNDS)
def test_every_colour_stands_out_from_light_and_dark(name: str, background: str) -> None:
    dim, bright = sorted((_luminance(COLORS[name]), _luminance(background)))
    assert (bright + 0.05) / (dim + 0.05) >= 3.0  # WCAG 2.1, 1.4.11: graphics


@pytest.mark.parametrize("who", SEEN)
def test_all_colours_are_distinguishable(who: str) -> None:
    """A difference of 2.3 can just be seen side by side; 12 in thin lines."""
    for a, b in combinations(COLORS, 2):
        difference = np.linalg.norm(_lab(SEEN[who] @ _linear(COLORS[a])) - _lab(SEEN[who] @ _linear(COLORS[b])))
        assert difference > 12.0, (a, b, difference)


def test_colours_of_series_are_of_the_palette_and_begin_again() -> None:
    assert set(palette.ESTIMATES) <= set(COLORS.values())
    assert not {palette.TRUTH, palette.REFERENCE, palette.FAILURE} & set(palette.RUNS)  # drawn beside them
    for color, background in product(palette.RUNS, BACKGROUNDS):
        dim, bright = sorted((_luminance(color), _luminance(background)))
        assert (bright + 0.05) / (dim + 0.05) >= 3.0, color
    assert palette.TRUTH not in palette.ESTIMATES  # K true is drawn among them
    assert palette.estimate(len(palette.ESTIMATES)) == palette.estimate(0)
    assert palette.run(len(palette.RUNS)) == palette.run(0)


def test_blend() -> None:
    assert palette.blend("#000000", "#ff8000", 0.5) == (128, 64, 0)
    assert palette.blend("#102030", "#405060", -1.0) == (16, 32, 48)
    assert palette.blend("#102030", "#405060", 2.0) == (64, 80, 96)
