"""What of the disk is read for a run's folder: what was recorded here, the folder itself, and what a person named."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_file import read_run_file
from ispom_app.session.review.folder import read_stored
from ispom_app.session.review.stored import compared, stored_source

from ispom.errors import InputError, UnreadableImage
from ispom.sequences import open_sequence
from ispom.sequences.recorded_sensors import AUTO, NONE
from tests.app.helpers import build_full, open_source, ran
from tests.sequences.bag_folders import make_bag
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_drive(tmp_path / "kitti", 6)


@pytest.fixture
def run(drive: Path, tmp_path: Path) -> Path:
    return ran(drive, tmp_path / "run", "--no-recording", builder=build_full)


def foreign(run: Path, **changed: str) -> Path:
    """The run as somebody else would have written it, its source perhaps another one."""
    text = (run / "run.yaml").read_text()
    for name, value in changed.items():
        line = next(line for line in text.splitlines() if line.strip().startswith(f"{name}:"))
        text = text.replace(line, f"{line.split(name)[0]}{name}: {value}")
    (run / "run.yaml").write_text("\n".join(text.splitlines()[:-1]) + "\n")
    assert not read_run_file(run).own
    return run


def test_ones_own_run_finds_its_source_wherever_both_are(run: Path, drive: Path, tmp_path: Path) -> None:
    moved = Path(shutil.move(run, tmp_path / "elsewhere"))
    found = stored_source(moved, read_run_file(moved))
    assert (found.source, found.places) == (str(drive), None)
    assert read_stored(moved, open_source, build_full).unavailable == ""


def test_the_topics_of_a_bag_are_those_of_the_run(tmp_path: Path) -> None:
    path, folder = make_bag(tmp_path, "ros1", ("a", "b", "c")), tmp_path / "run"
    words = ["--topics", "left=/a/image_raw", "right=/c/image_raw", "--methods", "stereo", "--no-recording"]
    ran(path, folder, *words, builder=build_full)
    assert stored_source(folder, read_run_file(folder)).opened().rig.baseline_m == pytest.approx(1.0)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("sequence: ", "sequence: a", 1),
        lambda text: "\n".join(text.splitlines()[:-1]) + "\n",
        lambda text: text + "\n",
        lambda text: text[:-3] + "00\n",
        lambda text: text + text.splitlines()[-1] + "\n",
    ],
)
def test_a_file_that_was_changed_is_nobodys_own(run: Path, change) -> None:
    assert read_run_file(run).own
    text = (run / "run.yaml").read_text()
    (run / "run.yaml").write_text(change(text))
    assert not read_run_file(run).own


def test_another_users_key_signs_nothing_here(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ispom_app.engine.run_folder.own.cache_folder", lambda name: tmp_path)
    assert not read_run_file(run).own
    assert (tmp_path / "run_key").stat().st_mode & 0o077 == 0


def test_what_a_foreign_run_names_is_not_opened(run: Path, drive: Path) -> None:
    folder = foreign(run)
    with pytest.raises(InputError, match="--source"):
        stored_source(folder, read_run_file(folder))
    stored = read_stored(folder, open_source, build_full)
    assert "source" in stored.unavailable
    with pytest.raises(InputError):
        stored.playback.sequence[0]


def test_a_person_may_name_it(run: Path, drive: Path) -> None:
    folder = foreign(run)
    assert stored_source(folder, read_run_file(folder), str(drive)).source == str(drive)
    assert read_stored(folder, open_source, build_full, named={str(drive)}).unavailable == ""


def test_a_source_in_the_runs_own_folder_is_read_and_no_link_out_of_it(run: Path, drive: Path) -> None:
    inner = run / "images"
    shutil.copytree(drive.parents[1], inner)
    source = inner / drive.relative_to(drive.parents[1])
    folder = foreign(run, source=str(source))
    assert read_stored(folder, open_source, build_full).unavailable == ""
    image = next(iter(sorted((source / "image_0").iterdir())))
    image.unlink()
    image.symlink_to(drive / "image_0" / image.name)
    with pytest.raises(InputError):
        stored_source(folder, read_run_file(folder)).opened()[0]


@pytest.mark.parametrize("name", ["camera", "sensors"])
def test_other_files_that_a_foreign_run_names_are_not_opened_either(run: Path, drive: Path, name: str) -> None:
    folder = foreign(run, **{name: "/etc/hostname"})
    with pytest.raises(InputError, match=name):
        stored_source(folder, read_run_file(folder), str(drive))


@pytest.mark.parametrize(("written", "sensors"), [("null", NONE), ("auto", AUTO), ("none", NONE)])
def test_a_run_opens_the_sensors_that_it_saw(run: Path, drive: Path, written: str, sensors: Path) -> None:
    """Runs of before sources had sensors by themselves say null."""
    assert "sensors: auto" in (run / "run.yaml").read_text()
    folder = foreign(run, sensors=written)
    assert stored_source(folder, read_run_file(folder), str(drive)).options.sensors == sensors


def test_a_simulation_of_a_foreign_run_reads_no_file_outside(run: Path) -> None:
    folder = foreign(run, source="sim:tiny?route=/etc/hostname")
    with pytest.raises(InputError):
        stored_source(folder, read_run_file(folder)).open()


def test_images_are_compared_with_those_of_the_run_before_one_is_given(run: Path, drive: Path) -> None:
    expected = read_run_file(run).images_sha256
    assert expected is not None
    sequence = open_sequence(str(drive))
    assert compared(sequence, expected, "").load(0).time_ns == sequence[0].time_ns
    first, second = sorted((drive / "image_0").iterdir())[:2]
    shutil.copy(first, second)
    with pytest.raises(UnreadableImage):
        compared(open_sequence(str(drive)), expected, "").load(0)
    stored = read_stored(run, open_source, build_full, compare=True)
    with pytest.raises(InputError):
        stored.playback.sequence[0]
    assert read_stored(run, open_source, build_full).playback.sequence[0]


@pytest.mark.parametrize(
    "command",
    [
        lambda run: ["doctor", run],
        lambda run: ["fork", run, "--at", "2", "--out", f"{run}-fork", "--no-recording"],
        lambda run: ["blame", run, "--at", "2"],
        lambda run: ["export", run, "--format", "panorama"],
    ],
)
def test_commands_refuse_a_foreign_source_in_one_sentence(run: Path, command, capsys) -> None:
    folder = foreign(run)
    assert main(command(str(folder)), build_full) == 2
    printed = capsys.readouterr().err
    assert "Traceback" not in printed and "run.yaml was not" in printed


@pytest.mark.parametrize("forked_from", [False, True])
def test_a_folder_that_a_setting_of_a_foreign_run_names_is_not_read(run: Path, drive: Path, forked_from: bool) -> None:
    found = replace(read_run_file(foreign(run)), own=False)
    config = {"panorama": {"reference": "/etc"}, "no such method": {"reference": "/etc"}}
    forked = [{"run": "other", "at": 2, "methods": ["panorama"], "config": config}]
    changed = replace(found, forked=forked) if forked_from else replace(found, config={**found.config, **config})
    with pytest.raises(InputError, match=r"panorama\.reference"):
        stored_source(run, changed, str(drive))
    own = {"panorama": {"reference": str(run / "reference")}}
    assert stored_source(run, replace(found, config={**found.config, **own}), str(drive)).source == str(drive)
