"""Folders of aircraft and scenarios: inside an installed package, or beside it in a source tree."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path

from flightbed.core.errors import InputError, UnknownNameError

_PACKAGE = Path(__file__).resolve().parents[1]


def shipped(kind: str) -> Path:
    """Return the folder of shipped data; ``kind`` is ``"aircraft"``, ``"scenario"`` or ``"campaign"``."""
    if kind == "campaign":
        return shipped("scenario") / "campaigns"
    installed = _PACKAGE / f"{kind}_data"
    return (
        installed if installed.is_dir() else _PACKAGE.parent / {"aircraft": "aircraft", "scenario": "scenarios"}[kind]
    )


def names(kind: str) -> Iterator[str]:
    """Yield the names of shipped aircraft, scenarios or campaigns, sorted."""
    folder = shipped(kind)
    found = (
        (p.parent.name for p in folder.glob("*/aircraft.toml"))
        if kind == "aircraft"
        else (p.stem for p in folder.glob("*.toml"))
    )
    yield from sorted(found)


def find_flights(name: str) -> Path:
    """Return the file of a campaign or a scenario, given a shipped name or a path. An existing path has precedence.

    Raises:
        UnknownNameError: the name is not shipped, and no such path exists.
        InputError: the path cannot be used.

    """
    campaign = shipped("campaign") / f"{name}.toml"
    if Path(name).name == name and campaign.is_file() and not Path(name).is_file():
        return campaign
    try:
        return find("scenario", name)
    except UnknownNameError as error:
        known = (*names("scenario"), *names("campaign"))
        raise UnknownNameError("scenario", name, known, also=" (neither a shipped name nor a path)") from error


def find(kind: str, name: str) -> Path:
    """Return the folder of an aircraft or the file of a scenario, given a shipped name or a path. An existing path has precedence.

    Raises:
        UnknownNameError: the name is not shipped, and no such path exists.
        InputError: the path cannot be used.

    """
    marker = "aircraft.toml" if kind == "aircraft" else ""
    try:
        own = Path(name).expanduser()
        own.stat()
    except (OSError, RuntimeError) as error:  # unknown user, name too long, no permission, or no such path
        if isinstance(error, RuntimeError) or getattr(error, "errno", None) not in (errno.ENOENT, errno.ENOTDIR):
            reason = error.strerror if isinstance(error, OSError) else error
            raise InputError(f"{kind} {name[:60]}: cannot be read: {reason}") from None
    if (own / marker).is_file():
        return own
    candidate = shipped(kind) / (name if kind == "aircraft" else f"{name}.toml")
    if Path(name).name == name and (candidate / marker).is_file():
        return candidate
    if own.is_dir():
        what = f"has no {marker}" if marker else "is a folder; name the TOML file in it"
        raise InputError(f"{kind} {name}: {what}")
    if kind == "aircraft" and own.is_file():
        raise InputError(f"{kind} {name}: is a file; name the folder")
    if "/" in name or name.endswith(".toml"):
        raise InputError(f"{kind} {name}: there is no such {'file' if kind == 'scenario' else 'folder'}")
    raise UnknownNameError(kind, name, names(kind), also=" (neither a shipped name nor a path)")
