"""A comparison in words: as many digits as it takes, and how far the poses are apart."""

from __future__ import annotations

import pytest
from ispom_app.engine.differences.compare import Difference, Divergence
from ispom_app.features.diff.text import MOST, lines


@pytest.mark.parametrize(
    ("a", "b", "said"),
    [
        (0.6185104512640244, 0.5195383930968476, "0.6185 | 0.5195"),
        (1.0, 1.0 + 1e-12, "1 | 1.000000000001"),
        (0.1, 0.1 + 2**-56, "0.1 | 0.10000000000000002"),
        ((1.0, 2.0, 3.0), (1.0, 2.0, 3.00004), "(1, 2, 3) | (1, 2, 3.00004)"),
        (3, 4, "3 | 4"),
        (None, 2.5, "missing | 2.5"),
        (True, False, "yes | no"),
    ],
)
def test_values_are_printed_with_the_digits_in_which_they_differ(a, b, said) -> None:
    (_, line) = lines(Divergence(4, 0, (Difference("stereo.x", a, b, None),)))
    assert line == f"  stereo.x: {said}"


def test_a_digest_only_differs() -> None:
    (_, line) = lines(Divergence(4, 0, (Difference("stereo.tracks_digest", "0f", "1e", None),)))
    assert line == "  stereo.tracks_digest: differs"


def test_positions_are_never_among_those_that_are_left_over() -> None:
    many = [Difference(f"stereo.{i}", 1, 2, 1.0) for i in range(MOST + 3)]
    position = Difference("stereo.position", (0.0, 0.0, 0.0), (0.0, 0.0, 2.0), 2.0)
    found = list(lines(Divergence(4, 0, (*many, position))))
    assert found[-2:] == ["  stereo.position: (0, 0, 0) | (0, 0, 2), apart by 2", "  and 3 more"]
