"""Text summary of a flight: settings, failures and outcome."""

from __future__ import annotations

from flightbed.analysis.events import failures, gusts, milliseconds
from flightbed.analysis.metrics import PHASES
from flightbed.analysis.punctuality import Punctuality
from flightbed.analysis.summary import RunSummary
from flightbed.scenario.tables import Scenario


def run_text(scenario: Scenario, summary: RunSummary) -> str:
    """Return the text summary of a flight, Markdown."""
    trim, condition = summary.trim, scenario.condition
    pace = f"- real time: {pace_text(summary.realtime, summary.flown_s)}\n" if summary.realtime else ""
    estimators = "".join(
        f"| {name} | {_show(m.median_abs_error_post, '.3f')} | {_show(m.rms_error_smoothed_post, '.3f')} "
        f"| {_show(m.first_within_20pct_s, '.2f')} | {_show(m.nis_mean, '.2f')} | {_show(m.nis_expected, 'g')} |\n"
        for name, m in summary.metrics.estimators.items()
    )
    own = "; ".join(f"{code.name}, SHA-256 {(code.sha256 or 'unknown')[:12]}" for code in summary.extensions)
    own_line = f"- own code: {own}\n" if own else ""
    table = (
        f"| estimator | median abs. error | smoothed RMS error | first within 20 %, s | mean NIS | expected NIS |\n"
        f"|---|---|---|---|---|---|\n{estimators}\n"
    )
    return (
        f"# {scenario.name}\n\n{scenario.description}\n\n"
        f"**{scenario.aircraft.model}**, Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft, seed {scenario.seed}: "
        f"**{outcome(summary)}**\n\n"
        f"- trim: alpha {trim.alpha_deg:.3f} deg, elevator {trim.elevator_deg:.3f} deg\n"
        f"- law: {scenario.control.law}; {correction(scenario)}\n"
        f"- tracking RMS: {tracking_words(scenario, summary)}\n{pace}"
        f"{_failure_lines(scenario)}{own_line}\n"
        f"{table if estimators else ''}"
        f"flightbed {summary.versions['flightbed']}, JSBSim {summary.versions['jsbsim']}\n"
    )


# Quantities with a reference: (words, end of their keys tracking_rms_pre_KEY and tracking_rms_post_KEY in metrics.json, unit).
FOLLOWED = (
    ("q - q_ref", "deg_s", "deg/s"), ("nz - nz_ref", "nz_g", "g"), ("p - p_ref", "p_deg_s", "deg/s"),
    ("beta - beta_ref", "beta_deg", "deg"),
)  # fmt: skip


def followed(scenario: Scenario) -> tuple[tuple[str, str, str], ...]:
    """Return the quantities of FOLLOWED with a reference: pitch rate or load factor; roll rate and sideslip where commanded."""
    pitch, pulled, *turning = FOLLOWED
    return (pulled if scenario.in_g else pitch, *(turning if scenario.lateral.enabled else ()))


def tracking_words(scenario: Scenario, summary: RunSummary) -> str:
    """Return the tracking RMS of every quantity with a reference, in words."""
    texts = []
    for what, key, unit in followed(scenario):
        before, after = (_show(summary.metrics.tracking_rms(phase, key), ".2f") for phase in PHASES)
        words = f"{before} {unit}"
        if summary.failed_at_s is not None:
            words += f" before, {after} {unit} from 0.3 s after the failure"
        texts.append(f"{what} {words}" if len(followed(scenario)) > 1 or scenario.in_g else words)
    return "; ".join(texts)


def _failure_lines(scenario: Scenario) -> str:
    """Return the lines of the summary on failures and air."""
    return (
        f"- failures: {'; '.join(failures(scenario)) or 'none'}\n"
        f"- air: turbulence {scenario.atmosphere.turbulence}; gusts {'; '.join(gusts(scenario)) or 'none'}\n"
    )


def plan_text(scenario: Scenario) -> str:
    """Return the text summary of a flight before take-off, Markdown."""
    condition = scenario.condition
    return (
        f"# {scenario.name}\n\n{scenario.description}\n\n"
        f"**{scenario.aircraft.model}**, Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft, seed {scenario.seed}: in flight\n\n"
        f"- law: {scenario.control.law}; {correction(scenario)}\n"
        f"{_failure_lines(scenario)}"
    )


