"""Scenarios in words and files: the same thing, checked value by value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.formats.simulated import open_scenario, open_simulated
from ispom.simulation.scenario.images import Darkness
from ispom.simulation.scenario.scenario import FAULTS, World, scenario_of_file, scenario_of_words


def test_words_and_a_file_mean_the_same(tmp_path: Path) -> None:
    (tmp_path / "dark.yaml").write_text(
        "scene: tiny\nmotion: rotation\nduration_s: 2\nfaults: [{darkness: {factor: 0.2, from_s: 1}}, rain]\n"
    )
    words = scenario_of_words("tiny?motion=rotation&duration_s=2&fault=darkness:factor=0.2,from_s=1&fault=rain")
    assert words == scenario_of_file(tmp_path / "dark.yaml")
    assert words.world == World(motion="rotation", duration_s=2.0)
    assert words.faults[0] == ("darkness", Darkness(factor=0.2, from_s=1.0))
    assert words.words == "motion rotation, duration_s 2.0, darkness from_s 1.0, factor 0.2, rain"


def test_a_file_is_opened_like_any_source(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text("scene: tiny\nseed: 3\nfaults: [{dropped: {share: 0.5}}]\n")
    found = open_sequence(str(tmp_path / "own.yaml"))
    assert found.name == "sim:tiny seed 3, dropped share 0.5" and found.kinds.count("video") == 46
    assert "scenario: dropped share 0.5" in found.notes


def test_without_a_fault_nothing_changes(tmp_path: Path) -> None:
    plain = open_simulated("tiny", 0, tmp_path, duration_s=0.1)
    same = open_scenario(scenario_of_words("tiny?duration_s=0.1"), 0, tmp_path)
    assert np.array_equal(same.times_ns, plain.times_ns) and same.rig.baseline_m == plain.rig.baseline_m
    assert np.array_equal(same[0].image, plain[0].image)  # type: ignore[union-attr]
    assert np.array_equal(same[1].right, plain[1].right)  # type: ignore[union-attr]
    assert len(list(tmp_path.iterdir())) == 1, "both are the same images on the disk"


@pytest.mark.parametrize("name", FAULTS)
def test_every_fault_is_a_value_with_defaults(name: str) -> None:
    ((given, fault),) = scenario_of_words(f"tiny?fault={name}").faults
    assert given == name and fault == FAULTS[name]()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("tiny?dark", "'dark'"),
        ("tiny?fault=darkne", "'darkne' is no fault: choose from darkness"),
        ("tiny?fault=darkness:factor=2", "darkness: factor is 2, give a value from 0.001 to 1"),
        ("tiny?fault=darkness:factor=low", "factor is 'low', not a number"),
        ("tiny?fault=darkness:colour=1", "'colour'"),
        ("tiny?motion=jump", "motion is 'jump', not one of own, flight"),
        ("tiny?duration_s=60", "sim:tiny cannot last 60 s, give a duration from 0.1 to 20 s"),
        ("?motion=still", "there is no simulated sequence sim:"),
        ("tiny?motion=still#x", "after # comes a seed"),
    ],
)
def test_what_is_wrong_is_one_sentence(words: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        open_sequence(f"sim:{words}")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("scene: 3", "scene is '3': give a name"),
        ("scene: tiny\nseed: -1", "seed is '-1'"),
        ("scene: tiny\nfaults: rain", "faults is no list"),
        ("scene: tiny\nfaults: [{rain: 4}]", "rain is '4', not settings by name"),
        ("scene: tiny\nspeed: 3", "'speed'"),
    ],
)
def test_what_is_wrong_in_a_file_names_the_file(text: str, sentence: str, tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(text)
    with pytest.raises(InputError, match=f"own.yaml.*{sentence}"):
        open_sequence(str(tmp_path / "own.yaml"))


@pytest.mark.parametrize("name", ["null", "0", "true", "2020-01-01"])
def test_a_setting_whose_name_is_no_word_is_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(f"scene: tiny\n{name}: 1\nother: 2\n")
    with pytest.raises(InputError, match="no setting"):
        scenario_of_file(tmp_path / "a.yaml")
