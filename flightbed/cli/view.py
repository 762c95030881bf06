"""The command `flightbed view`."""

from __future__ import annotations

from pathlib import Path

from flightbed.core.errors import InputError, OutputError


def view(
    folder: str,
    /,
    *,
    picture: Path | None = None,
    at_s: float | None = None,
    tab: str | None = None,
) -> int:
    """Open the recording of a run or a comparison in the Rerun viewer.

    Args:
        folder: Folder written by `flightbed run` or `flightbed compare`.
        picture: Write a picture of the viewer to this PNG file instead; needs no display.
        at_s: Flight time in the picture, s. Default: the end of the flight.
        tab: Page in the picture: overview, estimators, airframe, or "roll and yaw" of a flight that commands them. Default: overview.

    """
    from flightbed.runs.folder import recording_of
    from flightbed.telemetry import viewer

    recording = recording_of(folder)
    if picture is not None:
        viewer.picture(recording, picture, at_s=at_s, tab=tab)
        return 0
    for option, value in (("--at-s", at_s), ("--tab", tab)):
        if value is not None:
            raise InputError(f"{option} {value}: has no effect without --picture")
    if not viewer.has_display():
        raise OutputError(
            f"the viewer has no display; write a picture with --picture FILE.png, copy {recording} to a machine with a display, "
            f"or serve it to a browser: rerun --bind 127.0.0.1 --web-viewer {recording}"
        )
    return viewer.view(recording)
