"""The message on stderr while kernels are compiled, which happens once per version of the sources."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress

from rich.errors import LiveError

from flightbed.cli.screen import stderr

# Beginning of the dotted name of a kernel -> its name for users, and the seconds that the kernels of this name take for one flight,
# measured with an empty cache on one core of a busy server of 2024. The first that fits.
PARTS = (
    ("flightbed.flight.", "the flight computer", 8),
    ("flightbed.estimation.loop_gain.", "the loop-gain estimator", 6),
    ("flightbed.estimation.two_stage.", "the two-stage estimator", 25),
    ("flightbed.estimation.plid.", "the PLID estimator", 2),
    ("flightbed.estimation.differentiated_rls.", "the estimator differentiated-rls", 2),
    ("flightbed.estimation.reconstruction.retrospective", "the estimator retrospective-cost", 17),
    ("flightbed.estimation.reconstruction.input_kalman", "the estimator input-kalman", 2),
    ("flightbed.estimation.reconstruction.", "the regression for K", 8),
    ("flightbed.avionics.", "the models on board", 3),
    ("flightbed.control.load_factor.", "the load-factor laws", 7),
    ("flightbed.control.", "the pitch law", 1),
    ("flightbed.analysis.cramer_rao.", "the Cramer-Rao bound", 2),
    ("flightbed.plant.", "sensors and plant", 1),
    ("flightbed.core.", "the standard atmosphere", 1),
    ("flightbed.studies.", "the simulation of the study", 10),
)


def part_of(kernel: str) -> tuple[str, int]:
    """Return the name for users of a kernel, given its dotted name, and the seconds that it takes to compile."""
    found = ((part, seconds) for start, part, seconds in PARTS if kernel.startswith(start))
    return next(found, (kernel.rpartition(".")[0], 10))


def announcer() -> Callable[[str], AbstractContextManager[None]]:
    """Return a watcher of compilation: it prints one line per part; on a terminal a line with a spinner, which disappears."""
    printed = set[str]()

    @contextmanager
    def announce(kernel: str) -> Iterator[None]:
        part, seconds = part_of(kernel)
        line = f"compiling {part}, once, about {seconds} s"
        if stderr.is_terminal:
            status = stderr.status(line)
            with suppress(LiveError):  # an older rich shows one moving line at a time: the progress bar
                status.start()
            try:
                yield
            finally:
                status.stop()
            return
        if part not in printed:
            printed.add(part)
            print(line, file=sys.stderr, flush=True)
        yield

    return announce
