"""Trace -> file with a Rerun recording and its layout."""

from __future__ import annotations

import os
from pathlib import Path

import rerun as rr

from flightbed.analysis.trace import Trace
from flightbed.core.errors import OutputError
from flightbed.telemetry import layout
from flightbed.telemetry.channels import with_room
from flightbed.telemetry.flight_info import FlightInfo
from flightbed.telemetry.recorder import Recorder

APPLICATION = "flightbed"


def write_recording(path: Path, trace: Trace, info: FlightInfo) -> None:
    """Write the recording of a flight with its layout, by whole columns. Raises OutputError."""
    if os.environ.get("RERUN", "").lower() in ("0", "false", "off"):
        raise OutputError(
            f"{path}: the environment variable RERUN disables recording (got {os.environ['RERUN']}); "
            "unset it, or fly with --rerun off"
        )
    wanted = tuple(with_room(plot, trace) for plot in info.plots(trace))
    stream = rr.RecordingStream(APPLICATION, recording_id=info.recording_id)
    stream.set_log_time_enabled(False)
    try:
        stream.save(path, default_blueprint=layout.flight(wanted))
    except Exception as error:
        raise OutputError(f"{path}: cannot be written: {error}") from None
    with stream:
        recorder = Recorder(stream, info, wanted)
        recorder.begin()
        recorder.add(trace)
        if info.departed:
            recorder.departed()
        recorder.events(info.planned)
        stream.flush()
    stream.disconnect()
