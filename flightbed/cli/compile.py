"""The command `flightbed compile`."""

from __future__ import annotations

import time

from flightbed.cli.screen import print_lines, progress_bar


def compile_() -> None:
    """Compile all that the shipped scenarios need, once: later flights start at once. The result is in the user's cache folder."""
    from flightbed.runs.kernels import compile_shipped

    began = time.perf_counter()
    with progress_bar() as progress:
        flown = compile_shipped(progress)
    print_lines([f"{flown} scenarios flown in {time.perf_counter() - began:.0f} s; all that they need is compiled"])
