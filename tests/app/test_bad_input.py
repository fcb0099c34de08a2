"""Every mistake ends in one sentence that names the place and the cure, with exit code 2, and loses nothing written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from errno import ENOSPC
from io import FileIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.playback import Builder
from ispom_app.engine.run_folder.run_folder import MARKER, RunFolder
from ispom_app.views.rerun import file_recording

from ispom.ensemble import Ensemble, build
from ispom.features.pair_look import EXCHANGED
from ispom.io import whole
from ispom.io.trajectories import read_tum
from ispom.methods import Config
from ispom.types import Decision, Rig, Status, Step, Trajectory
from tests import doubles
from tests.alone import METHODS
from tests.sequences.kitti_folder import make_drive
from tests.sequences.own_folders import make_video


def fakes(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    """Ranges are checked, no estimator is built."""
    build(config, (), rig)
    return doubles.ensemble(methods, doubles.FakeEstimator)


def sentence(capsys: pytest.CaptureFixture[str], *arguments: str, builder: Builder = fakes) -> str:
    """What the command says on its way out with code 2."""
    assert main(["run", *arguments, "--no-recording"], builder) == 2
    message = capsys.readouterr().err
    assert message.startswith("ispom: ") and message.count("\n") == 1
    return message


def test_path_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert f"{tmp_path}/nowhere" in sentence(capsys, f"{tmp_path}/nowhere")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("~no-such-user/drive", "~no-such-user/drive"),
        ("x" * 5000, "(File name too long)"),
        ("a\0b", "a\\x00b"),
        ("sim:city#" + "9" * 5000, "4294967295"),
        ("sim:city#-1", "4294967295"),
        ("sim:nowhere", "sim:nowhere"),
        ("/dev/null", "/dev/null is a file"),
        ("", "has no known layout"),
    ],
)
def test_sources_that_cannot_be(source: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    printed = sentence(capsys, source)
    assert message in printed and len(printed) < 1100


def test_a_pipe_in_place_of_any_file_of_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = make_drive(tmp_path / "kitti")
    for name in ("calib.txt", "times.txt", "image_0/000000.png", "image_1/000003.png", "../../poses/07.txt"):
        path = drive / name
        content = path.read_bytes()
        path.unlink()
        os.mkfifo(path)
        assert f"{path.name} is a named pipe" in sentence(capsys, str(drive), "--out", str(tmp_path / name[:5]))
        path.unlink()
        path.write_bytes(content)


def test_a_pipe_in_place_of_the_first_image_where_nothing_describes_the_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its EXIF was waited for, for ever."""
    os.mkfifo(tmp_path / "0.png")
    assert "0.png is a named pipe" in sentence(capsys, str(tmp_path))


@pytest.mark.parametrize("name", ["times.txt", "../../poses/07.txt", "calib.txt"])
def test_a_link_to_nothing_is_no_file_that_is_not_there(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_drive(tmp_path / "kitti")
    (drive / name).unlink()
    (drive / name).symlink_to("gone")
    assert f"{Path(name).name} is a link to gone" in sentence(capsys, str(drive))


def test_a_file_of_no_known_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").touch()
    said = sentence(capsys, f"{tmp_path}/notes.txt")
    assert "notes.txt" in said and all(f".{kind}, " in said for kind in ("avi", "mkv", "mp4"))


@pytest.mark.parametrize("name", ["drive.zip", "drive.TAR.GZ", "drive.7z"])
def test_an_archive(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / name).write_bytes(b"PK")
    assert f"{name} is an archive" in sentence(capsys, f"{tmp_path}/{name}")


def test_a_video_whose_images_nothing_here_decodes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    film = make_video(tmp_path)
    film.write_bytes(film.read_bytes().replace(b"MJPG", b"VP90"))
    assert "(VP90)" in sentence(capsys, str(film))


def test_a_video_that_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "film.mp4").touch()
    assert "film.mp4 is not" in sentence(capsys, f"{tmp_path}/film.mp4")
    (tmp_path / "film.yaml").write_text("{width: 96, height: 64, fx: 80, fy: 80, cx: 47.5, cy: 31.5}")
    assert "film.mp4 is not" in sentence(capsys, f"{tmp_path}/film.mp4")


