"""`ispom fork`: what it writes is as its parent, or as the mistake says."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.session.review.folder import read_stored

from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import ran
from tests.sequences.kitti_folder import make_drive

SAME = (*(f"{m}.tum" for m in METHODS), "steps.csv", "decisions.csv", "landmarks.npz", "rig.yaml", "truth.tum")


@pytest.fixture
def parent(tmp_path: Path) -> Path:
    drive = str(make_drive(tmp_path / "kitti"))
    options = ("--stereo-every", "2", "--monocular.max-tracks", "400", "--no-recording")
    return ran(drive, tmp_path / "parent", *options, builder=helpers.build)


def fork(run: Path, *options: str) -> int:
    return main(["fork", str(run), "--no-recording", *options], helpers.build)


def test_with_the_settings_of_the_run_all_files_are_the_same(parent: Path, tmp_path: Path) -> None:
    assert fork(parent, "--at", "4", "--out", str(tmp_path / "fork")) == 0
    for name in SAME:
        assert (tmp_path / "fork" / name).read_bytes() == (parent / name).read_bytes(), name


def test_run_yaml_names_the_parent_and_the_exposure(parent: Path, tmp_path: Path) -> None:
    out = tmp_path / "fork"
    assert fork(parent, "--at", "4", "--out", str(out), "--stereo.max-tracks", "300") == 0
    written = yaml.safe_load((out / "run.yaml").read_text())
    assert written["config"]["stereo"]["max_tracks"] == 300
    assert written["config"]["monocular"]["max_tracks"] == 400, "as in the run"
    assert written["options"]["stereo_every"] == 2
    (origin,) = written["forked"]
    assert origin["run"] == str(parent) and origin["at"] == 4 and origin["methods"] == list(METHODS)
    assert origin["config"] == yaml.safe_load((parent / "run.yaml").read_text())["config"]


def test_a_fork_of_a_fork_needs_no_grandparent(parent: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    assert fork(parent, "--at", "4", "--out", str(first), "--stereo.max-tracks", "300") == 0
    for path in parent.iterdir():
        path.unlink()
    assert fork(first, "--at", "6", "--out", str(second), "--stereo.max-tracks", "200") == 0
    written = yaml.safe_load((second / "run.yaml").read_text())
    assert [(o["run"], o["at"]) for o in written["forked"]] == [(str(parent), 4), (str(first), 6)]
    assert [o["config"]["stereo"]["max_tracks"] for o in written["forked"]][1] == 300
    assert written["config"]["stereo"]["max_tracks"] == 200


@pytest.mark.parametrize("at", [0, 1, 8], ids=["first", "second", "last"])
def test_the_first_and_the_last_exposure_can_be_forked(parent: Path, tmp_path: Path, at: int) -> None:
    out = tmp_path / "fork"
    assert fork(parent, "--at", str(at), "--out", str(out)) == 0
    for name in SAME:
        assert (out / name).read_bytes() == (parent / name).read_bytes(), name
    assert [entry["at"] for entry in yaml.safe_load((out / "run.yaml").read_text())["forked"]] == [at]
    read_stored(out, lambda source, options: options.open(source), helpers.build)
    assert fork(out, "--at", "4", "--out", str(tmp_path / "again")) == 0
    forked = yaml.safe_load((tmp_path / "again" / "run.yaml").read_text())["forked"]
    assert [entry["at"] for entry in forked] == sorted({at, 4} if at < 4 else {4})


def test_a_fork_at_the_first_exposure_has_the_settings_given_from_there_on(parent: Path, tmp_path: Path) -> None:
    out, alone = tmp_path / "fork", tmp_path / "alone"
    assert fork(parent, "--at", "0", "--out", str(out), "--stereo.max-tracks", "300") == 0
    source = yaml.safe_load((parent / "run.yaml").read_text())["source"]
    settings = ("--stereo-every", "2", "--monocular.max-tracks", "400", "--stereo.max-tracks", "300", "--no-recording")
    ran(source, alone, *settings, builder=helpers.build)
    for name in SAME:
        assert (out / name).read_bytes() == (alone / name).read_bytes(), name


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--at", "-1"), "--at is -1: give a frame of the run, counted from 0"),
        (("--at", "9"), "--at is 9, but the last frame of the source is 8: give a value from 0 to 8"),
        (("--at", "99"), "--at is 99, but the last frame of the source is 8: give a value from 0 to 8"),
        (("--at", "2", "--source", "nowhere"), "nowhere, the source of the run, is not there: give --source"),
    ],
)
def test_a_mistake_is_one_sentence_and_nothing_is_written(
    parent: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], sentence: str
) -> None:
    capsys.readouterr()
    assert fork(parent, "--out", str(tmp_path / "fork"), *options) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "fork").exists()


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        ({"config": {"stereo": {"max_tracks": "many"}}}, "config.stereo.max_tracks is 'many', not an integer"),
        ({"config": {"stereo": {"speed": 1}}}, "config.stereo has 'speed', which is no setting: choose from"),
        ({"config": {"magic": {}}}, "'magic' is no method"),
        ({"forked": [{"at": "x"}]}, "run.yaml says of a fork"),
        ({"forked": 3}, "does not say what it was forked from"),
        ({"source": "camera:0"}, "the run was live, on camera:0, and its images are gone"),
        ({"options": {"seed": "x", "methods": ["stereo"]}}, "run.yaml: seed is 'x'"),
    ],
)
def test_a_damaged_run_file_is_a_mistake(
    parent: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: dict, sentence: str
) -> None:
    whole = yaml.safe_load((parent / "run.yaml").read_text())
    (parent / "run.yaml").write_text(yaml.safe_dump(whole | damage))
    capsys.readouterr()
    assert fork(parent, "--at", "3", "--out", str(tmp_path / "fork")) == 2
    assert sentence in capsys.readouterr().err
