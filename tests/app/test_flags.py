"""A command line has flags for the settings of the methods that it names."""

from __future__ import annotations

import re
from dataclasses import fields

import pytest
from ispom_app.cli.commands import COMMANDS
from ispom_app.cli.main import main
from ispom_app.engine.options import SourceOptions, config_of, settings_of, with_flags
from ispom_app.features.headless.options import Run

from ispom.methods import GROUPS, Config, method, names


def methods_with_flags(*words: str) -> set[str]:
    default = next(f for f in fields(with_flags(Run, words)) if f.name == "settings").default_factory
    return set(config_of(default()).given)  # type: ignore[operator]


def test_the_methods_of_the_flags_have_them() -> None:
    assert methods_with_flags("a/folder", "--methods", "monocular", "--no-recording", "--max-exposures=3") == set()
    found = methods_with_flags("--stereo.paper.max-tracks=300", "--hybrid.monocular.no_loops", "--video-scale", "0.5")
    assert found == {"stereo.paper", "hybrid.monocular"}


@pytest.mark.parametrize("word", ["--max-track", "--stero.max-tracks"])
def test_all_have_them_after_a_mistake(word: str) -> None:
    assert methods_with_flags("a/folder", "--stereo.max-tracks", "300", word) == set(names())


@pytest.mark.parametrize("word", ["--help", "-h"])
def test_the_help_has_those_of_the_methods_that_are_named_or_of_the_default_ones(word: str) -> None:
    assert methods_with_flags(word) == {"monocular", "stereo", "integrated"}
    assert methods_with_flags("--methods", "flow", "paper", "--seed", "1", word) == {"flow", *GROUPS["paper"]}
    assert methods_with_flags("a/folder", "--tags.max-tracks", "3", "--methods=flow", word) == {"flow", "tags"}


@pytest.mark.parametrize("command", ["app", "run", "fork", "export", "triage", "experiment"])
def test_the_help_names_three_methods_and_the_groups(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        COMMANDS.get(command).read(["--help"])
    words = set(re.findall(r"[\w.]+", capsys.readouterr().out))
    assert {"monocular", "stereo", "integrated", "paper", "survey"} <= words
    assert not {"trifocal", "hybrid.monocular", "multicamera", "stereo.paper"} & words


def test_groups_are_taken_and_an_unknown_method_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    read = COMMANDS.get("run").read
    assert read(["a", "--methods", "survey", "stereo.paper"]).methods == ("survey", "stereo.paper")
    assert main(["run", "a", "--methods", "stero"]) == 2
    said = "".join(capsys.readouterr())
    assert "'stero'" in said and "stereo.paper" in said and "survey" in said and "trifocal" not in said


def test_options_without_settings_stay_as_they_are() -> None:
    assert with_flags(SourceOptions, ["--help"]) is SourceOptions


def test_the_settings_of_the_words_are_read_and_all_others_are_the_defaults() -> None:
    options = COMMANDS.get("run").read(["a/folder", "--stereo.max-tracks", "300", "--monocular.no-relocalise"])
    assert isinstance(options, Run) and set(options.config.given) == {"monocular", "stereo"}
    assert options.config.of("stereo").max_tracks == 300 and not options.config.of("monocular").relocalise
    assert options.config.of("stereo.paper") == method("stereo.paper").config()


def test_settings_and_flags_are_the_same_values() -> None:
    config = Config().with_settings("stereo", method("stereo").config(max_tracks=300))
    assert config_of(settings_of(config)) == config
