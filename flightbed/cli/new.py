"""The command `flightbed new`."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.markup import escape

from flightbed.cli.screen import print_lines
from flightbed.core.errors import InputError


def new(
    name: str,
    /,
    *,
    kind: Annotated[list[str] | None, Parameter(negative="")] = None,
    out: Annotated[Path | None, Parameter(name=["--out", "-o"])] = None,
) -> None:
    """Write a short commented scenario to start from.

    Args:
        name: Name of the scenario: letters, digits, - and _.
        kind: A command, failure, gust, law or estimator to use instead of the usual one, for example --kind ramp --kind plid; its keys
            are listed in the file. Repeat --kind for each.
        out: File to write, which must not exist. Default: NAME.toml.

    """
    from flightbed.core import data
    from flightbed.core.files import write_atomic
    from flightbed.scenario.template import template

    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise InputError(f"new {name}: a name must be letters, digits, - and _, and start with a letter or digit")
    path = out if out is not None else Path(f"{name}.toml")
    if path.exists():
        raise InputError(f"-o {path}: exists; give another file")
    text = template(name, kind or (), (data.shipped("scenario") / "schema" / "scenario.json").as_uri())
    write_atomic(path, text.encode())
    print_lines([escape(f"written to {path}; fly it: flightbed run {path}")])
