"""Beyond the thesis, (b): other commands of equal energy and the accuracy of K, on the linear model and on the aircraft."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any

import numpy as np

from flightbed.analysis.seeds import Flown, Job
from flightbed.command.base import energy
from flightbed.document import drawing
from flightbed.document.document import Cell, Picture, Section, Table
from flightbed.scenario.tables import Scenario
from flightbed.statistics.intervals import spread
from flightbed.studies.base import Part, keyed_part
from flightbed.studies.sillence.aircraft import SCHEDULED, f16
from flightbed.studies.sillence.plots import TIME
from flightbed.studies.sillence.setup import estimator, thesis

EXPANDING, WINDOW = "expanding", "window"
PLANTS = MappingProxyType(
    {"linear": 10.0, "F-16": 5.0}
)  # plant -> amplitude of the doublets, deg/s; the other inputs have the energy of these doublets
# Duration 13.5 s, as the doublets; the step lasts to the end of the flight.
INPUTS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "doublet": {"kind": "doublet"},
        "3-2-1-1": {"kind": "3-2-1-1"},
        "chirp": {"kind": "chirp"},
        "multisine": {"kind": "multisine"},
        "random": {"kind": "random", "register_bits": 3, "switch_s": 0.32},
        "step": {"kind": "constant"},
        "none": {"kind": "none"},
    }
)
_STYLES = MappingProxyType(
    {
        "doublet": ("#000000", "-"), "3-2-1-1": ("#d55e00", "-"), "chirp": ("#0072b2", "-"), "multisine": ("#009e73", "-"),
        "random": ("#e69f00", "-"), "step": ("#cc79a7", "-"), "none": ("#777777", ":"),
    }
)  # fmt: skip
_Key = tuple[str, str, str]


def excitation(runs: int) -> Part:
    """Fly each input at equal energy, without failure, with an expanding filter and with a window filter."""
    jobs = {
        (plant, name, memory): Job(
            flight(plant, name, memory), runs, (TIME, "elevator_deg", f"{memory}.effectiveness_std", "effectiveness_bound")
        )
        for plant, name, memory in product(PLANTS, INPUTS, (EXPANDING, WINDOW))
    }  # fmt: skip

    def build(flown: Mapping[_Key, list[Flown]]) -> Section:
        return Section(
            "(b) Other inputs",
            [
                "All inputs have the same energy of the commanded pitch rate, the integral of its square, and pass the prefilter "
                "3/(s+3). Nothing fails; the law is fixed; the readings are the prior of the filters, and u of the linear model is the "
                "mean over the sample. The bound is the Cramer-Rao bound of K along the flown trajectory, for an observer without prior "
                "information on state and K: no unbiased filter has a smaller sigma. The product of the bound and the square root of an "
                "energy is a price of accuracy: the sigma for one (deg/s)^2 s of command, or for one deg^2 s of elevator.",
                "Information on K comes from the elevator, and the elevator's energy differs from the command's: the prefilter "
                "attenuates fast inputs, and the loop answers fast inputs with more elevator per deg/s. On the linear model slow inputs "
                "give the most information for their energy over the whole flight, because the unstable motion that they excite is long "
                "and large; within a window of 0.3 s the broadband inputs, chirp and multisine, halve the doublets' sigma, because they "
                "have no quiet interval.",
                "On the aircraft the form of the input hardly matters, and within a window no command is as informative as any command: "
                "the trim deflection acts at every tick, and with the absolute input the loss of its moment shows K. Over all data sigma "
                "is several times the bound, because the scheduled filter has to assume process noise; the error comes from the model as "
                "much as from the noise, and is largest without any command, where a constant error of the modelled moment is attributed "
                "to K.",
            ],
            [
                *(_table(plant, flown) for plant in PLANTS),
                *(_picture(plant, flown) for plant in PLANTS),
            ],
        )

    return keyed_part(jobs, build)


def flight(plant: str, name: str, memory: str) -> Scenario:
    """Return a scenario without failure, with an input of the doublets' energy and one filter that does not correct the law.

    Args:
        plant: key of ``PLANTS``.
        name: key of ``INPUTS``.
        memory: ``EXPANDING`` or ``WINDOW``.

    """
    command = _command(name, amplitude(plant, name))
    if plant == "linear":
        filters = [estimator(memory, memory, input_at="mean", prior={"state": "measurement"})]
        return thesis(left=None, estimators=filters, command=command)
    given = next(e for e in f16().estimators if e.name == SCHEDULED)
    scheduled = given.model_dump(exclude={"prior"}, exclude_unset=True)
    settled = {"alarm_threshold": 0.0, "follow_disturbances": False, "hold_std": 0.0, "bounds": (-1000.0, 1000.0)}
    if memory == EXPANDING:
        del settled["alarm_threshold"], scheduled["window"]
    filters = [{**scheduled, **settled, "name": memory, "memory": memory}]
    return f16(left=None, failures=[], command=command, estimators=filters)


def _command(name: str, amplitude_deg_s: float) -> Mapping[str, Any]:
    """Return the table of an input with an amplitude, which the input "none" does not have."""
    return INPUTS[name] if name == "none" else {**INPUTS[name], "amplitude_deg_s": amplitude_deg_s}


def amplitude(plant: str, name: str) -> float:
    """Return the amplitude, deg/s, at which an input has the energy of the plant's doublets; 0 for the input "none"."""
    doublets, own = (_energy_deg2_s(plant, which) for which in ("doublet", name))
    return PLANTS[plant] * float(np.sqrt(doublets / own)) if own else 0.0


