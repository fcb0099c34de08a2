"""Plans as files: what they mean, and what is wrong with one in a sentence."""

from __future__ import annotations

import math
import warnings
from pathlib import Path

import pytest
import yaml
from ispom_app.features.experiments.options import Experiment
from ispom_app.features.experiments.plan import config_of
from ispom_app.features.experiments.plan_file import built_in, read_plan

from ispom.errors import InputError

GOOD = {"title": "t", "sources": ["sim:tiny"], "methods": ["monocular.paper", "stereo"]}


def plan_of(tmp_path: Path, **changes):
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(GOOD | changes, sort_keys=False))
    return read_plan(Experiment(plan=str(tmp_path / "own.yaml"), out=tmp_path))


def test_methods_and_settings_are_combined(tmp_path: Path) -> None:
    settings = {
        "monocular.paper.scale_transfer": ["norm", "vector"],
        "monocular.paper.local-bundle": [False, True],
    }
    plan = plan_of(tmp_path, settings=settings, seeds="0-1")
    assert [line.name for line in plan.lines] == [
        "monocular.paper, scale_transfer norm, local-bundle off",
        "monocular.paper, scale_transfer norm, local-bundle on",
        "monocular.paper, scale_transfer vector, local-bundle off",
        "monocular.paper, scale_transfer vector, local-bundle on",
        "stereo",
    ]
    assert config_of(plan.lines[3]).of("monocular.paper").local_bundle is True
    assert config_of(plan.lines[3]).of("monocular.paper").scale_transfer == "vector"
    assert plan.seeds == (0, 1) and len(list(plan.runs())) == 10


def test_a_method_takes_the_settings_of_its_dependencies(tmp_path: Path) -> None:
    settings = {"stereo.paper.matching": ["sift", "klt"]}
    plan = plan_of(tmp_path, methods=["integrated.paper"], settings=settings)
    assert [config_of(line).of("stereo.paper").matching for line in plan.lines] == ["sift", "klt"]


def test_a_recording_is_run_once_whatever_the_seeds(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, sources=["sim:tiny", "kitti/06"], seeds=[3, 1], methods=["stereo"])
    runs = [(run.source, run.seed) for run in plan.runs()]
    assert runs == [("sim:tiny", 1), ("sim:tiny", 3), ("kitti/06", 1)]


def test_a_line_runs_on_its_own_sources_only_unless_others_are_asked_for(tmp_path: Path) -> None:
    lines = {"a": {"method": "stereo"}, "b": {"method": "stereo.paper", "sources": ["sim:city"]}}
    plan = plan_of(tmp_path, sources=["sim:tiny", "sim:city"], methods=[], lines=lines)
    runs = [(run.line.name, run.source) for run in plan.runs()]
    assert runs == [("a", "sim:tiny"), ("a", "sim:city"), ("b", "sim:city")]
    other = read_plan(Experiment(plan=str(tmp_path / "own.yaml"), out=tmp_path, sources=("sim:town",)))
    assert [(run.line.name, run.source) for run in other.runs()] == [("a", "sim:town"), ("b", "sim:town")]


