"""Units in names, and factors between them."""

from __future__ import annotations

import pytest

from flightbed.core.units import conversion, unit_of


@pytest.mark.parametrize(
    ("field", "column", "factor"),
    [
        ("alpha_rad", "alpha_deg", 57.29577951308232), ("q_rad_s", "q_deg_s", 57.29577951308232), ("altitude_m", "altitude_ft", 3.280839895013123),
        ("gust_up_m_s", "gust_up_fps", 3.280839895013123), ("mach", "mach", 1.0), ("thrust_n", "thrust_n", 1.0),
    ],
)  # fmt: skip
def test_a_column_in_another_unit_than_its_field(field: str, column: str, factor: float) -> None:
    assert conversion(unit_of(field), unit_of(column)) == pytest.approx(factor, rel=1e-15)


def test_units_that_do_not_fit_are_refused() -> None:
    with pytest.raises(KeyError):
        conversion("rad", "ft")
