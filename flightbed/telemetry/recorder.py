"""Trace of a flight, complete or in parts -> Rerun log."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from flightbed.analysis.trace import Trace
from flightbed.core.estimate_names import estimator_indices
from flightbed.document import palette
from flightbed.telemetry.channels import Plot
from flightbed.telemetry.chase import Aircraft, set_time, time_of
from flightbed.telemetry.flight_info import Event, FlightInfo
from flightbed.telemetry.state_lanes import lanes, states

Vector = npt.NDArray[np.float64]


class Recorder:
    """Logs one flight to a stream, as columns.

    Args:
        stream: recording stream.
        info: description of the flight.
        plots: plots of the flight.

    """

    def __init__(self, stream: rr.RecordingStream, info: FlightInfo, plots: Sequence[Plot]) -> None:
        self._stream, self._info, self._plots = stream, info, plots
        self._lanes = [
            lane for lane in lanes(info.detectors, tuple(info.actuators)) if lane.key != "airframe" or info.moves_cg
        ]
        self._state = dict.fromkeys((lane.key for lane in self._lanes), -1)
        self._extent: dict[str, tuple[float, float]] = {}
        self._marked: dict[str, tuple[float, float, int]] = {}
        self._aircraft = Aircraft(stream, "world", trail=palette.OTHER, lateral=info.lateral)
        self._colors = {name: palette.estimate(i) for name, i in estimator_indices(info.estimators).items()}
        self._last_s = 0.0

    def begin(self) -> None:
        """Log the static data: names, colours, the aircraft's mesh, the text summary."""
        stream = self._stream
        stream.send_recording_name(self._info.name)
        self.summary_text(self._info.summary_text)
        for plot in self._plots:
            style = rr.SeriesLines(
                names=[line.label for line in plot.lines],
                colors=[palette.rgb(line.color) for line in plot.lines],
                widths=[line.width for line in plot.lines],
                aggregation_policy="MinMax",  # the mean per pixel would hide the amplitude of noise
            )
            stream.log(plot.key, style, static=True)
            for name in plot.bands:
                color = palette.rgb(self._colors[name])
                band = rr.Measurements.from_fields(names=f"K {name} +-2 sigma", colors=color, units="share")
                stream.log(f"{plot.key}/{name}", band, static=True)
            if self._info.failures_s:
                style = rr.SeriesLines(
                    names="failure" if len(self._info.failures_s) == 1 else "failures",
                    colors=palette.rgb(palette.FAILURE),
                    widths=1.2,
                    aggregation_policy="Off",
                )
                stream.log(f"{plot.key}/failure", style, static=True)
        for lane in self._lanes:
            colors = np.array([0xFF + (int(color[1:], 16) << 8) for color in lane.colors], dtype=np.uint32)
            stream.log(f"mode/{lane.key}", rr.StateConfiguration(values=list(lane.states), colors=colors), static=True)
        stream.log("world", rr.ViewCoordinates.FRD, static=True)
        self._aircraft.begin()

    def departed(self) -> None:
        """Log the departure at the last tick in the lane of the elevator, extended in time by 3 % to be visible."""
        for t_s in (self._last_s, 1.03 * self._last_s):
            set_time(self._stream, t_s)
            self._stream.log("mode/elevator", rr.StateChange(state="departed"))

    def summary_text(self, text: str) -> None:
        """Log the text summary; it replaces an earlier one."""
        self._stream.log("run_card", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    def events(self, events: Iterable[Event]) -> None:
        """Log events."""
        for event in events:
            set_time(self._stream, event.t_s)
            level = rr.TextLogLevel.ERROR if event.severe else rr.TextLogLevel.INFO
            self._stream.log("events", rr.TextLog(event.text, level=level))

    def add(self, trace: Trace, new: int = 0) -> None:
        """Log the ticks of a trace from index ``new`` on; the earlier ones are already logged."""
        part = trace if new == 0 else trace.since(new)
        for plot in self._plots:
            self._lines(plot, part)
            self._mark(plot, part)
        self._state_lanes(trace, new)
        self._aircraft.add(part)
        self._last_s = float(trace["t_s"][-1])

    def _lines(self, plot: Plot, part: Trace) -> None:
        values = np.column_stack([line.values(part) for line in plot.lines])
        columns = rr.Scalars.columns(scalars=values.ravel()).partition([len(plot.lines)] * len(values))
        self._stream.send_columns(plot.key, indexes=time_of(part["t_s"]), columns=columns)
        for name in plot.bands:
            # The viewer draws a band of one standard deviation: four times the variance gives two.
            variances = 4.0 * part[f"{name}.effectiveness_std"] ** 2
            self._stream.send_columns(
                f"{plot.key}/{name}",
                indexes=time_of(part["t_s"]),
                columns=rr.Measurements.columns(values=part[f"{name}.effectiveness"], variances=variances),
            )
        low, high = self._extent.get(plot.key, (np.inf, -np.inf))
        finite = values[np.isfinite(values)]
        if finite.size:
            self._extent[plot.key] = min(low, float(finite.min())), max(high, float(finite.max()))

    def _mark(self, plot: Plot, part: Trace) -> None:
        """Mark the onset of failures by vertical lines over the extent of the plot; redraw them when the extent grows."""
        low, high = plot.range or self._extent.get(plot.key, (0.0, 0.0))
        reached = [t_s for t_s in self._info.failures_s if t_s <= part["t_s"][-1] + 1e-9]
        wanted = (low, high, len(reached))
        if reached and self._marked.get(plot.key) != wanted:
            self._marked[plot.key] = wanted
            times, values = vertical_lines(reached, low, high)
            columns = rr.Scalars.columns(scalars=values)
            self._stream.send_columns(f"{plot.key}/failure", indexes=time_of(times), columns=columns)

    def _state_lanes(self, trace: Trace, new: int) -> None:
        info = self._info
        for lane in self._lanes:
            state = states(trace, lane, info.actuators, faults_s=info.faults_s, control_hz=info.control_hz)
            before = np.concatenate([[self._state[lane.key]], state[new:-1]])
            for i in np.flatnonzero(state[new:] != before):
                set_time(self._stream, trace["t_s"][new + i])
                self._stream.log(f"mode/{lane.key}", rr.StateChange(state=lane.states[state[new + i]]))
            self._state[lane.key] = int(state[-1])


def vertical_lines(times_s: Sequence[float], low: float, high: float) -> tuple[Vector, Vector]:
    """Return times and values (2 n,) of a single line that is vertical at each time, joined alternately along both edges.

    A break by nan would make equal recordings compare unequal; a missing value would be drawn as 0.
    """
    ends = [(low, high) if i % 2 == 0 else (high, low) for i in range(len(times_s))]
    return np.repeat(np.asarray(times_s, dtype=float), 2), np.array(ends, dtype=float).ravel()
