"""Times of repeated work: order of the calls, ratios round by round, ranges as text."""

from __future__ import annotations

import pytest

from flightbed.core.timing import differences, interleaved, ratios, seconds, spread


def test_ways_take_turns_every_second_round_backwards_and_warm_rounds_are_dropped() -> None:
    called: list[str] = []

    def way(name: str) -> int:
        called.append(name)
        return len(called)

    given = interleaved({name: lambda name=name: way(name) for name in "abc"}, 3)
    assert "".join(called) == "cbaabccbaabc"
    assert given == {"a": [4, 9, 10], "b": [5, 8, 11], "c": [6, 7, 12]}


def test_comparisons_are_made_round_by_round() -> None:
    """The median of the ratios is not the ratio of the medians: here 2, and 10 / 6."""
    over, under = [2.0, 10.0, 60.0], [1.0, 6.0, 30.0]
    assert ratios(over, under) == [2.0, 10.0 / 6.0, 2.0]
    assert differences(over, under) == [1.0, 4.0, 30.0]
    assert spread(ratios(over, under), ".2f") == "2.00 (1.67 to 2.00)"
    with pytest.raises(ValueError, match="zip"):
        ratios(over, under[:2])


def test_ranges_are_median_lowest_and_highest() -> None:
    assert spread([3.0, 1.0, 2.0], ".1f") == "2.0 (1.0 to 3.0)"
    assert spread([1.04, 1.0, 0.96], ".1f") == "1.0"  # all three are written alike


def test_time_is_that_of_one_of_the_calls() -> None:
    clock = iter([10.0, 13.0])
    called: list[None] = []
    assert seconds(lambda: called.append(None), 6, clock=lambda: next(clock)) == 0.5
    assert len(called) == 6
