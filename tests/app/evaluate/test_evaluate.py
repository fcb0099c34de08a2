"""`ispom evaluate`: what it tells, what it writes, and what it says to mistakes."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_file import RunFile
from ispom_app.features.evaluation.evaluated import MOTIONS, distinct_names

from ispom.evaluation.comparison import Motion
from ispom.geometry import Pose
from ispom.io.trajectories import euroc_text, tum_text
from ispom.types import Trajectory
from tests import doubles
from tests.app.written import kitti_text
from tests.io.pose_examples import colmap_text, flat, lines, transforms, xyz, xyzw

TRUTH = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 20 * 10**9, 10**8)])
AWAY = Pose.from_rotvec(np.array([0.3, 1.0, -0.2]), np.array([5.0, 6, 7]))


def scaled(trajectory: Trajectory, factor: float) -> Trajectory:
    return Trajectory(trajectory.times_ns, trajectory.rotations, factor * trajectory.translations, trajectory.frame)


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    moved = TRUTH.moved(left=AWAY)
    texts = {
        "truth.tum": tum_text(TRUTH),
        "moved.tum": tum_text(moved),
        "half.csv": euroc_text(scaled(moved, 0.5).select(np.arange(20, 120))),
        "moved.kitti": kitti_text(moved),
        "truth.kitti": kitti_text(TRUTH),
        "short.kitti": kitti_text(TRUTH.select(np.arange(9))),
        "times.txt": "".join(f"{t / 1e9}\n" for t in TRUTH.times_ns),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    return {name: tmp_path / name for name in texts}


def numbers(out: Path, *arguments: object) -> list[dict]:
    assert main(["evaluate", *map(str, arguments), "--json", str(out)]) == 0
    return json.loads(out.read_text())["estimates"]


def test_motion_and_unit_are_taken_away(files: dict[str, Path], tmp_path: Path) -> None:
    estimates = files["moved.tum"], files["half.csv"]
    se3 = numbers(tmp_path / "a.json", files["truth.tum"], *estimates)
    assert [e["name"] for e in se3] == ["moved.tum", "half.csv"]
    assert se3[0]["ate_rmse_m"] == pytest.approx(0, abs=1e-6) and se3[1]["ate_rmse_m"] > 1
    sim3 = numbers(tmp_path / "b.json", files["truth.tum"], *estimates, "--alignment", "sim3")
    for entry in sim3:
        assert entry["ate_rmse_m"] == pytest.approx(0, abs=1e-6)
        assert entry["ate_rmse_deg"] == pytest.approx(0, abs=1e-5)
        assert entry["rpe_rmse_m"] == pytest.approx(0, abs=1e-6)
        assert entry["scale_end_over_start"] == pytest.approx(1, abs=1e-6)
    assert sim3[1]["alignment_scale"] == pytest.approx(2) and sim3[1]["scale_start"] == pytest.approx(0.5)
    assert sim3[0]["kitti_t_percent"] == pytest.approx(0, abs=1e-5)
    assert (sim3[0]["kitti_shortest_m"], sim3[0]["kitti_longest_m"]) == (5, 40)


def test_coverage(files: dict[str, Path], tmp_path: Path) -> None:
    whole, part = numbers(tmp_path / "a.json", files["truth.tum"], files["moved.tum"], files["half.csv"])
    assert (whole["poses_given"], whole["poses_asked"], whole["longest_gap_s"]) == (200, 200, pytest.approx(0.1))
    assert (part["poses_given"], part["poses_asked"], part["longest_gap_s"]) == (100, 200, pytest.approx(8.0))


@pytest.mark.parametrize("alignment", ["none", "first", "scale", "se3", "sim3"])
def test_the_protocol_is_always_stated(
    alignment: str, files: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(files["truth.tum"]), str(files["half.csv"]), "--alignment", alignment]
    assert main(["evaluate", *arguments]) == 0
    out = capsys.readouterr().out
    assert f"reference: {files['truth.tum']} (TUM, 200 poses" in out and "(EuRoC, 100 poses)" in out
    assert f"alignment: {alignment}: " in out and "at most 0.01 s away" in out
    assert "half.csv: body" in out and "truth.tum: unknown" in out
    assert "ATE, RMS [" in out and "KITTI t_err [%]" in out


def test_the_frame_of_a_run_is_reported_and_different_frames_are_a_warning(
    files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.yaml").write_text(RunFile("sim:city", "city", {"frame": "left"}, {}).text)
    assert main(["evaluate", str(files["truth.tum"]), str(files["half.csv"])]) == 0
    out = capsys.readouterr().out
    assert "truth.tum: left" in out and "lever arm" in out


def test_kitti_files_go_row_by_row_or_by_given_times(files: dict[str, Path], tmp_path: Path) -> None:
    (rows,) = numbers(tmp_path / "a.json", files["truth.kitti"], files["moved.kitti"])
    assert rows["ate_rmse_m"] == pytest.approx(0, abs=1e-9) and rows["longest_gap_s"] is None
    (timed,) = numbers(tmp_path / "b.json", files["truth.tum"], files["moved.kitti"], "--times", files["times.txt"])
    assert timed["poses_given"] == 200 and timed["timed"]


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_repeated_times_are_compared_and_noted(
    share: float, files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A reader that reads each image twice: most intervals are 0."""
    lines = files["truth.tum"].read_text().splitlines()
    count = round(len(lines) * share)
    first = [" ".join([lines[i - i % 2].split()[0], *lines[i].split()[1:]]) for i in range(count)]
    (tmp_path / "twice.tum").write_text("\n".join([*first, *lines[count:]]) + "\n")
    (tmp_path / "once.tum").write_text("\n".join([lines[0]] * 5) + "\n")
    (twice,) = numbers(tmp_path / "a.json", files["truth.tum"], tmp_path / "twice.tum")
    assert twice["ate_rmse_m"] > 0 and twice["poses_given"] <= twice["poses_asked"] <= len(lines)
    assert f"twice.tum: {count // 2} poses" in capsys.readouterr().out
    numbers(tmp_path / "b.json", tmp_path / "twice.tum", files["truth.tum"])
    assert main(["evaluate", str(files["truth.tum"]), str(tmp_path / "once.tum")]) == 0


