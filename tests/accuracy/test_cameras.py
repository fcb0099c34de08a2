"""The bench of cameras: what it films, and what it says of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from ispom.sequences import open_sequence
from ispom.sequences.formats.simulated import open_scenario
from ispom.simulation.scenario.scenario import scenario_of_words
from tests.accuracy.cameras import BLIND, CAMERAS, FLIGHT, Filmed, print_cameras, write_12_bits


def test_twelve_bits_are_the_same_images(tmp_path: Path) -> None:
    sequence = open_scenario(scenario_of_words("tiny?duration_s=0.1&width_px=80"), 0, tmp_path / "cache")
    folder = tmp_path / "deep"
    folder.mkdir()
    write_12_bits(sequence, folder)
    again = open_sequence(str(folder))
    assert again.kinds == sequence.kinds and np.array_equal(again.times_ns, sequence.times_ns)
    assert np.array_equal(again[0].image, sequence[0].image)  # type: ignore[union-attr]
    assert np.array_equal(again[1].right, sequence[1].right)  # type: ignore[union-attr]
    assert again.rig.camera("video") == sequence.rig.camera("video")


def test_every_kind_of_cameras_is_a_scenario() -> None:
    assert all(scenario_of_words(f"{FLIGHT}&{words}").scene == "city" for words in CAMERAS.values())


def test_what_is_worse_over_all_seeds_is_named() -> None:
    """Than with plain cameras in the same flights: 4K has the first alone."""
    console = Console(record=True, width=200)
    errors = {"plain": (0.006, 0.008), "4K": (0.0085,), "fisheye": (0.002, 0.016), BLIND: (0.03, 0.03)}
    print_cameras(
        console, [Filmed(s, c, "stereo", error, 1) for c, seeds in errors.items() for s, error in enumerate(seeds)]
    )
    text = console.export_text()
    assert "7.1 mm (1.00)" in text and "8.5 mm (1.42)" in text and "11.4 mm (1.61)" in text
    assert text.rstrip().endswith(f"where a shutter is not told: stereo with fisheye, stereo with {BLIND}")
