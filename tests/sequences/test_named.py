"""What names tell: the order, times, and what is missing."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences.named import named, ticks_of, ticks_of_pair


def numbered(*numbers: int) -> list[str]:
    return [f"IMG_{number}.jpg" for number in numbers]


def test_numbers_are_in_order_and_gaps_are_counted() -> None:
    found = named(numbered(12, 9, 10, 8, 13))
    assert found.names == tuple(numbered(8, 9, 10, 12, 13))
    assert ticks_of(found).tolist() == [0, 1, 2, 4, 5]
    assert ticks_of(named(numbered(0, 5, 10, 20))).tolist() == [0, 1, 2, 4]


@pytest.mark.parametrize("names", [numbered(1, 2, 40, 47, 90, 133), ["b1x.png", "a7.png"], ["b.png", "a.png", "c.png"]])
def test_names_without_numbering_give_the_order_alone(names: list[str]) -> None:
    assert ticks_of(named(names)).tolist() == list(range(len(names)))


@pytest.mark.parametrize(
    ("stem", "apart"), [("1700000000{:09d}", 1), ("1700000000{:06d}", 1000), ("cam0_1700000000{:03d}", 1_000_000)]
)
def test_whole_numbers_since_1970_are_times(stem: str, apart: int) -> None:
    found = named([f"{stem.format(i)}.png" for i in (110, 99, 500)])
    assert found.stamps_ns is not None
    assert found.stamps_ns.tolist() == [1_700_000_000 * 10**9 + i * apart for i in (99, 110, 500)]


def test_fractions_of_seconds_are_not_counted_as_numbers() -> None:
    found = named(["1305031102.5.png", "1305031102.25.png", "1305031102.175304.png"])
    assert found.stamps_ns is not None
    assert (found.stamps_ns - 1305031102 * 10**9).tolist() == [175_304_000, 250_000_000, 500_000_000]


@pytest.mark.parametrize(
    ("name", "digits"),
    [("{:.1f}.jpg", 1), ("{:.3f}.png", 3), ("t{:.2f}s.png", 2), ("frame_{:.6f}.jpg", 6), ("{:g}.jpg", 4),
     ("cam_{}.jpg", 8), ("{:.15f}.png", 8)],
)  # fmt: skip
def test_decimal_seconds_are_times_in_their_order(name: str, digits: int) -> None:
    """As text, and as numbers before and after a point, they are in another order."""
    found = named([name.format(i / 7) for i in (13, 2, 11, 0, 1, 7, 30, 5)])
    assert found.stamps_ns is not None
    expected = [i / 7 * 1e9 for i in (0, 1, 2, 5, 7, 11, 13, 30)]
    np.testing.assert_allclose(found.stamps_ns, expected, atol=10 ** (9 - digits))


@pytest.mark.parametrize("name", ["{:.3e}.png", "{:.2f}sec.png", "{:.0f}ms.png", "f_{:.0f}_us.png", "{:.0f}ns.png"])
def test_times_may_have_an_exponent_or_a_unit(name: str) -> None:
    unit = 1e3 if "ms" in name else 1e6 if "us" in name else 1e9 if "ns" in name else 1
    found = named([name.format(i * 0.04 * unit) for i in (10, 2, 0, 1, 4, 3)])
    assert found.stamps_ns is not None
    assert found.stamps_ns.tolist() == [i * 40_000_000 for i in (0, 1, 2, 3, 4, 10)]


def test_seconds_may_begin_before_zero() -> None:
    found = named([f"{i / 20:.2f}.png" for i in range(-4, 5)])
    assert found.stamps_ns is not None and (np.diff(found.stamps_ns) == 50_000_000).all()


def test_steps_that_are_too_large_for_a_counter_are_times() -> None:
    for name, unit_ns in (("{:019d}.png", 1), ("{}.png", 1_000)):
        found = named([name.format(i * 50_000_000 // unit_ns) for i in (0, 1, 2, 4, 5)])
        assert found.stamps_ns is not None
        assert found.stamps_ns.tolist() == [i * 50_000_000 for i in (0, 1, 2, 4, 5)]


def test_images_in_two_formats_are_counted_together() -> None:
    found = named(["IMG_0001.JPG", "IMG_0002.PNG", "IMG_0004.jpeg", "IMG_0005.JPG"])
    assert ticks_of(found).tolist() == [0, 1, 3, 4]


def test_seconds_may_have_no_fraction_or_a_decimal_comma() -> None:
    for names in (["0.jpg", "0.5.jpg", "1.jpg", "10.25.jpg"], ["0,0.jpg", "0,5.jpg", "1,0.jpg", "10,25.jpg"]):
        found = named(names[::-1])
        assert found.names == tuple(names) and found.stamps_ns is not None
        assert found.stamps_ns.tolist() == [0, 500_000_000, 1_000_000_000, 10_250_000_000]


@pytest.mark.parametrize(
    "names",
    [
        [f"1.{i}.png" for i in range(1, 14)],
        [f"cam1.{i:02d}.png" for i in range(9)],
        [f"{i:03d}.{k}.png" for i in range(4) for k in range(3)],
        [f"{i // 5}.{i % 5:03d}.png" for i in range(14)],
    ],
)
def test_counters_with_points_are_no_times(names: list[str]) -> None:
    found = named(names[::-1])
    assert found.stamps_ns is None and found.names == tuple(names)


@pytest.mark.parametrize("unit_ns", [1_000_000, 1_000, 1])
@pytest.mark.parametrize("name", ["{}.png", "frame_{:012d}.png"])
def test_whole_numbers_that_advance_by_no_whole_step_are_times(unit_ns: int, name: str) -> None:
    """Such as 0, 33, 67, 133 of a camera with 30 Hz, one image of which is missing."""
    ticks = [0, 1, 2, 4, 5, 6, 7]
    found = named([name.format(round(i * 1e9 / 30 / unit_ns)) for i in ticks])
    assert found.stamps_ns is not None and "times in" in found.notes[0]
    np.testing.assert_allclose(found.stamps_ns, [i * 1e9 / 30 for i in ticks], atol=unit_ns)
    assert named([name.format(i * 40) for i in ticks]).stamps_ns is None


@pytest.mark.parametrize(
    ("name", "fraction"),
    [
        ("IMG_20231105_1432{:02d}.jpg", False),
        ("2023-11-05 14.32.{:02d}.jpg", False),
        ("2023-11-05T14:32:{:02d}.250.jpg", False),
        ("PXL_20231105_1432{:02d}{:03d}.jpg", True),
        ("cam_2023-11-05-14-32-{:02d}_{:03d}.png", True),
    ],
)
def test_dates_and_times_of_day_are_times(name: str, fraction: bool) -> None:
    moments = [(1, 0), (1, 333), (3, 667), (59, 0)] if fraction else [(1, 0), (2, 0), (3, 0), (59, 0)]
    found = named([name.format(*moment) for moment in moments[::-1]])
    assert found.stamps_ns is not None
    expected = [second * 10**9 + milliseconds * 10**6 for second, milliseconds in moments]
    assert (found.stamps_ns - found.stamps_ns[0]).tolist() == [ns - expected[0] for ns in expected]


def test_a_minute_that_begins_is_no_gap() -> None:
    found = named([f"IMG_20231105_{moment}.jpg" for moment in (143258, 143259, 143300, 143301)])
    assert found.stamps_ns is not None and (np.diff(found.stamps_ns) == 10**9).all()


def test_images_of_one_second_are_counted() -> None:
    found = named([f"20231105_143200_{i:03d}.jpg" for i in range(9)])
    assert found.stamps_ns is None and found.step == 1


@pytest.mark.parametrize(
    ("most", "first", "name"),
    [
        (9999, 1, "DSC_{:04d}.JPG"),
        (9999, 0, "frame{:04d}.png"),
        (999, 0, "{}.png"),
        (99, 0, "img{:02d}.png"),
        (99, 1, "img{:02d}.png"),
        (65535, 0, "{}.png"),
        (255, 0, "f{:03d}.png"),
    ],
)
def test_a_counter_that_starts_again_goes_on(most: int, first: int, name: str) -> None:
    numbers = [*range(most - 6, most + 1), *range(first, first + 12)]
    found = named([name.format(i) for i in sorted(numbers)])
    assert found.names == tuple(name.format(i) for i in numbers) and len(found.notes) == 1
    assert ticks_of(found).tolist() == list(range(len(numbers)))
    missing = [i for i in numbers if i not in (most, first + 3)]
    assert ticks_of(named([name.format(i) for i in missing])).tolist() == [
        *range(6), *range(7, 10), *range(11, len(numbers))
    ]  # fmt: skip


@pytest.mark.parametrize(
    "numbers", [[*range(30), *range(9000, 9010)], [*range(50), 99], [*range(100, 130), *range(9990, 10000)]]
)
def test_a_gap_in_the_numbers_is_no_counter_that_starts_again(numbers: list[int]) -> None:
    found = named([f"{i:04d}.png" for i in numbers])
    assert found.notes == () and ticks_of(found).tolist() == numbers if numbers[0] == 0 else found.notes == ()


def test_images_that_cannot_be_read_keep_their_numbers() -> None:
    found = named([f"IMG_{i:04d}.JPG" for i in (1, 3, 5, 9)], [f"IMG_{i:04d}.HEIC" for i in (0, 2, 4, 6, 7, 8)])
    assert ticks_of(found).tolist() == [0, 2, 4, 8]
    other = named([f"IMG_{i:04d}.JPG" for i in (1, 3, 5, 9)], [f"DSC_{i:04d}.NEF" for i in (2, 4)])
    assert ticks_of(other).tolist() == [0, 1, 2, 4]


@pytest.mark.parametrize("name", ["20231105143210{:02d}.png", "{:013d}.png", "9700000000{:03d}.png"])
def test_dates_and_long_numbers_are_no_times(name: str) -> None:
    assert named([name.format(i) for i in range(3)]).stamps_ns is None


def test_of_two_cameras_images_of_one_number_belong_together() -> None:
    left, right = named(numbered(3, 4, 5, 7, 8)), named([f"r{i:03d}.png" for i in (4, 5, 6, 7, 8)])
    ticks = ticks_of_pair(left, right)
    assert ticks is not None and [t.tolist() for t in ticks] == [[0, 1, 2, 4, 5], [1, 2, 3, 4, 5]]
    assert ticks_of_pair(left, named(numbered(103, 104, 105))) is None
    assert ticks_of_pair(left, named(["a.png", "b.png"])) is None


@pytest.mark.parametrize(
    "pair",
    [("left_{:03d}.png", "right_{:03d}.png"), ("cam0_{}.png", "cam1_{}.png"), ("{:04d}_rgb.jpg", "{:04d}_depth.png"),
     ("{:06d}.jpg", "{:06d}.png")],
)  # fmt: skip
def test_images_of_two_kinds_are_not_taken_for_those_of_one_camera(pair: tuple[str, str]) -> None:
    names = [each.format(i) for each in pair for i in range(6)]
    with pytest.raises(InputError, match="same numbers"):
        named(names)


def test_parts_of_a_recording_and_single_copies_are_one_camera() -> None:
    assert len(named([f"part{p}_{i}.png" for p in (1, 2) for i in range(6)]).names) == 12
    assert len(named([*numbered(*range(20)), "IMG_E0003.jpg", "IMG_E0007.jpg"]).names) == 22
