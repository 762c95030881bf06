"""Damaged files, and the check of a command that reads one: exit code 0 with a result, or an error of one line; never a traceback."""

from __future__ import annotations

import copy
import io
import json
import sys
import traceback
import zlib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from flightbed.cli import main as cli
from flightbed.core.errors import FlightbedError

Damage = tuple[str, bytes]
WRONG = (None, True, -1, 1e300, float("nan"), "text", "", [], [1, "a"], {}, {"a": 1})  # None is written as JSON only


def of_bytes(content: bytes, *, flips: int) -> Iterator[Damage]:
    """Yield damages of any file: truncated, overwritten, of another type, and single bits flipped at fixed places."""
    rng = np.random.default_rng(zlib.crc32(content[:64]))
    yield "empty", b""
    for share in (0.02, 0.25, 0.5, 0.75, 0.98):
        yield f"truncated to {share:.0%}", content[: int(share * len(content))]
    yield "the last byte missing", content[:-1]
    yield "the first byte missing", content[1:]
    yield "doubled", content + content
    yield "zeros", bytes(len(content))
    yield "noise", rng.bytes(min(len(content), 20_000))
    yield "a hole", content[: len(content) // 3] + content[len(content) // 2 :]
    yield "zeros in the middle", content[: len(content) // 3] + bytes(64) + content[len(content) // 3 + 64 :]
    yield "UTF-16", content.decode("latin-1").encode("utf-16")
    yield "a byte that is not UTF-8", content[: len(content) // 2] + b"\xff" + content[len(content) // 2 :]
    for text in (
        "hello\n",
        "[]\n",
        "{}\n",
        "3\n",
        "null\n",
        '"text"\n',
        "a = 1\n",
        "[" * 100_000,
        "a = " + "[" * 5000,
        "<a/>",
        "PAR1",
    ):
        yield f"text {text[:8]!r}", text.encode()
    for bit in sorted(rng.integers(0, 8 * len(content), flips)):
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << (bit % 8)
        yield f"bit {bit} flipped", bytes(flipped)


def of_values(content: Any, dump: Callable[[Any], bytes]) -> Iterator[Damage]:
    """Yield damages of nested plain values: each one removed, and each of another type."""
    for path in _paths(content):
        *outer, last = path
        for number, value in enumerate(("removed", *WRONG)):
            damaged = copy.deepcopy(content)
            place = damaged
            for key in outer:
                place = place[key]
            if number == 0:
                del place[last]
            else:
                place[last] = copy.deepcopy(value)
            try:
                written = dump(damaged)
            except TypeError:  # TOML has no null
                continue
            yield (
                f"{'.'.join(map(str, path))} = {value!r}" if number else f"{'.'.join(map(str, path))} removed",
                written,
            )


def to_json(value: Any) -> bytes:
    """Return the JSON text of a value, nan and infinity as Python writes them."""
    return json.dumps(value).encode()


def _paths(value: Any, prefix: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*prefix, key)
        yield from _paths(inner, (*prefix, key))


class Commands:
    """Commands on damaged files, and what went wrong with them.

    Attributes:
        wrong: label of a case -> problem.
        refused, done: number of commands with an error of one line, and with a result.

    """

    def __init__(self) -> None:
        self.wrong: dict[str, str] = {}
        self.refused = self.done = 0

    def flightbed(self, label: str, *arguments: object, codes: tuple[int, ...] = (2,), several: bool = False) -> bool:
        """Run a command; return whether it gave a result.

        Args:
            label: of the case.
            arguments: of the command.
            codes: permitted exit codes of an error.
            several: whether the error may have a line for each of several problems.

        """
        out, err = io.TextIOWrapper(io.BytesIO()), io.StringIO()
        try:
            with redirect_stdout(out), redirect_stderr(err):
                cli.main([str(argument) for argument in arguments])
        except SystemExit as ended:
            code = ended.code
        except BaseException as error:  # an exception of any kind is the defect that is looked for
            self.wrong[label] = _place(error)
            return False
        lines = err.getvalue().splitlines()
        if code == 0 and not lines:
            self.done += 1
            return True
        if code not in codes or not lines or any(not line.startswith("flightbed: ") for line in lines):
            self.wrong[label] = f"exit code {code}, stderr {err.getvalue()[:300]!r}"
        elif len(lines) > 1 and not several:
            self.wrong[label] = f"{len(lines)} lines: {err.getvalue()[:300]!r}"
        else:
            self.refused += 1
        return False

    def call(self, label: str, function: Callable[[], Any], *, several: bool = False) -> Any:
        """Call a function; return its result, None for a deliberate error of one line."""
        try:
            found = function()
        except FlightbedError as error:
            self.refused += 1
            if not several and len(str(error).splitlines()) != 1:
                self.wrong[label] = f"{len(str(error).splitlines())} lines: {str(error)[:300]!r}"
            return None
        except BaseException as error:
            self.wrong[label] = _place(error)
            return None
        self.done += 1
        return found

    def check(self, known: dict[str, str] | None = None, *, recovers: bool = False) -> None:
        """Fail if anything went wrong, except cases whose label begins like a key of ``known``, the defects known today.

        With ``recovers`` no case has to be refused, but each kind of damage may be made good.
        """
        left = {k: v for k, v in self.wrong.items() if not any(k.startswith(prefix) for prefix in known or {})}
        text = "\n".join(f"  {label}: {problem}" for label, problem in left.items())
        assert not left, f"{len(left)} of {len(self.wrong) + self.refused + self.done} cases:\n{text}"
        stale = [prefix for prefix in known or {} if not any(label.startswith(prefix) for label in self.wrong)]
        assert not stale, f"no longer wrong: {stale}"
        assert (self.done if recovers else self.refused) > 0


def _place(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        raise error
    inside = [f for f in traceback.extract_tb(sys.exc_info()[2]) if "/flightbed/" in f.filename]
    frame = inside[-1] if inside else None
    where = "" if frame is None else f" in {Path(frame.filename).name}:{frame.lineno} ({frame.name})"
    return f"{type(error).__name__}: {str(error)[:200]!r}{where}"
