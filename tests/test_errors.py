"""Words of sentences for users."""

from __future__ import annotations

from ispom.errors import counted


def test_one_is_one_and_none_are_many() -> None:
    assert [counted(n, "frame") for n in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]
    assert [counted(n, "number is", "numbers are") for n in (1, 3)] == ["1 number is", "3 numbers are"]
