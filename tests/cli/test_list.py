"""`flightbed list`."""

from __future__ import annotations

from pathlib import Path

from tests.command_line import call, flightbed


def test_list_prints_one_line_per_member(tmp_path: Path) -> None:
    listed = flightbed("list", cwd=tmp_path).stdout
    for name in ("f16", "nominal", "elevator-loss", "elevator-loss-fixed", "straight-and-level", "doublet", "constant", "none",
                 "3-2-1-1", "chirp", "multisine", "random", "dither", "proportional", "proportional-integral", "lq", "effectiveness", "loop-gain",
                 "two-stage", "stuck", "floating", "hardover", "rate-limit", "bias"):  # fmt: skip
        assert f"\n  {name} " in listed
    laws = [line.split()[0] for line in call("list", "laws", cwd=tmp_path).stdout.splitlines()]
    assert laws == ["lq", "nz-adaptive", "nz-scheduled", "proportional", "proportional-integral"]