@pytest.mark.parametrize("name", sorted(built_in()))
def test_the_plans_that_come_with_it_are_right(name: str, tmp_path: Path) -> None:
    plan = read_plan(Experiment(plan=name, out=tmp_path, seeds="3,5-6"))
    assert plan.seeds == (3, 5, 6) and plan.lines
    assert plan.statements or name == "speed", "the others are what the paper says"


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"sourcs": []}, "unknown field `sourcs`"),
        ({"sources": "sim:tiny"}, r"Expected `array`, got `str` - at `\$.sources`"),
        ({"sources": []}, "has no sources"),
        ({"methods": []}, "has no lines or methods"),
        ({"methods": ["orbslam"]}, "is no method"),
        ({"seeds": "2-x"}, "seeds: '2-x' is no seed"),
        ({"seeds": "5-2"}, "is no range of seeds"),
        ({"seeds": []}, "seeds is empty"),
        ({"settings": {"stereo.speed": [1]}}, "'speed', which is no setting"),
        ({"settings": {"integrated.knots": [1]}}, "is no setting of its methods"),
        ({"settings": {"monocular.paper.max_tracks": [7]}}, "max-tracks is 7, give a value from 50 to 2000"),
        ({"settings": {"monocular.paper.scale_transfer": ["norms"]}}, "not one of norm, vector"),
        ({"statements": [{"text": "t", "quantity": "ate_m", "line": "Z"}]}, "about line 'Z', which is none"),
        ({"lines": {"a": {"method": "stereo", "sources": ["sim:c"]}}}, "'sim:c', which is none of the plan's"),
        ({"fields": [{"name": "f", "line": "Z", "ellipse": [0] * 5, "label": [0, 0]}]}, "of line 'Z', which is none"),
        ({"sources": ["sim:a", "sim:a "]}, "almost the same name"),
        ({"seeds": "0-99999", "sources": ["sim:a", "sim:b"]}, "more than 100000"),
    ],
)
def test_what_is_wrong_is_one_sentence(changes: dict, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=sentence):
        plan_of(tmp_path, **changes)


IMPOSSIBLE = (math.nan, math.inf, -math.inf, 1e300, -1e308, 10**400, -(10**400))
CLAIM = {"text": "t", "quantity": "ate_m", "line": "stereo"}
FIELD = {"name": "f", "line": "stereo", "ellipse": [50, 30, 10, 5, 0], "label": [50, 30]}
NUMBERS = {
    "seeds": lambda value: {"seeds": value},
    "seeds[0]": lambda value: {"seeds": [value]},
    "stereo_every": lambda value: {"stereo_every": value},
    "video_scale": lambda value: {"video_scale": value},
    "max_exposures": lambda value: {"max_exposures": value},
    "settings": lambda value: {"settings": {"stereo.max_tracks": [value]}},
    "at_most": lambda value: {"statements": [CLAIM | {"at_most": value}]},
    "at_least": lambda value: {"statements": [CLAIM | {"at_least": value}]},
    "share": lambda value: {"statements": [CLAIM | {"share": value}]},
    "least_located_percent": lambda value: {"statements": [CLAIM | {"least_located_percent": value}]},
    "ellipse": lambda value: {"fields": [FIELD | {"ellipse": [50, 30, value, 5, 0]}]},
    "label": lambda value: {"fields": [FIELD | {"label": [value, 30]}]},
}
"""By its name, what a plan file has of each number."""


@pytest.mark.parametrize("value", IMPOSSIBLE, ids=lambda value: f"{str(value)[:9]}")
@pytest.mark.parametrize("name", NUMBERS)
def test_an_impossible_number_is_one_sentence(name: str, value: float, tmp_path: Path) -> None:
    with warnings.catch_warnings(), pytest.raises(InputError, match=r"own\.yaml|--stereo\.max-tracks") as caught:
        warnings.simplefilter("error")
        plan_of(tmp_path, **NUMBERS[name](value))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, -1) for name in NUMBERS if name not in ("at_most", "at_least", "ellipse", "label")]
    + [("video_scale", 1e-320), ("video_scale", 0), ("stereo_every", 0), ("max_exposures", 0), ("share", 1.1)],
)
def test_a_number_out_of_its_range_is_one_sentence(name: str, value: float, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        plan_of(tmp_path, **NUMBERS[name](value))


@pytest.mark.parametrize("count", [-1, 0, 10**400])
def test_an_impossible_number_of_exposures_is_refused_before_the_first_run(count: int, tmp_path: Path) -> None:
    plan_of(tmp_path)
    with pytest.raises(InputError, match="--max-exposures"):
        read_plan(Experiment(plan=str(tmp_path / "own.yaml"), out=tmp_path, max_exposures=count))


def test_a_plan_that_is_not_there_names_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fig8, fig9"):
        read_plan(Experiment(plan="fig7", out=tmp_path))
