"""The examples of ORB-SLAM3 and SVO, with stand-ins for their packages: what they answer, and where two runs differ."""

from __future__ import annotations

import ast
import csv
import json
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.io.trajectories import read_tum
from tests.examples import stand_in
from tests.examples.packages import ispom
from tests.sequences.kitti_folder import make_drive

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = {"orbslam3": EXAMPLES / "orbslam3" / "ispom_orbslam3.py", "svo": EXAMPLES / "svo" / "ispom_svo.py"}
KINDS = {"orbslam3": "stereo", "svo": "video"}
FRAMES, OTHER_FROM, NEVER = 6, 4, 99


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_drive(tmp_path_factory.mktemp("kitti"), FRAMES)


def external(drive: Path, other_from: int) -> list[str]:
    """Both programs, as `--external` names them."""
    vocabulary = drive / "times.txt"  # any file: the stand-in does not read it
    found = []
    for name, options in (("orbslam3", ("--vocabulary", vocabulary)), ("svo", ())):
        words = [sys.executable, stand_in.__file__, name, FILES[name], other_from, *options]
        command = shlex.join(Path(w).as_posix() if isinstance(w, Path) else str(w) for w in words)
        found += ["--external", f"{name}:{KINDS[name]}={command}"]
    return found


def run(drive: Path, out: Path, other_from: int, *more: str) -> Path:
    words = ["run", str(drive), *external(drive, other_from), "--methods", *FILES]
    found = ispom(*words, "--no-recording", "--out", str(out), *more)
    assert found.returncode == 0, found.stderr
    return out


def rows(folder: Path, file: str) -> list[dict[str, str]]:
    with (folder / file).open() as opened:
        return list(csv.DictReader(opened))


def steps_of(folder: Path, name: str) -> list[dict[str, str]]:
    return [row for row in rows(folder, "steps.csv") if row["method"] == name]