def _energy_deg2_s(plant: str, name: str) -> float:
    """Return the energy, (deg/s)^2 s, over the flight of an input with the amplitude of the plant's doublets."""
    base = thesis(left=None, command=_command(name, PLANTS[plant]))
    command = base.command.rate()
    hz = base.rates.control_hz
    return energy(np.degrees(command(np.arange(base.ticks) / hz)), control_hz=hz)


def _elevator_energy(flown: Flown) -> float:
    elevator = flown.columns["elevator_deg"]
    return float(np.sum((elevator - elevator[0]) ** 2) / 100.0)


def _table(plant: str, flown: Mapping[_Key, Sequence[Flown]]) -> Table:
    rows: list[list[Cell]] = []
    for name in INPUTS:
        expanding, window = flown[plant, name, EXPANDING], flown[plant, name, WINDOW]
        given = 0.0 if name == "none" else _energy_deg2_s(plant, "doublet")
        elevator_energy = float(np.median([_elevator_energy(f) for f in expanding]))
        bound = float(np.median([f.columns["effectiveness_bound"][-1] for f in expanding]))
        errors = [final - 1.0 for f in expanding if (final := f.metrics.estimators[EXPANDING].final) is not None]
        sigma = float(np.median([f.columns[f"{EXPANDING}.effectiveness_std"][-1] for f in expanding]))
        rows.append([
            name, amplitude(plant, name), elevator_energy,
            sigma,
            float(np.sqrt(np.mean(np.square(errors)))), bound, *(1e3 * x * given**0.5 if given else None for x in (sigma, bound)),
            *(1e3 * x * elevator_energy**0.5 for x in (sigma, bound)),
            spread([_median_late(f, f"{WINDOW}.effectiveness_std") for f in window]),
            spread([_median_late(f, "effectiveness_bound") for f in window]),
        ])  # fmt: skip
    columns = (
        "input", "amplitude, deg/s", "elevator energy, deg^2 s", "sigma, all data", "RMS error, all data", "bound, all data",
        "sigma x sqrt(command energy), 1e-3 deg/sqrt(s)", "bound x the same", "sigma x sqrt(elevator energy), 1e-3 deg sqrt(s)",
        "bound x the same ", "sigma, window", "bound, window",
    )  # fmt: skip
    formats = {"amplitude, deg/s": ".2f", "elevator energy, deg^2 s": ".1f"} | dict.fromkeys(columns[3:6], ".5f")
    formats |= dict.fromkeys(columns[6:10], ".2f") | dict.fromkeys(columns[10:], ".3f")
    return Table(
        f"inputs_{plant.lower()}", f"Inputs of {_energy_deg2_s(plant, 'doublet'):.0f} (deg/s)^2 s, {plant}", columns, rows, formats,
        note=f"{len(flown[plant, 'none', EXPANDING])} flights each: medians; RMS error of K-hat at the end over the flights. All data: "
        "expanding filter at 16.5 s; window: 30 samples, median over the flight from 0.3 s on, median [5 %, 95 %] over the flights. The "
        "step lasts 16.5 s, the other inputs 13.5 s. None: the information comes from sensor noise that the law feeds back.",
    )  # fmt: skip


def _median_late(flown: Flown, column: str) -> float:
    values = flown.columns[column][flown.columns[TIME] > 0.3]
    return float(np.median(values))


def _picture(plant: str, flown: Mapping[_Key, Sequence[Flown]]) -> Picture:
    key, reached = f"inputs-{plant.lower()}", []
    with drawing.canvas(1, height=2.8) as ((axis,), svg):
        for name, (color, line) in _STYLES.items():
            columns = flown[plant, name, EXPANDING][0].columns
            t, bound = columns[TIME], columns["effectiveness_bound"]
            defined = np.isfinite(bound) & (t > 0.05)
            axis.semilogy(t[defined], bound[defined], color=color, linestyle=line, label=name)
            below = np.flatnonzero(bound <= 0.01)
            reached.append(f"{name} {f'{t[below[0]]:.2f} s' if below.size else 'never'}")
        axis.set_ylabel("bound on sigma of K")
        axis.set_xlabel("time, s")
        drawing.legend(axis)
        drawn = drawing.distinct(svg(), key)
    return Picture(
        key, f"Cramer-Rao bound of K from all data since the start, {plant}", drawn, "Cramer-Rao bound, nothing fails, fixed law, seed 0.",
        f"Below 0.01 from: {', '.join(reached)}.",
    )  # fmt: skip