def test_csv_and_plots(files: dict[str, Path], tmp_path: Path) -> None:
    arguments = [str(files[name]) for name in ("truth.tum", "moved.tum", "half.csv")]
    out = tmp_path / "out"
    assert main(["evaluate", *arguments, "--csv", str(out / "a.csv"), "--plots", str(out)]) == 0
    with (out / "a.csv").open() as file:
        first, second = csv.DictReader(file)
    assert first["estimate"] == "moved.tum" and float(first["ate_rmse_m"]) < 1e-6 < float(second["ate_rmse_m"])
    assert first["alignment"].startswith("se3")
    assert all((out / f"{n}.png").read_bytes().startswith(b"\x89PNG") for n in ("trajectory", "errors", "scale"))
    assert main(["evaluate", *arguments, "--plots", str(out), "--plot-format", "svg"]) == 0
    assert all("</svg>" in (out / f"{n}.svg").read_text() for n in ("trajectory", "errors", "scale"))


def test_plots_without_matplotlib_say_what_to_install(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr("ispom_app.features.evaluation.command.find_spec", lambda _: None)
    assert main(["evaluate", str(files["truth.tum"]), str(files["moved.tum"]), "--plots", str(tmp_path)]) == 2
    assert "pip install 'ispom[plots]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["truth.tum", "moved.kitti"], "only one has times"),
        (["truth.kitti", "short.kitti"], "has 9 rows"),
        (["truth.tum", "missing.tum"], "missing.tum is missing"),
        (["truth.tum", "times.txt"], "times.txt line 1 has 1 columns"),
        (["truth.tum", "moved.tum", "--delta", "0"], "--delta must be at least 1"),
        (["truth.tum", "moved.tum", "--max-difference-s", "nan"], "--max-difference-s"),
        (["truth.tum", "moved.tum", "--max-difference-s", "1e300"], "--max-difference-s"),
        (["truth.tum", "moved.tum", "--json", "truth.tum/a.json"], "cannot be written"),
        (["truth.tum"], "no estimate was given"),
    ],
)
def test_a_mistake_is_one_sentence(
    arguments: list[str], message: str, files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    placed = [str(tmp_path / a) if "." in a else a for a in arguments]
    assert main(["evaluate", *placed]) == 2
    printed = capsys.readouterr().err
    assert message in printed and printed.startswith("ispom: ") and printed.count("\n") == 1


def test_files_of_different_times_have_nothing_to_compare(
    files: dict[str, Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    later = Trajectory(TRUTH.times_ns + 10**12, TRUTH.rotations, TRUTH.translations)
    (tmp_path / "later.tum").write_text(tum_text(later))
    assert main(["evaluate", str(files["truth.tum"]), str(tmp_path / "later.tum")]) == 2
    assert "has 0 poses within 0.01 s" in capsys.readouterr().err


def test_a_path_without_length_has_no_scale(tmp_path: Path) -> None:
    """Standing still is no mistake: what cannot be said is left out."""
    still = Trajectory(TRUTH.times_ns, TRUTH.rotations, 0 * TRUTH.translations)
    (tmp_path / "a.tum").write_text(tum_text(still))
    (found,) = numbers(tmp_path / "a.json", tmp_path / "a.tum", tmp_path / "a.tum", "--alignment", "sim3")
    assert found["ate_rmse_m"] == 0 and found["scale_end"] is None and found["kitti_t_percent"] is None
    assert found["alignment_scale"] == 1


def test_a_straight_path_is_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Positions on a line say nothing of the turn about it."""
    along = np.outer(TRUTH.translations[:, 2], [0, 0, 1.0])
    (tmp_path / "a.tum").write_text(tum_text(Trajectory(TRUTH.times_ns, TRUTH.rotations, along)))
    for alignment, noted in (("se3", True), ("first", False)):
        assert main(["evaluate", *[str(tmp_path / "a.tum")] * 2, "--alignment", alignment]) == 0
        assert ("nearly straight" in capsys.readouterr().out) == noted


@pytest.mark.parametrize(("still", "motion"), [(False, "turns"), (True, "rests")])
def test_a_reference_without_translation_is_not_called_straight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], still: bool, motion: Motion
) -> None:
    rotations = np.broadcast_to(np.eye(3), TRUTH.rotations.shape) if still else TRUTH.rotations
    here = Trajectory(TRUTH.times_ns, rotations, 0 * TRUTH.translations)
    (tmp_path / "a.tum").write_text(tum_text(here))
    (tmp_path / "b.tum").write_text(tum_text(TRUTH))
    assert main(["evaluate", str(tmp_path / "a.tum"), str(tmp_path / "b.tum")]) == 0
    printed = capsys.readouterr().out
    assert MOTIONS[motion] in " ".join(printed.split()) and MOTIONS["straight"] not in printed


def test_names_are_distinct() -> None:
    assert distinct_names([Path("a/x.tum"), Path("b/x.tum"), Path("b/y.tum")]) == ["a/x.tum", "b/x.tum", "b/y.tum"]
    assert distinct_names([Path("a/x.tum")]) == ["x.tum"]
    assert len(set(distinct_names([Path("x"), Path("x")]))) == 2


@pytest.mark.parametrize(("option", "name"), [("--json", "a.json"), ("--csv", "a.csv"), ("--plots", "errors.png")])
def test_files_of_the_users_are_not_overwritten(
    option: str, name: str, files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text("mine")
    place = tmp_path if option == "--plots" else tmp_path / name
    arguments = ["evaluate", str(files["truth.tum"]), str(files["moved.tum"]), option, str(place)]
    assert main(arguments) == 2
    assert "earlier output" in capsys.readouterr().err and (tmp_path / name).read_text() == "mine"
    (tmp_path / name).unlink()
    assert main(arguments) == main(arguments) == 0


def test_svg_plots_are_replaced_by_their_like(files: dict[str, Path], tmp_path: Path) -> None:
    arguments = ["evaluate", str(files["truth.tum"]), str(files["moved.tum"]), "--plots", str(tmp_path / "plots")]
    assert main([*arguments, "--plot-format", "svg"]) == main([*arguments, "--plot-format", "svg"]) == 0


def test_files_of_other_programs_are_compared_by_names_and_numbers(tmp_path: Path) -> None:
    """Of one with images that are missing in the other."""
    poses = [pose for _, pose in TRUTH.items()][:40]
    (tmp_path / "transforms.json").write_bytes(transforms(poses))
    (tmp_path / "images.txt").write_bytes(colmap_text(poses[:30]))
    (tmp_path / "a.g2o").write_bytes(lines(poses[5:35], lambda i, p: ["VERTEX_SE3:QUAT", i + 5, *xyz(p), *xyzw(p)]))
    (tmp_path / "poses.txt").write_bytes(lines(poses, lambda i, p: [i, *flat(p)]))
    for reference, estimate in (("transforms.json", "images.txt"), ("poses.txt", "a.g2o")):
        (found,) = numbers(tmp_path / "out.json", tmp_path / reference, tmp_path / estimate, "--alignment", "none")
        assert found["poses_given"] == 30 and found["ate_rmse_m"] == pytest.approx(0, abs=1e-6)
        assert found["ate_rmse_deg"] == pytest.approx(0, abs=1e-4)


def test_positions_have_no_errors_of_rotations(files: dict[str, Path], tmp_path: Path) -> None:
    still = replace(TRUTH, rotations=np.tile(np.eye(3), (len(TRUTH), 1, 1)))
    (tmp_path / "still.tum").write_text(tum_text(still))
    (tmp_path / "leica.txt").write_bytes(lines([p for _, p in TRUTH.items()], lambda i, p: [f"{i / 10:.1f}", *xyz(p)]))
    for name in ("still.tum", "leica.txt"):
        (found,) = numbers(tmp_path / "a.json", tmp_path / name, files["moved.tum"])
        assert found["ate_rmse_m"] == pytest.approx(0, abs=1e-6)
        assert found["ate_rmse_deg"] is None and found["rpe_rmse_m"] is None and found["kitti_t_percent"] is None
        assert any(name in note for note in json.loads((tmp_path / "a.json").read_text())["notes"])
    (tmp_path / "rests.tum").write_text(tum_text(replace(still, translations=np.zeros((len(TRUTH), 3)))))
    (found,) = numbers(tmp_path / "a.json", files["truth.tum"], tmp_path / "rests.tum")
    assert found["ate_rmse_deg"] is not None, "a body at rest has errors of rotations"
    assert any("does not move" in note for note in json.loads((tmp_path / "a.json").read_text())["notes"])
    (found,) = numbers(tmp_path / "a.json", tmp_path / "still.tum", tmp_path / "still.tum")
    assert found["rpe_rmse_m"] is not None
