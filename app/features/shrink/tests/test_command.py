"""`ispom shrink` on stand-ins for methods, whose failure is known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import cv2
import msgspec
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_events.stretch import events_in
from ispom_app.features.headless.words import run_words
from ispom_app.features.shrink.command import COMMAND, NOT_AGAIN, README
from ispom_app.features.shrink.expected import EXPECTED, Expected

from ispom.ensemble import Ensemble
from ispom.methods import Config
from ispom.types import Check, Measurement, Rig, Status, Step, images_of
from tests import doubles
from tests.app.helpers import ran
from tests.app.written import breaks_schema
from tests.sequences.kitti_folder import HEIGHT, WIDTH, make_drive

ROOT = Path(__file__).parents[4]
FRAMES, DARK, NEEDED = 30, 19, 4
"""The drive; the frame from which on the stand-in is lost; the number of frames that it needs before."""


class Fragile(doubles.FakeEstimator):
    """Is lost where the grey level of the image says so, if it saw enough frames before."""

    def step(self, state: tuple, exposure: Measurement, asked: object = None) -> tuple[tuple, Step]:
        after, step = super().step(state, exposure, asked)
        level = float(np.median(next(iter(images_of(exposure).values()))))
        if level < 20 and len(state) >= NEEDED:
            lost = POINTS.of(3, 15)
            return after, replace(step, status=Status.LOST, world_from_frame=None, decisions=(lost,))
        return after, step


POINTS = Check("pose_points", "inliers", "requirement", "", fails="Lost: {value} of {threshold}.", topic="pose")


def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    return doubles.ensemble(methods, Fragile)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without compiled code: the methods are stand-ins."""
    monkeypatch.setattr("ispom_app.features.shrink.command.compile_first", lambda *_: None)
    monkeypatch.setattr("ispom_app.features.headless.command.warmup.start", lambda *_: None)


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A pair whose images are dark from a frame on."""
    drive = make_drive(tmp_path / "kitti", FRAMES)
    for path in drive.glob("image_?/*.png"):
        if int(path.stem) >= DARK:
            cv2.imwrite(str(path), np.full((HEIGHT, WIDTH), 5, np.uint8))
    return drive


def shrink(*words: object, builder=build) -> int:
    return main(["shrink", *map(str, words)], builder)


def expected(folder: Path) -> Expected:
    return msgspec.convert(json.loads((folder / EXPECTED).read_text()), Expected)


@pytest.fixture
def clip(drive: Path, tmp_path: Path) -> Path:
    assert shrink(drive, "--kind", "lost", "--methods", "monocular", "stereo", "--out", tmp_path / "out", "--zip") == 0
    return tmp_path / "out"


def test_the_clip_is_the_smallest_with_the_event(clip: Path) -> None:
    assert not breaks_schema("shrink", (clip / EXPECTED).read_text())
    found = expected(clip)
    assert (found.event.kind, found.event.cause) == ("lost", "pose_points")
    assert found.event.recorded_frame == found.event.whole_frame == DARK
    assert len(found.part.frames) == NEEDED + 1 and found.part.of_frames == FRAMES and found.part.frames[-1] == DARK
    assert len(found.methods) == len(found.part.cameras) == 1 and found.complete and found.part.halvings == 1
    assert len(list(clip.glob("*/*.png"))) == NEEDED + 1 if found.methods == ("monocular",) else 2 * (NEEDED + 1)
    words = (clip / COMMAND).read_text().split()
    assert words[:3] == ["ispom", "run", "."] and set(found.methods) <= set(words)
    assert "shrink --verify" in (clip / README).read_text()
    with ZipFile(clip.with_name("out.zip")) as archive:
        assert {f"out/{name}" for name in (EXPECTED, COMMAND, README, "rig.yaml")} <= set(archive.namelist())


def test_the_event_is_there_again_and_the_exit_code_says_so(clip: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert shrink("--verify", clip) == 0
    assert shrink("--verify", clip, builder=lambda c, m, r: doubles.ensemble(m, doubles.FakeEstimator)) == 1
    capsys.readouterr()
    first = min(clip.glob("*/*.png"))
    cv2.imwrite(str(first), 255 - cv2.imread(str(first), cv2.IMREAD_UNCHANGED))
    assert shrink("--verify", clip) == 0
    assert "images" in capsys.readouterr().out


def test_a_run_over_the_clip_has_the_event(clip: Path, tmp_path: Path) -> None:
    found = expected(clip)
    words = ["run", str(clip), "--methods", *found.methods, "--no-recording", "--out", str(tmp_path / "again")]
    assert main(words, build) == 0
    (row,) = [each for each in events_in(tmp_path / "again") if each.kind == "lost"]
    assert (row.frame, row.time_ns, row.method) == (found.event.frame, found.event.time_ns, found.event.method)


def test_a_run_is_shrunk_with_its_own_methods(drive: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    ran(drive, run, "--methods", "stereo", "--no-recording", builder=build)
    assert shrink(run, "--out", tmp_path / "out") == 0
    assert expected(tmp_path / "out").methods == ("stereo",)
    number = [each.kind for each in events_in(run)].index("lost")
    assert shrink(run, "--event", number, "--out", tmp_path / "two") == 0
    assert expected(tmp_path / "two").event == expected(tmp_path / "out").event
    assert shrink(run, "--event", 999, "--out", tmp_path / "three") == 2
    sound = lambda c, m, r: doubles.ensemble(m, doubles.FakeEstimator)  # noqa: E731
    assert shrink(run, "--out", tmp_path / "four", builder=sound) == 1
    assert not list((tmp_path / "four").iterdir())


def test_mistakes_are_refused_before_anything_is_computed(drive: Path, tmp_path: Path) -> None:
    def never(*_: object) -> Ensemble:
        raise AssertionError("computed")

    full = tmp_path / "full"
    full.mkdir()
    (full / "own.txt").write_text("mine")
    (tmp_path / "link").symlink_to(full)
    (tmp_path / "a.zip").write_text("mine")
    for words in (
        (drive, "--out", full),
        (drive, "--out", tmp_path / "link"),
        (drive, "--zip", "--out", tmp_path / "a"),
        (drive, "--kind", "nothing", "--out", tmp_path / "b"),
        (drive, "--kind", "lost", "--event", 0, "--out", tmp_path / "b"),
        (drive, "--trials", 0, "--out", tmp_path / "b"),
        ("--verify", full),
        ("--verify", tmp_path / "nowhere"),
    ):
        assert shrink(*words, builder=never) == 2, words
    assert [p.name for p in full.iterdir()] == ["own.txt"] and (tmp_path / "a.zip").read_text() == "mine"


@pytest.mark.parametrize("content", ["", "{}", "[" * 100_000, '{"event": 3}', "\x00"])
def test_a_damaged_file_is_refused(clip: Path, content: str) -> None:
    (clip / EXPECTED).write_text(content)
    assert shrink("--verify", clip) == 2


def test_nothing_outside_of_the_folder_is_read(clip: Path, tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_bytes((clip / "rig.yaml").read_bytes())
    (clip / "rig.yaml").unlink()
    (clip / "rig.yaml").symlink_to(tmp_path / "rig.yaml")
    assert shrink("--verify", clip) == 2


def test_few_trials_give_a_larger_clip(drive: Path, tmp_path: Path) -> None:
    words = ("--kind", "lost", "--methods", "monocular", "--out", tmp_path / "out")
    assert shrink(drive, *words, "--trials", 3) == 0
    found = expected(tmp_path / "out")
    assert not found.complete and found.trials == 3 and NEEDED + 1 < len(found.part.frames) <= DARK + 1


def test_private_images_are_drawn_and_nothing_else_is_left(drive: Path, tmp_path: Path) -> None:
    words = ("--kind", "lost", "--methods", "monocular", "--private")
    assert shrink(drive, *words, "--out", tmp_path / "out") == NOT_AGAIN  # grey is not dark
    assert not list((tmp_path / "out").iterdir())


def test_settings_and_programs_are_in_the_command(clip: Path) -> None:
    found = expected(clip)
    name = found.methods[0]
    values = dict(found.config[name])
    key, value = next((k, v) for k, v in values.items() if isinstance(v, bool))
    changed = msgspec.structs.replace(found, config={name: {**values, key: not value}}, external=("mine=run me",))
    words = run_words(".", changed.methods, changed.config, changed.external)
    flag = key.replace("_", "-")
    assert f"--{name}.{'no-' if value else ''}{flag}" in words and words[-3:-1] == ["--external", "mine=run me"]
    assert changed.configs().of(name) != Config().of(name)
