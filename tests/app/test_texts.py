"""Numbers as people read them."""

from __future__ import annotations

import pytest
from ispom_app.presentation.texts import (
    KILOMETRE,
    METRE,
    MILLIMETRE,
    Unit,
    angle,
    computing_time,
    digits,
    length,
    length_unit,
    lengths,
    size,
)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (19.68, "19.7"),
        (0.2756, "0.28"),
        (5.9308, "5.93"),
        (0.0028, "0.0028"),
        (0.9996, "1.00"),
        (999.7, "1000"),
        (1234.4, "1234"),
        (-0.5, "-0.50"),
        (0.0, "0"),
    ],
)
def test_a_number_has_three_digits_from_one_on_and_two_below(value: float, text: str) -> None:
    assert digits(value) == text


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (2.756e-4, "0.28 mm"),
        (2.5e-4, "0.25 mm"),
        (0.0197, "19.7 mm"),
        (0.0839, "83.9 mm"),
        (6.83, "6.83 m"),
        (4.5e-16, "0 mm"),
        (-0.5, "-500 mm"),
        (12_345.0, "12.3 km"),
    ],
)
def test_the_unit_of_a_length_fits_its_size_and_is_never_a_micrometre(metres: float, text: str) -> None:
    assert length(metres) == text


def test_a_column_shares_one_unit() -> None:
    assert lengths([2.5e-4, 0.0197, None]) == ["0.25 mm", "19.7 mm", ""]
    assert lengths([2.756e-4, 5.9e-3, 7.2e-4]) == ["0.28 mm", "5.90 mm", "0.72 mm"]
    assert lengths([0.0052, 1.3]) == ["5.20 mm", "1300 mm"]
    assert lengths([0.021, 123.0], "-") == ["0.021 m", "123 m"]
    assert lengths([12_000.0, 20.0]) == ["12000 m", "20.0 m"]
    assert lengths([None, None], "n/a") == ["n/a", "n/a"]
    assert length_unit([0.5, 2.0]) is METRE


@pytest.mark.parametrize(
    ("lengths_m", "unit"),
    [
        ([999.9], METRE),
        ([1000.0], KILOMETRE),
        ([1000.0, 999.9], METRE),
        ([100.0, 5000.0], METRE),
        ([10.0, 0.001], METRE),
        ([9.9, 0.009], MILLIMETRE),
        ([1.0, 0.01], METRE),
        ([0.99], MILLIMETRE),
    ],
)
def test_a_unit_begins_where_its_numbers_do(lengths_m: list[float], unit: Unit) -> None:
    assert length_unit(lengths_m) is unit


def test_angles_and_times_have_their_units_too() -> None:
    assert angle(0.0104) == "0.010°" and angle(12.34) == "12.3°"
    assert computing_time(0.0353) == "35.3 ms" and computing_time(1.2351) == "1.24 s"


@pytest.mark.parametrize(("count", "text"), [(300, "300 bytes"), (1500, "1.5 kB"), (12_345_678, "12.3 MB")])
def test_a_size_is_in_thousands_of_bytes(count: int, text: str) -> None:
    assert size(count) == text
