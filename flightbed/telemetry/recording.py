"""Trace -> a Rerun recording with its layout, in a file."""

from __future__ import annotations

from pathlib import Path

import rerun as rr

from flightbed.errors import OutputError
from flightbed.telemetry import layout
from flightbed.telemetry.recorder import Recorder
from flightbed.telemetry.shown import Shown
from flightbed.trace import Trace

APPLICATION = "flightbed"


def write_recording(path: Path, trace: Trace, shown: Shown) -> None:
    """Write a flight's recording, whole columns at a time, with its layout. Raises OutputError."""
    wanted = shown.plots(trace)
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
        recorder.events(shown.planned)
        stream.flush()
    stream.disconnect()
