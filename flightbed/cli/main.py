"""The entry point of the command line: registers the commands and runs one."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from flightbed.cli.app import app, exit_code
from flightbed.cli.campaign import campaign
from flightbed.cli.compare import compare
from flightbed.cli.compile import compile_
from flightbed.cli.compiling import announcer
from flightbed.cli.completion import install_completion
from flightbed.cli.keys import keys
from flightbed.cli.linearize import linearize
from flightbed.cli.list import list_
from flightbed.cli.new import new
from flightbed.cli.reproduce import reproduce
from flightbed.cli.run import run
from flightbed.cli.schema import schema
from flightbed.cli.trim import trim
from flightbed.cli.upgrade import upgrade
from flightbed.cli.view import view
from flightbed.core.compilation import watched

app.command(run)
app.command(view)
app.command(compare, usage="Usage: flightbed compare [OPTIONS] RUN RUN...")
app.command(trim)
app.command(linearize)
app.command(campaign)
app.command(reproduce)
app.command(compile_, name="compile")
app.command(list_, name="list", usage="Usage: flightbed list [FAMILY]")
app.command(keys, usage="Usage: flightbed keys [PATTERN]")
app.command(new)
app.command(upgrade)
app.command(install_completion, name="--install-completion")
app.command(schema, usage="Usage: flightbed schema [FILE]")


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit; see ``app.exit_code``."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))  # unwinds: scratch folders are removed
    with watched(announcer()):
        code = exit_code(arguments)
    sys.exit(code)
