"""`ispom demo` and `ispom app`: what reaches the app."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from ispom_app.cli.main import main
from ispom_app.features.page import command
from ispom_app.views.web.server import Serving

from ispom.errors import InputError
from ispom.methods import Config
from tests.app import helpers
from tests.app.helpers import ran
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What the session is made of, and how it is served."""
    calls: list[tuple[Any, ...]] = []

    def serve(make_session: Any, serving: Serving) -> int:
        calls.append((*make_session(None), serving))
        return 0

    monkeypatch.setattr(command, "serve", serve)
    monkeypatch.setattr(command, "Session", lambda setup, live: (setup.opener, setup.source, vars(setup)))
    return calls


def test_the_demo_is_the_city_on_this_machine_only(served: list[tuple[Any, ...]]) -> None:
    assert main(["demo", "--no-browser"]) == 0
    ((_, source, options, serving),) = served
    assert source == "sim:city" and options["methods"] is None
    assert serving == Serving(open_browser=False) and not serving.lets_others_in


@pytest.mark.parametrize("arguments", [[], ["app"]])
def test_without_a_source_the_app_opens_on_its_start_screen(
    served: list[tuple[Any, ...]], arguments: list[str]
) -> None:
    assert main(arguments) == 0
    ((opener, source, _, _),) = served
    assert source == ""
    with pytest.raises(InputError):
        opener("")