@pytest.fixture(scope="module")
def first(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(drive, tmp_path_factory.mktemp("first") / "run", NEVER)


@pytest.mark.parametrize("name", FILES)
def test_ispom_never_imports_them_and_they_never_import_ispom(name: str) -> None:
    tree = ast.parse(FILES[name].read_text(encoding="utf-8"))
    imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    imported |= {str(n.module) for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert not {i for i in imported if i.split(".")[0] in {"ispom", "ispom_app"}}
    root = FILES[name].parents[2]
    for file in [*(root / "ispom").rglob("*.py"), *(root / "app").rglob("*.py"), root / "pyproject.toml"]:
        text = file.read_text(encoding="utf-8")
        assert "pyorbslam3" not in text and "svo_cpp" not in text, file


def test_orbslam3_has_poses_states_and_tracks_with_identities(first: Path) -> None:
    steps = steps_of(first, "orbslam3")
    status = [row["status"] for row in steps]
    assert status == ["lost" if i == stand_in.LOST_AT else "tracking" for i in range(FRAMES)]
    placed = [i for i in range(FRAMES) if i != stand_in.LOST_AT]
    z = [float(steps[i]["z"]) for i in placed]
    assert z == pytest.approx([stand_in.STEP_M * i for i in placed])
    every, all_new = str(stand_in.POINTS), {0, stand_in.LOST_AT + 1}
    assert [(steps[i]["new"], steps[i]["alive"]) for i in placed] == [
        (every, "0") if i in all_new else ("0", every) for i in placed
    ]
    decisions = [row for row in rows(first, "decisions.csv") if row["key"] == "tracking_state"]
    assert decisions[stand_in.LOST_AT]["consequence"] == "RECENTLY_LOST" and len(decisions) == FRAMES


def test_svo_begins_with_its_third_image_and_has_positions(first: Path) -> None:
    assert [row["status"] for row in steps_of(first, "svo")] == ["initialising"] * 2 + ["tracking"] * (FRAMES - 2)
    z = read_tum(first / "svo.tum").translations[:, 2]
    assert z == pytest.approx(stand_in.STEP_M * np.arange(2, FRAMES), abs=1e-9)


def test_the_first_divergence_of_two_runs_is_named(
    drive: Path, first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = run(drive, tmp_path / "other", OTHER_FROM)
    assert main(["diff", str(first), str(other), "--json"]) == 1
    news = json.loads(capsys.readouterr().out)["first"]
    for name in FILES:
        where, moved = next((w, d) for w in news for d in w["differences"] if d["name"] == f"{name}.position")
        assert where["exposure"] == int(steps_of(first, name)[OTHER_FROM]["exposure"])
        assert moved["by"] == pytest.approx(stand_in.OTHER_M)


def test_a_run_stops_where_orbslam3_is_lost(drive: Path, tmp_path: Path) -> None:
    stopped = run(drive, tmp_path / "run", NEVER, "--until", "orbslam3.tracking_state != 2")
    assert len(steps_of(stopped, "orbslam3")) == stand_in.LOST_AT + 1


@pytest.mark.parametrize(("name", "package"), [("orbslam3", "pyorbslam3"), ("svo", "svo_cpp")])
def test_a_missing_package_is_a_sentence(name: str, package: str) -> None:
    camera = {"width": 96, "height": 64, "fx": 80, "fy": 80, "cx": 47.5, "cy": 31.5, "distortion": []}
    rig: dict[str, dict[str, object]] = {"video": camera}
    for side, x in (("left", -0.25), ("right", 0.25)):
        rig[side] = {**camera, f"rig_from_{side}": {"translation_m": [x, 0, 0]}}
    requests = [{"type": "hello", "version": 1}, {"type": "start", "rig": rig, "settings": {}}]
    lines = "".join(json.dumps(request) + "\n" for request in requests)
    found = subprocess.run(
        [sys.executable, FILES[name]], input=lines, capture_output=True, text=True, timeout=100, check=True
    )
    hello, start = map(json.loads, found.stdout.splitlines())
    assert hello["version"] == 1 and f"No module named '{package}'" in start["error"]


def test_quaternions_and_lens_are_those_of_opencv() -> None:
    example = runpy.run_path(str(FILES["orbslam3"]))
    rng = np.random.default_rng(4)
    for axis in (rng.normal(size=3), np.array([np.pi, 0, 0]), np.zeros(3)):
        rotation = cv2.Rodrigues(axis)[0]
        x, y, z, w = example["quaternion_xyzw"](rotation)
        angle = np.linalg.norm(axis)
        sine = np.sin(angle / 2) * axis / max(angle, 1e-12)
        assert abs(np.dot([x, y, z, w], [*sine, np.cos(angle / 2)])) == pytest.approx(1)
    lens = [-0.22, 0.06, 0.0006, -0.0004]
    camera = {"fx": 226.0, "fy": 227.5, "cx": 160.9, "cy": 118.3, "distortion": lens, "width": 320, "height": 240}
    uv = rng.uniform((40, 40), (280, 200), (20, 2))
    matrix = np.array([[226.0, 0, 160.9], [0, 227.5, 118.3], [0, 0, 1]])
    rays = np.column_stack([(uv - (160.9, 118.3)) / (226.0, 227.5), np.ones(20)])
    bent = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(lens))[0].reshape(-1, 2)
    assert example["Tracks"](camera).distorted(uv) == pytest.approx(bent)


def test_a_vocabulary_has_parents_before_children(tmp_path: Path) -> None:
    rng, images = np.random.default_rng(0), []
    for n in range(2):
        image = cv2.resize(rng.integers(0, 256, (24, 32), np.uint8), (160, 120), interpolation=cv2.INTER_NEAREST)
        images.append(tmp_path / f"{n}.png")
        cv2.imwrite(str(images[-1]), image)
    target = tmp_path / "words.txt"
    runpy.run_path(str(EXAMPLES / "orbslam3" / "make_vocabulary.py"))["main"](target, images)
    head, *lines = target.read_text().split("\n")
    assert head == "10 4 0 0" and len(lines) > 20
    for number, line in enumerate(lines, 1):
        parent, is_word, *values, weight = line.split()
        assert 0 <= int(parent) < number and is_word in "01" and len(values) == 32 and float(weight) >= 0
        assert all(0 <= int(v) <= 255 for v in values)