def settings_rows(scenario: Scenario, aircraft: str) -> list[tuple[str, str]]:
    """Return the settings of a flight as (name, words): aircraft, condition, command, law, sensors, air, failures, seed.

    Args:
        scenario: the settings.
        aircraft: name of the aircraft.

    """
    condition, sensors, rates, noise = scenario.condition, scenario.sensors, scenario.rates, scenario.process_noise
    shift = scenario.aircraft.cg_shift_cbar
    climb = f", flight path {condition.gamma_deg:+g} deg" if condition.gamma_deg else ""
    biases = {
        "alpha bias {:g} deg": sensors.alpha_bias_deg,
        "q bias {:g} deg/s": sensors.q_bias_deg_s,
        "Mach error {:.2%}": sensors.mach_error,
    }
    late = f", commands {rates.delay_ticks} ticks late" if rates.delay_ticks else ""
    unknown = {k: v for k, v in scenario.model_error.model_dump().items() if v != (1.0 if k.startswith("cm_") else 0.0)}
    rows = [
        ("aircraft", aircraft + (f", c.g. {shift:+.1%} of the chord, aft positive" if shift else "")),
        ("condition", f"Mach {condition.mach:g}, {condition.altitude_ft:,.0f} ft{climb}"),
        ("command", command(scenario)),
        *(_lateral_rows(scenario) if scenario.lateral.enabled else ()),
        ("law", f"{scenario.control.law}, {correction(scenario)}"),
        ("rates", f"control {rates.control_hz} Hz, plant {rates.plant_hz} Hz{late}"),
        ("sensors", "; ".join([
            f"white noise of alpha {sensors.alpha_std_deg:g} deg, of q {sensors.q_std_deg_s:g} deg/s"
            + (f", of beta {sensors.beta_std_deg:g} deg, of p {sensors.p_std_deg_s:g} and of r {sensors.r_std_deg_s:g} deg/s"
               if scenario.lateral.enabled else ""),
            *(text.format(value) for text, value in biases.items() if value),
        ])),
        ("air", f"turbulence {scenario.atmosphere.turbulence}; gusts {'; '.join(gusts(scenario)) or 'none'}"),
        ("failures", "; ".join(failures(scenario)) or "none"),
        ("seed", str(scenario.seed)),
    ]  # fmt: skip
    if noise.alpha_std_deg_s or noise.q_std_deg_s2:
        rows.append(("process noise", f"{noise.alpha_std_deg_s:g} deg/s, {noise.q_std_deg_s2:g} deg/s^2"))
    if unknown:
        rows.append(("unknown on board", ", ".join(f"{key} {value:g}" for key, value in unknown.items())))
    return rows


def _lateral_rows(scenario: Scenario) -> list[tuple[str, str]]:
    """Return commands and regulator of roll and yaw as (name, words)."""
    lateral = scenario.lateral
    weights = ", ".join(
        f"{name} {value:g} {unit}"
        for name, value, unit in (
            ("beta", lateral.beta_deg, "deg"),
            ("p", lateral.p_deg_s, "deg/s"),
            ("r", lateral.r_deg_s, "deg/s"),
            ("aileron", lateral.aileron_deg, "deg"),
            ("rudder", lateral.rudder_deg, "deg"),
        )
    )
    return [
        ("roll-rate command", command(scenario, "lateral.roll")),
        ("sideslip command", command(scenario, "lateral.sideslip")),
        ("roll and yaw", f"LQ regulator; equal cost of {weights}"),
    ]


def command(scenario: Scenario, place: str = "command") -> str:
    """Return a command in words: its kind and every key that it uses; for external code every key that is set.

    Args:
        scenario: the settings.
        place: the table of the command: ``"command"``, ``"lateral.roll"`` or ``"lateral.sideslip"``.

    """
    amplitude = "amplitude_g" if scenario.in_g else "amplitude_deg_s"
    words = {
        "command": lambda: scenario.command.in_words(amplitude),
        "lateral.roll": lambda: scenario.lateral.roll.in_words("amplitude_deg_s"),
        "lateral.sideslip": lambda: scenario.lateral.sideslip.in_words("amplitude_deg"),
    }
    return words[place]()


def correction(scenario: Scenario) -> str:
    """Return the correction of the law in words."""
    adaptation = scenario.adaptation
    if not adaptation.enabled:
        return "not corrected"
    return "corrected by 1/K of " + ("the oracle" if adaptation.oracle else f"'{adaptation.estimator}'")


def outcome(summary: RunSummary) -> str:
    """Return the end of a flight in words."""
    failed, ended_s = summary.failed_at_s, summary.ended_s
    after = "" if failed is None else f", {ended_s - failed:.2f} s after the failure"
    if summary.metrics.departed:
        return f"departed at {ended_s:.2f} s{after}"
    if summary.ended == "ground":
        return f"hit the ground at {ended_s:.2f} s{after}"
    return f"flown to {summary.flown_s:g} s"


def pace_text(kept: Punctuality, flown_s: float) -> str:
    """Return the timing of a paced flight of ``flown_s`` in words."""
    worst, jitter, compute = kept.worst_overrun_ms, kept.jitter_ms, kept.compute_ms
    late = "" if worst is None else f" ({kept.late_share:.2%}), worst by {milliseconds(worst)} ms"
    return (
        f"{kept.ticks} ticks at {kept.ticks / flown_s:g} Hz: {kept.late_ticks} late{late}; "
        f"jitter p95 {milliseconds(jitter.p95)}, max {milliseconds(jitter.max)} ms; "
        f"compute p50 {milliseconds(compute.p50)}, p99 {milliseconds(compute.p99)} ms"
    )


def _show(value: float | None, spec: str) -> str:
    return "-" if value is None else format(value, spec)