def test_an_external_trajectory_without_a_source_is_a_mistake(served: list[tuple[Any, ...]], tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    assert main(["app", "--beside", f"orb={tmp_path / 'poses.txt'}"]) == 2
    assert not served


def test_options_reach_the_app(served: list[tuple[Any, ...]], tmp_path: Path) -> None:
    drive = str(make_drive(tmp_path))
    arguments = ["--port", "9000", "--host", "0.0.0.0", "--allow-host", "lab.example", "--base", "/ispom/"]
    arguments += ["--stereo-every", "3", "--methods", "stereo", "monocular"]
    assert main(["app", drive, *arguments, "--stereo.paper.matching", "klt"]) == 0
    ((opener, source, options, serving),) = served
    assert source == drive and serving == Serving(
        host="0.0.0.0", port=9000, allowed_hosts=("lab.example",), base="/ispom/"
    )
    assert options["methods"] == ("monocular", "stereo") and options["config"].of("stereo.paper").matching == "klt"
    assert opener(source).kinds.count("stereo") == 2
    with pytest.raises(InputError, match="does not exist"):
        opener(f"{drive}/nowhere")


def test_the_app_opens_at_a_frame(served: list[tuple[Any, ...]], tmp_path: Path) -> None:
    drive = str(make_drive(tmp_path))
    assert main(["app", drive, "--at", "3"]) == 0
    assert served[0][-1].fragment == "#at=3" and Serving(at=3, mode="learn").fragment == "#at=3&mode=learn"
    assert main(["app", drive, "--at", "-1"]) == main(["app", "--at", "3"]) == 2
    assert Serving().fragment == "" and len(served) == 1


def test_a_mistake_of_the_app_is_reported_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def serve(*_: Any, **__: Any) -> int:
        raise InputError("ports 1 to 20 are all taken: give another --port")

    monkeypatch.setattr(command, "serve", serve)
    assert main(["demo"]) == 2
    err = capsys.readouterr().err
    assert "ports 1 to 20" in err and "--port" in err and err.count("\n") == 1


def test_a_methods_settings_are_flags_of_its_own(served: list, tmp_path: Path) -> None:
    flags = ["--variant", "modern", "--stereo.no-self-calibration", "--monocular.paper.max-tracks", "300"]
    assert main(["app", str(make_drive(tmp_path)), *flags, "--methods", "stereo", "integrated.paper"]) == 0
    ((_, _, options, _),) = served
    config = options["config"]
    assert options["variant"] == "modern" and options["methods"] == ("stereo", "integrated.paper")
    assert not config.of("stereo").self_calibration and config.of("monocular.paper").max_tracks == 300
    assert config.of("stereo.paper") == Config().of("stereo.paper")


def test_the_page_may_open_what_the_command_line_names_or_allows(served: list, tmp_path: Path) -> None:
    drive, other = str(make_drive(tmp_path / "data")), str(make_drive(tmp_path / "other"))
    for arguments in (["--root", str(tmp_path / "data")], ["--root", str(tmp_path / "other" / "sequences")]):
        assert main(["app", drive, *arguments]) == 0
    (opener, *_), (elsewhere, *_) = served
    assert len(opener(drive)) and len(elsewhere(drive)) and len(elsewhere(other))
    for source, flag in ((other, "is outside of"), ("camera:0", "--allow-devices"), ("http://x/1", "--allow-network")):
        with pytest.raises(InputError, match=flag):
            opener(source)


def test_the_address_on_the_command_line_is_known_without_its_password(served: list, tmp_path: Path) -> None:
    assert main(["app", "http://me:secret@127.0.0.1:9/1"]) == 0
    ((opener, *_),) = served
    for source in ("http://me:secret@127.0.0.1:9/1", "http://127.0.0.1:9/1"):
        with pytest.raises(InputError, match=r"http://127.0.0.1:9/1"):
            opener(source)


def test_a_name_that_no_page_can_show_is_refused(
    served: list[tuple[Any, ...]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9")
    os.rename(make_drive(tmp_path / "kitti"), source)
    assert main(["app", source]) == 2 and not served
    assert "caf\\udce9 is not UTF-8" in capsys.readouterr().err
    (tmp_path / "link").symlink_to(source)
    assert main(["app", f"{tmp_path}/link"]) == 0
    ((opener, *_),) = served
    assert opener(f"{tmp_path}/link").name == "KITTI caf\\udce9"


def test_a_root_that_is_no_folder_is_refused(served: list, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--root", "/no/such/folder"]) == 2 and not served
    assert "--root is /no/such/folder" in capsys.readouterr().err


def test_the_version_is_that_of_the_package(capsys: pytest.CaptureFixture[str]) -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"{project['name']} {project['version']}\n"


@pytest.mark.parametrize("words", [["sources"], ["--help"], ["--version"]])
def test_a_reader_that_stops_reading_is_no_traceback(tmp_path: Path, words: list[str]) -> None:
    """`ispom ... | head`: the pipe is closed before anything is written."""
    reader, writer = os.pipe()
    os.close(reader)
    words = words if words == ["--version"] else [*words, str(make_drive(tmp_path))]
    command = [sys.executable, "-m", "ispom_app", *words]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, timeout=120, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, b"")


@pytest.mark.skipif(sys.platform == "win32", reason="a POSIX shell closes it")
def test_a_closed_standard_output_is_no_traceback(tmp_path: Path) -> None:
    command = f"exec {shlex.quote(sys.executable)} -m ispom_app sources {shlex.quote(str(make_drive(tmp_path)))} >&-"
    done = subprocess.run(["sh", "-c", command], stderr=subprocess.PIPE, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device here")
def test_a_full_standard_output_is_one_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ispom_app", "sources", str(make_drive(tmp_path))]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, timeout=120, check=False)
    assert done.returncode == 2 and done.stderr.startswith(b"ispom: standard output cannot be used (No space left")
    assert done.stderr.count(b"\n") == 1


@pytest.mark.parametrize("arguments", [["fly"], ["run"]])
def test_misuse_ends_with_code_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2


def test_trajectories_of_other_programs_reach_the_app(served: list, tmp_path: Path) -> None:
    poses = tmp_path / "poses.txt"
    drive = make_drive(tmp_path)
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * len(list((drive / "image_0").glob("*.png"))))
    alignment = ["--beside-alignment", "orb=first"]
    assert main(["app", str(drive), "--beside", f"orb:left={poses}", *alignment]) == 0
    ((_, _, options, _),) = served
    (given,) = options["trajectory_options"]
    assert (given.name, given.frame, given.alignment) == ("orb", "left", "first")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("0 1 2\n", "which no trajectory has"),
        ("1e9 0 0 0 0 0 0 1\n", "none in common"),
        ("1 0 0 0 0 1 0 0 0 0 1 0\n", "has 1 rows without times"),
    ],
)
def test_a_trajectory_that_does_not_fit_is_one_sentence_before_anything_is_served(
    served: list, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, why: str
) -> None:
    (tmp_path / "poses.txt").write_text(text)
    assert main(["app", str(make_drive(tmp_path)), "--beside", f"orb={tmp_path / 'poses.txt'}"]) == 2
    message = capsys.readouterr().err
    assert why in message and message.count("\n") == 1 and not served


def test_an_external_trajectory_is_drawn_with_a_finished_run_or_its_recording(served: list, tmp_path: Path) -> None:
    drive = make_drive(tmp_path)
    ran(drive, tmp_path / "run", "--methods", "stereo", builder=helpers.build)
    alone = tmp_path / "alone.rrd"
    alone.write_bytes((tmp_path / "run" / "run.rrd").read_bytes())
    flags = ["--beside", f"orb={tmp_path / 'run' / 'truth.tum'}"]
    for source in (tmp_path / "run", tmp_path / "run" / "run.rrd", alone):
        assert main(["app", str(source), *flags], helpers.build) == 0
    assert [[option.name for option in options["trajectory_options"]] for _, _, options, _ in served] == [["orb"]] * 3


def test_poses_of_a_camera_that_a_recording_lacks_are_refused(
    served: list, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_drive(tmp_path, right=False)
    flags = ["--beside", f"orb:right={tmp_path / 'poses' / '07.txt'}"]
    assert main(["app", str(drive), *flags]) == 2
    assert "right camera" in capsys.readouterr().err and not served


def test_no_external_trajectory_with_a_live_source(
    served: list, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 0 1\n")
    assert main(["app", "camera:0", "--beside", f"orb={tmp_path / 'poses.txt'}"]) == 2
    assert "is live" in capsys.readouterr().err and not served


def test_the_lessons_open_as_a_list(served: list[Any]) -> None:
    assert main(["learn"]) == 0
    ((_, source, options, serving),) = served
    assert source == "" and serving.mode == "learn" and not options["autoplay"]