def test_unknown_layout(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").touch()
    message = sentence(capsys, str(tmp_path))
    assert str(tmp_path) in message and "image_0 and calib.txt" in message
    for name in ("b.mp4", "a.mp4", "camera.yaml"):
        (tmp_path / name).touch()
    message = sentence(capsys, str(tmp_path))
    assert message.rstrip().endswith(f"{tmp_path}/a.mp4")


def test_unknown_layout_next_to_a_link_to_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It was the link that was complained about, whatever it had to do with what was asked for."""
    (tmp_path / "drive").mkdir()
    (tmp_path / "drive" / "sequence.yaml").symlink_to("/nowhere")
    (tmp_path / "gone").symlink_to("/nowhere")
    assert "/nowhere" not in sentence(capsys, str(tmp_path))
    assert "sequence.yaml is a link to /nowhere" in sentence(capsys, f"{tmp_path}/drive")


def test_empty_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert f"{tmp_path} is an empty folder" in sentence(capsys, str(tmp_path))


def edit(name: str, change: Callable[[str], str]) -> Callable[[Path], None]:
    return lambda drive: (drive / name).write_text(change((drive / name).read_text())) and None


def remove(name: str) -> Callable[[Path], None]:
    return lambda drive: (drive / name).unlink()


def empty(name: str) -> Callable[[Path], None]:
    return lambda drive: [path.unlink() for path in (drive / name).iterdir()] and None


BROKEN = {
    "calibration missing": (remove("calib.txt"), "calib.txt is missing"),
    "calibration malformed": (edit("calib.txt", lambda t: t[:30]), "calib.txt line 1: P0"),
    "calibration no text": (lambda d: (d / "calib.txt").write_bytes(b"\xff\xfe\x00"), "calib.txt line 1"),
    "calibration without right": (
        edit("calib.txt", lambda t: t.splitlines()[0]),
        "'P1: ...' for image_1",
    ),
    "right camera on the left": (
        edit("calib.txt", lambda t: t.replace("-40", "40")),
        "P1 is not P0",
    ),
    "focal length zero": (edit("calib.txt", lambda t: t.replace("80 ", "0 ", 1)), "focal length"),
    "focal length negative": (edit("calib.txt", lambda t: t.replace("80 ", "-80 ", 1)), "focal length"),
    "fewer poses than images": (
        edit("../../poses/07.txt", lambda t: t.split("\n", 1)[1]),
        "07.txt has 5 poses for 6 images",
    ),
    "a pose is no number": (edit("../../poses/07.txt", lambda t: t.replace("0.4", "x")), "07.txt line 3: 'x'"),
    "times not increasing": (edit("times.txt", lambda t: t.replace("3.0", "1.0")), "times.txt line 4: time 1.0"),
    "times missing": (remove("times.txt"), "times.txt is missing"),
    "fewer times than images": (edit("times.txt", lambda t: t.split("\n", 1)[1]), "5 times for 6 images"),
    "no images": (empty("image_0"), "image_0 holds no image"),
    "an image missing": (remove("image_0/000002.png"), "000002.png is missing"),
    "a right image missing": (remove("image_1/000005.png"), "image_1 holds 5 images, image_0 6"),
    "first image empty": (lambda d: (d / "image_0/000000.png").write_bytes(b""), "000000.png is not a whole image"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_drive(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil, message = BROKEN[name]
    drive = make_drive(tmp_path / "kitti")
    spoil(drive)
    printed = sentence(capsys, str(drive), "--out", str(tmp_path / "out"))
    assert message in printed and str(tmp_path) in printed
    assert not (tmp_path / "out").exists()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-200])


def shrink(path: Path) -> None:
    cv2.imwrite(str(path), np.zeros((10, 20), np.uint8))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [(cut, "is not a whole image"), (shrink, "is 20 x 10, not 96 x 64"), (Path.unlink, "is missing:")],
)
@pytest.mark.parametrize("image", ["image_0/000003.png", "image_1/000003.png"])
def test_a_bad_image_in_the_middle_loses_nothing(
    spoil: Callable[[Path], None],
    message: str,
    image: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drive, out = make_drive(tmp_path / "kitti"), tmp_path / "out"
    listed = [f"{i:06d}.png" for i in range(6)]
    monkeypatch.setattr(
        "ispom.sequences.formats.kitti._images", lambda images: [images / name for name in listed]
    )  # it may vanish while the run goes on, too
    spoil(drive / image)
    printed = sentence(capsys, str(drive), "--out", str(out))
    assert f"{drive / image} {message}" in printed
    assert message in (out / MARKER).read_text()
    assert len(read_tum(out / "monocular.tum")) == len(read_tum(out / "stereo.tum")) == 3


def test_fewer_than_three_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    message = sentence(capsys, str(make_drive(tmp_path, frames=2)))
    assert "2 frames, a run needs 3" in message


@pytest.mark.parametrize("method", ["stereo", "integrated"])
def test_right_camera_missing_where_stereo_is_required(
    method: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_drive(tmp_path / "kitti", right=False)
    message = sentence(capsys, str(drive), "--methods", method, "--out", str(tmp_path / "out"), builder=build)
    assert f"{method} needs" in message and "--methods" in message


def test_frame_of_a_camera_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = make_drive(tmp_path / "kitti", right=False)
    assert "--frame is left" in sentence(capsys, str(drive), "--frame", "left")


def test_no_texture_at_all(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Real estimators: they find nothing, and the folder says so."""
    drive, out = make_drive(tmp_path / "kitti", flat=True), tmp_path / "out"
    message = sentence(capsys, str(drive), "--out", str(out), builder=build)
    assert "texture" in message
    assert "no method" in (out / MARKER).read_text() and (out / "metrics.json").exists()


class Waiting(doubles.FakeEstimator):
    """Never starts, and says by which check."""

    def step(self, state, exposure, asked=None):
        check = Decision("nodes", 8.0, 80.0, False, key="nodes", kind="finding")
        return state, Step(exposure.time_ns, Status.INITIALISING, decisions=(check,))

    def finish(self, state, asked=None):
        return Trajectory.empty()


def test_a_method_that_never_starts_says_its_own_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, out = make_drive(tmp_path / "kitti"), tmp_path / "out"
    words = [str(drive), "--methods", "monocular", "stereo", "--out", str(out)]
    message = sentence(capsys, *words, builder=lambda config, methods, rig: doubles.ensemble(methods, Waiting))
    assert all(f"{method}: Nodes: 8" in message and "80" in message for method in ("monocular", "stereo"))

    def one_waits(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
        return doubles.ensemble(methods, lambda name: (Waiting if name == "stereo" else doubles.FullEstimator)(name))

    assert main(["run", *words[:-1], str(tmp_path / "other"), "--no-recording"], one_waits) == 0
    methods = json.loads((tmp_path / "other" / "metrics.json").read_text())["methods"]
    assert "8" in methods["stereo"]["never_located"] and "never_located" not in methods["monocular"]


def test_no_motion_of_images_that_are_mixed_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "ispom.calibration.opening.with_look", lambda seen: replace(seen, notes=(*seen.notes, EXCHANGED))
    )
    drive, out = make_drive(tmp_path / "kitti", flat=True), tmp_path / "out"
    message = sentence(capsys, str(drive), "--out", str(out), builder=build)
    assert "exchanged" in message and "texture" not in message


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--stereo-every", "0"), "--stereo-every is 0, give 1"),
        (("--video-scale", "7"), "--video-scale is 7"),
        (("--stereo-every", "-3"), "--stereo-every is -3, give 1"),
        (("--video-scale", "nan"), "--video-scale is nan"),
        (("--video-scale", "0"), "--video-scale is 0"),
        (("--max-exposures", "1"), "--max-exposures is 1, give 3"),
        (("--max-exposures", "-1"), "--max-exposures is -1, give 3"),
        (("--seed", "-1"), "--seed is -1"),
        (("--max-exposures", "9" * 400), "give 3"),
        (("--stereo-every", "9" * 400), "give 1"),
        (("--monocular.max-tracks", "9" * 400), "--monocular.max-tracks is inf"),
        (("--seed", "9" * 400), "0 to 4294967295"),
        (("--camera", "nowhere.yaml"), "own calibration"),
        (("--monocular.max-tracks", "1"), "--monocular.max-tracks is 1,"),
    ],
)
def test_options_out_of_range(
    options: tuple[str, str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in sentence(capsys, str(make_drive(tmp_path)), *options)


@pytest.mark.parametrize("option", [("--seed", "x"), ("--frame", "world"), ("--no-such",)])
def test_options_that_do_not_exist(option: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["run", str(make_drive(tmp_path)), *option])
    assert caught.value.code == 2


def test_unwritable_output(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("kept")
    message = sentence(capsys, str(make_drive(tmp_path / "kitti")), "--out", str(tmp_path / "file" / "out"))
    assert f"{tmp_path}/file/out" in message
    assert (tmp_path / "file").read_text() == "kept"


def test_disk_full_while_writing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file that no longer fits is not there in part, its poses are in the journal, the others are whole."""
    create = whole.create_file
    full = lambda path: FileIO("/dev/full", "wb") if "integrated.tum" in path.name else create(path)  # noqa: E731
    monkeypatch.setattr(whole, "create_file", full)
    out = tmp_path / "out"
    message = sentence(capsys, str(make_drive(tmp_path / "kitti")), "--out", str(out))
    assert "integrated.tum" in message and os.strerror(ENOSPC) in message
    logs = {"steps.csv", "decisions.csv", "events.csv"}
    assert {p.name for p in out.iterdir()} == logs | {
        *("run.yaml", "rig.yaml", "truth.tum", "monocular.tum", "stereo.tum", "poses.csv", "metrics.json"),
        *("landmarks.npz", "thumbnail.jpg", MARKER),
    }
    assert len(read_tum(out / "stereo.tum")) == 6 and "No space" in (out / MARKER).read_text()


def test_disk_full_while_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The recording ends, the run does not: all else is written."""
    write = file_recording.FileRecording.write

    def full(self: file_recording.FileRecording, event: file_recording.Event) -> None:
        write(self, event)
        self.failure = f"{self.path} could not be written on (No space left on device): free some space"

    monkeypatch.setattr(file_recording.FileRecording, "write", full)
    out = tmp_path / "out"
    assert main(["run", str(make_drive(tmp_path / "kitti")), "--out", str(out)], fakes) == 2
    assert os.strerror(ENOSPC) in capsys.readouterr().err
    assert {f"{m}.tum" for m in METHODS} | {"metrics.json", "run.rrd", MARKER} <= {p.name for p in out.iterdir()}
    assert "No space" in (out / MARKER).read_text()


def test_a_marker_that_cannot_be_renewed_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = RunFolder(tmp_path / "out")

    monkeypatch.setattr(whole, "create_file", lambda _: FileIO("/dev/full", "wb"))
    folder.failed("no reason")
    assert "has not ended" in (tmp_path / "out" / MARKER).read_text()
