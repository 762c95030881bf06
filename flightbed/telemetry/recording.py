"""Trace -> a Rerun recording with its layout, in a file."""

from __future__ import annotations

import os
from pathlib import Path

import rerun as rr

from flightbed.errors import OutputError
from flightbed.telemetry import layout
from flightbed.telemetry.channels import with_room
from flightbed.telemetry.recorder import Recorder
from flightbed.telemetry.shown import Shown
from flightbed.trace import Trace

APPLICATION = "flightbed"


def write_recording(path: Path, trace: Trace, shown: Shown) -> None:
    """Write a flight's recording, whole columns at a time, with its layout. Raises OutputError."""
    if os.environ.get("RERUN", "").lower() in ("0", "false", "off"):
        raise OutputError(
            f"{path}: RERUN={os.environ['RERUN']} in the environment keeps Rerun from recording; unset it, or fly with --rerun off"
        )
    wanted = tuple(with_room(plot, trace) for plot in shown.plots(trace))
    stream = rr.RecordingStream(APPLICATION, recording_id=shown.recording_id)
    stream.set_log_time_enabled(False)
    try:
        stream.save(path, default_blueprint=layout.flight(wanted))
    except Exception as error:
        raise OutputError(f"{path}: cannot be written: {error}") from None
    with stream:
        recorder = Recorder(stream, shown, wanted)
        recorder.begin()
        recorder.add(trace)
        if shown.departed:
            recorder.departed()
        recorder.events(shown.planned)
        stream.flush()
    stream.disconnect()
