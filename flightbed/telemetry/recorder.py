"""A flight, whole or piece by piece -> what Rerun is told of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import rerun as rr

from flightbed import palette
from flightbed.naming import numbered
from flightbed.telemetry.channels import Plot
from flightbed.telemetry.chase import Aircraft, set_time, time_of
from flightbed.telemetry.modes import lanes, states
from flightbed.telemetry.shown import Event, Shown
from flightbed.trace import Trace

Vector = npt.NDArray[np.float64]


class Recorder:
    """Tells a stream of one flight, as columns.

    Args:
        stream: where to.
        shown: the flight.
        plots: what is plotted.

    """

    def __init__(self, stream: rr.RecordingStream, shown: Shown, plots: Sequence[Plot]) -> None:
        self._stream, self._shown, self._plots = stream, shown, plots
        self._lanes = [
            lane for lane in lanes(shown.detectors, tuple(shown.actuators)) if lane.key != "airframe" or shown.moves_cg
        ]
        self._state = dict.fromkeys((lane.key for lane in self._lanes), -1)
        self._extent: dict[str, tuple[float, float]] = {}
        self._marked: dict[str, tuple[float, float, int]] = {}
        self._aircraft = Aircraft(stream, "world", trail=palette.OTHER, lateral=shown.lateral)
        self._colors = {name: palette.estimate(i) for name, i in numbered(shown.estimators).items()}
        self._last_s = 0.0

    def begin(self) -> None:
        """Tell what does not change: names, colours, the aircraft's shape, the run card."""
        stream = self._stream
        stream.send_recording_name(self._shown.name)
        self.card(self._shown.card)
        for plot in self._plots:
            style = rr.SeriesLines(
                names=[line.label for line in plot.lines],
                colors=[palette.rgb(line.color) for line in plot.lines],
                widths=[line.width for line in plot.lines],
                aggregation_policy="MinMax",  # the mean of what falls on a pixel would hide how far noise goes
            )
            stream.log(plot.key, style, static=True)
            for name in plot.bands:
                color = palette.rgb(self._colors[name])
                band = rr.Measurements.from_fields(names=f"K {name} +-2 sigma", colors=color, units="share")
                stream.log(f"{plot.key}/{name}", band, static=True)
            if self._shown.failures_s:
                style = rr.SeriesLines(
                    names="failure" if len(self._shown.failures_s) == 1 else "failures",
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
        """Tell that the last tick departed, in the lane of the elevator, a little longer than it lasts so that it is seen."""
        for t_s in (self._last_s, 1.03 * self._last_s):
            set_time(self._stream, t_s)
            self._stream.log("mode/elevator", rr.StateChange(state="departed"))

    def card(self, text: str) -> None:
        """Tell the run card, in place of an earlier one."""
        self._stream.log("run_card", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    def events(self, events: Iterable[Event]) -> None:
        """Tell what happened."""
        for event in events:
            set_time(self._stream, event.t_s)
            level = rr.TextLogLevel.ERROR if event.severe else rr.TextLogLevel.INFO
            self._stream.log("events", rr.TextLog(event.text, level=level))

    def add(self, trace: Trace, new: int = 0) -> None:
        """Tell the ticks of a trace from index ``new`` on; those before have been told."""
        part = trace if new == 0 else trace.since(new)
        for plot in self._plots:
            self._lines(plot, part)
            self._mark(plot, part)
        self._modes(trace, new)
        self._aircraft.add(part)
        self._last_s = float(trace["t_s"][-1])

    def _lines(self, plot: Plot, part: Trace) -> None:
        values = np.column_stack([line.values(part) for line in plot.lines])
        columns = rr.Scalars.columns(scalars=values.ravel()).partition([len(plot.lines)] * len(values))
        self._stream.send_columns(plot.key, indexes=time_of(part["t_s"]), columns=columns)
        for name in plot.bands:
            # The band is drawn at one standard deviation of the given variance: four times the variance makes it two.
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
        """Draw a line from bottom to top where a failure begins, a longer one as soon as what is plotted has grown."""
        low, high = plot.range or self._extent.get(plot.key, (0.0, 0.0))
        reached = [t_s for t_s in self._shown.failures_s if t_s <= part["t_s"][-1] + 1e-9]
        wanted = (low, high, len(reached))
        if reached and self._marked.get(plot.key) != wanted:
            self._marked[plot.key] = wanted
            times, values = upright(reached, low, high)
            columns = rr.Scalars.columns(scalars=values)
            self._stream.send_columns(f"{plot.key}/failure", indexes=time_of(times), columns=columns)

    def _modes(self, trace: Trace, new: int) -> None:
        for lane in self._lanes:
            shown = self._shown
            found = states(trace, lane, shown.actuators, faults_s=shown.faults_s, control_hz=shown.control_hz)
            before = np.concatenate([[self._state[lane.key]], found[new:-1]])
            for i in np.flatnonzero(found[new:] != before):
                set_time(self._stream, trace["t_s"][new + i])
                self._stream.log(f"mode/{lane.key}", rr.StateChange(state=lane.states[found[new + i]]))
            self._state[lane.key] = int(found[-1])


def upright(times_s: Sequence[float], low: float, high: float) -> tuple[Vector, Vector]:
    """Return times and values of an upright line at each time, joined along the upper and the lower edge in turn.

    Neither nan nor no value ends a line well: the one makes equal recordings unequal, the other counts as 0.
    """
    ends = [(low, high) if i % 2 == 0 else (high, low) for i in range(len(times_s))]
    return np.repeat(np.asarray(times_s, dtype=float), 2), np.array(ends, dtype=float).ravel()
