"""`flightbed keys`: the keys of a scenario."""

from __future__ import annotations

from pathlib import Path

import pytest

from flightbed.cli.main import main
from flightbed.config.catalogue import catalogue
from flightbed.scenario.tables import Scenario
from tests.command_line import assert_one_clear_line, flightbed


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    """Return the lines that the command prints."""
    with pytest.raises(SystemExit) as ended:
        main(["keys", *arguments])
    assert not ended.value.code
    return capsys.readouterr().out.splitlines()


def test_a_key_has_range_unit_default_description_condition_and_kinds(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys, "estimators.forgetting")
    at = lines.index("estimators.forgetting  between 0.5 and 1; default 0.98")
    assert lines[at + 1].startswith("    ")
    found = [line for line in lines if 'Only with memory = "fading".' in line and "(loop-gain" in line]
    assert len(found) == 1
    (head, text) = printed(capsys, "failures.at_s")
    assert head == "failures.at_s  between 0 and 1000000 s; required"
    assert text.startswith("    Onset; ")
    assert text.endswith("(bias, cg-shift, effectiveness, floating, hardover, ramp, rate-limit, structural, stuck)")


def test_a_pattern_finds_keys_kinds_and_descriptions(capsys: pytest.CaptureFixture[str]) -> None:
    everything = printed(capsys)
    assert len(everything) == 2 * len(catalogue(Scenario)) > 200
    assert [line.partition(" ")[0] for line in printed(capsys, "HARDOVER")[::2]] == [
        "failures.kind",
        "failures.at_s",
        "failures.surface",
        "failures.side",
    ]
    assert "adaptation.oracle" in "".join(printed(capsys, "the true K corrects"))


def test_every_key_of_a_scenario_has_a_description() -> None:
    keys = catalogue(Scenario)
    assert [key.path for key in keys if not key.description] == []
    assert [key.path for key in keys if "\n" in key.description or "``" in key.description] == []
    assert len({(key.path, key.kinds) for key in keys}) == len(keys)


def test_a_pattern_that_no_key_contains_is_an_error(tmp_path: Path) -> None:
    assert_one_clear_line(
        ["keys", "nosuch"], 2, "keys nosuch: no key contains it; flightbed keys lists all", cwd=tmp_path
    )


def test_lines_are_not_wrapped_in_a_pipe(tmp_path: Path) -> None:
    assert len(flightbed("keys", "failures.at_s", cwd=tmp_path).stdout.splitlines()) == 2
