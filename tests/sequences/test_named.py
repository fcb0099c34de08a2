"""What names tell: the order, times, and what is missing."""

from __future__ import annotations

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
def test_what_is_no_numbering_tells_the_order_alone(names: list[str]) -> None:
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
    with pytest.raises(InputError, match="several kinds have the same numbers"):
        named(names)


def test_parts_of_a_recording_and_single_copies_are_one_camera() -> None:
    assert len(named([f"part{p}_{i}.png" for p in (1, 2) for i in range(6)]).names) == 12
    assert len(named([*numbered(*range(20)), "IMG_E0003.jpg", "IMG_E0007.jpg"]).names) == 22
