"""What can be swept: settings, proposals, and what is wrong with a person's values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from ispom_app.engine.options import SourceOptions
from ispom_app.features.experiments.options import Experiment
from ispom_app.features.experiments.plan import config_of
from ispom_app.features.experiments.plan_file import read_plan
from ispom_app.features.sweep.values import FEWEST, MOST, Swept, offered, parsed, plan_text, proposed, shown

from ispom.errors import InputError
from ispom.methods import Config, method, names
from ispom.settings import check


def test_every_proposal_can_be_run() -> None:
    for name in names():
        for setting in offered(name):
            values = proposed(name, setting.name, Config())
            assert FEWEST <= len(values) <= MOST and len(set(values)) == len(values)
            assert parsed(name, setting.name, ", ".join(map(shown, values))).values == values
            for value in values:
                check(replace(method(name).config(), **{setting.name: value}), name)
            if setting.type in (int, float) and getattr(Config().of(name), setting.name) > 0:
                assert getattr(Config().of(name), setting.name) in values, "what it is now is among them"


def test_the_proposal_is_around_the_value_that_the_setting_has() -> None:
    config = Config().with_settings("stereo", replace(Config().of("stereo"), max_tracks=437))
    assert proposed("stereo", "max_tracks", config) == (110, 220, 437, 870)
    assert proposed("stereo", "max_tracks", Config()) == (100, 200, 400, 800)
    assert proposed("integrated", "knot_frames", Config()) == (0.0, 3.3, 6.7, 10.0), "0 has nothing around it"
    assert proposed("monocular.paper", "scale_transfer", Config()) == ("norm", "vector", "depth", "unit")
    assert proposed("stereo", "relocalise", Config()) == (False, True)


@pytest.mark.parametrize(
    ("setting", "text", "said"),
    [
        ("max_tracks", "100", "1 value: give 2 to 6"),
        ("max_tracks", "", "0 values"),
        ("max_tracks", "200, 200", "1 value:"),
        ("max_tracks", "100 110 120 130 140 150 160", "7 values"),
        ("max_tracks", "100, many", "stereo.max-tracks: 'many' is not an integer"),
        ("max_tracks", "100, 20", "--stereo.max-tracks is 20, give a value from 50 to 3000"),
        ("max_tracks", "100, " + "9" * 4000, "9' is not an integer"),
        ("loss_px", "0.1, nan", "give a value from 0.05 to 5"),
        ("relocalise", "on, perhaps", "is not on or off"),
        ("no_such", "1, 2", "'no_such' is no setting of stereo that can be swept"),
    ],
)
def test_what_is_wrong_is_reported_in_one_sentence(setting: str, text: str, said: str) -> None:
    with pytest.raises(InputError, match=r"^[^\n]*$") as refused:
        parsed("stereo", setting, text)
    assert said in str(refused.value)


def test_values_that_differ_are_shown_differently() -> None:
    assert [shown(v) for v in (1.0, 0.1, 1e-5, True, 200)] == ["1", "0.1", "1e-05", "on", "200"]
    assert shown(0.1234567) != shown(0.1234568)


def test_a_word_that_is_no_choice_names_those_that_are() -> None:
    with pytest.raises(InputError, match="norm, vector, depth, unit"):
        parsed("monocular.paper", "scale_transfer", "norm, metre")


def test_the_plan_is_one_that_experiment_reads_with_all_other_settings(tmp_path: Path) -> None:
    config = Config().with_settings("stereo", replace(Config().of("stereo"), window=5, max_tracks=300))
    options = SourceOptions(seed=3, stereo_every=2, video_scale=0.5, max_exposures=40)
    file = tmp_path / "sweep.yaml"
    file.write_text(plan_text(Swept("integrated", "loss", (0.5, 1e0)), "sim:tiny", options, config))
    plan = read_plan(Experiment(plan=str(file), out=tmp_path / "out"))
    assert (plan.sources, plan.seeds) == (("sim:tiny",), (3,))
    assert (plan.stereo_every, plan.video_scale, plan.max_exposures) == (2, 0.5, 40)
    assert [line.name for line in plan.lines] == ["loss 0.5", "loss 1"]
    for line, loss in zip(plan.lines, (0.5, 1.0), strict=True):
        found = config_of(line)
        assert found.of("stereo") == config.of("stereo"), "of the methods that are asked, too"
        assert found.of("integrated") == replace(config.of("integrated"), loss=loss)


def test_a_calibration_of_the_command_line_is_refused() -> None:
    with pytest.raises(InputError, match="--camera"):
        plan_text(Swept("monocular", "key_frames", (4, 8)), "film.mp4", SourceOptions(camera=Path("c.yaml")), Config())


def test_names_in_the_plan_are_plain_yaml() -> None:
    text = plan_text(Swept("stereo", "loss_px", (0.05, 1.0)), 'a: "folder"', SourceOptions(), Config())
    assert yaml.safe_load(text)["sources"] == ['a: "folder"']
