"""Words of sentences for users."""

from __future__ import annotations

import pytest

from ispom.errors import counted, required


def test_one_is_one_and_none_are_many() -> None:
    assert [counted(n, "frame") for n in (0, 1, 2)] == ["0 frames", "1 frame", "2 frames"]
    assert [counted(n, "number is", "numbers are") for n in (1, 3)] == ["1 number is", "3 numbers are"]


def test_a_required_value_is_returned_and_a_missing_one_raises_with_its_sentence() -> None:
    assert required(0, "no count") == 0
    with pytest.raises(ValueError, match="no count"):
        required(None, "no count")
