"""`ispom export`: other tools read what a run found."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_file import RunFile
from ispom_app.engine.run_folder.run_folder import MARKER

from ispom.errors import InputError
from ispom.io.kitti import read_poses, read_times
from ispom.io.maps import map_bytes, read_maps
from ispom.io.meshes import open3d
from ispom.io.poses.recognised import read_trajectory
from ispom.io.rig import rig_text
from ispom.io.trajectories import read_tum, tum_text
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import ran
from tests.io.test_maps import LINES, scene
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a monocular run with points whose place is known."""
    folder = tmp_path / "run"
    folder.mkdir()
    found = scene(noise_px=0.4, outliers=25)
    (folder / "run.yaml").write_text(RunFile("sim:city", "city", {"frame": "video"}, {}).text)
    (folder / "rig.yaml").write_text(rig_text(doubles.rig()))
    (folder / "monocular.tum").write_text(tum_text(found.key_frames))
    (folder / "landmarks.npz").write_bytes(map_bytes({"monocular": found}))
    return folder


def exported(run: Path, form: str) -> Path:
    assert main(["export", str(run), "--format", form]) == 0
    return run / "export" / form


@pytest.mark.parametrize(("form", "name"), [("tum", "monocular.tum"), ("euroc", "monocular.csv")])
def test_timed_trajectories(form: str, name: str, run: Path) -> None:
    found, own = read_trajectory(exported(run, form) / name), read_tum(run / "monocular.tum")
    assert found.format.lower() == form and found.trajectory.times_ns.tolist() == own.times_ns.tolist()
    np.testing.assert_allclose(found.trajectory.translations, own.translations, atol=1e-9)
    np.testing.assert_allclose(found.trajectory.rotations, own.rotations, atol=1e-8)


def test_kitti_with_times(run: Path) -> None:
    folder, own = exported(run, "kitti"), read_tum(run / "monocular.tum")
    poses = read_poses(folder / "monocular.txt")
    np.testing.assert_allclose([p.translation for p in poses], own.translations, atol=1e-9)
    np.testing.assert_allclose([p.rotation for p in poses], own.rotations, atol=1e-9)
    assert read_times(folder / "monocular_times.txt").tolist() == own.times_ns.tolist()


def test_ply_opens_in_open3d(run: Path) -> None:
    path, expected = exported(run, "ply") / "monocular.ply", scene()
    try:
        reader = open3d().io
    except InputError as error:
        pytest.skip(str(error))
    cloud, line = reader.read_point_cloud(str(path)), reader.read_line_set(str(path))
    points = np.asarray(cloud.points)
    np.testing.assert_allclose(points[:60], expected.landmarks.xyz_in_world, rtol=1e-6)
    np.testing.assert_allclose(points[60:], expected.key_frames.translations, atol=1e-6)
    np.testing.assert_allclose(np.asarray(cloud.colors)[:60] * 255, expected.landmarks.rgb, atol=0.5)
    assert np.asarray(line.lines).tolist() == [[60 + i, 61 + i] for i in range(7)]


@pytest.fixture
def run_with_lines(run: Path) -> Path:
    """The same with lines of the scene, as the methods `lines` and `tags` have them."""
    (run / "landmarks.npz").write_bytes(map_bytes({"monocular": replace(scene(), lines=LINES)}))
    return run


def test_ply_has_the_lines_of_the_scene_as_edges(run_with_lines: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = exported(run_with_lines, "ply") / "monocular.ply"
    assert "60 points, 3 lines" in capsys.readouterr().out
    content = path.read_bytes()
    header, _, body = content.partition(b"end_header\n")
    assert b"element vertex 74\n" in header and b"element edge 10\n" in header
    vertices = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]), 74)
    edges = np.frombuffer(body, np.dtype("<i4"), offset=vertices.nbytes).reshape(-1, 2)
    np.testing.assert_array_equal(vertices["xyz"][68:].reshape(3, 2, 3), LINES.xyz_in_world.astype(np.float32))
    assert edges[:7].tolist() == [[60 + i, 61 + i] for i in range(7)]
    assert edges[7:].tolist() == [[68, 69], [70, 71], [72, 73]]
    assert vertices["rgb"][68].tolist() == vertices["rgb"][69].tolist() != vertices["rgb"][70].tolist()


def test_lines_open_in_open3d(run_with_lines: Path) -> None:
    path = exported(run_with_lines, "ply") / "monocular.ply"
    try:
        reader = open3d().io
    except InputError as error:
        pytest.skip(str(error))
    found = reader.read_line_set(str(path))
    points, edges = np.asarray(found.points), np.asarray(found.lines)
    np.testing.assert_allclose(points[edges[7:]], LINES.xyz_in_world, rtol=1e-6)


def test_csv_has_a_row_for_each_line_of_the_scene(run_with_lines: Path) -> None:
    with (exported(run_with_lines, "csv") / "monocular_lines.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["id"], row["group"]) for row in rows] == [("0", "0"), ("1", "1"), ("2", "2")]
    ends = [[float(row[f"{axis}{end}"]) for end in (1, 2) for axis in "xyz"] for row in rows]
    np.testing.assert_array_equal(np.array(ends).reshape(3, 2, 3), LINES.xyz_in_world)


def test_csv(run: Path) -> None:
    folder, expected = exported(run, "csv"), scene()
    with (folder / "monocular_landmarks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["id"]) for row in rows] == expected.landmarks.ids.tolist()
    assert not (folder / "monocular_lines.csv").exists()
    assert [float(rows[5][axis]) for axis in "xyz"] == pytest.approx(expected.landmarks.xyz_in_world[5], rel=1e-6)
    with (folder / "monocular.csv").open() as file:
        assert [int(row["time_ns"]) for row in csv.DictReader(file)] == expected.key_frames.times_ns.tolist()


def test_colmap_opens_the_model(run: Path) -> None:
    """Same poses, points and camera (distorted), and what does not fit is left out."""
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    folder, expected = exported(run, "colmap") / "monocular", scene()
    model = pycolmap.Reconstruction()
    model.read_text(str(folder))
    assert model.num_images() == 8 and model.num_points3D() == 60
    assert 8 * 60 - 25 - 10 <= model.compute_num_observations() <= 8 * 60 - 20
    for (time_ns, pose), (_, image) in zip(expected.key_frames.items(), sorted(model.images.items()), strict=True):
        assert image.name == f"video/{time_ns}.png"
        found = image.cam_from_world().inverse().matrix()
        np.testing.assert_allclose(found, pose.matrix[:3], atol=1e-9)
    for i, xyz, rgb in zip(*(getattr(expected.landmarks, n) for n in ("ids", "xyz_in_world", "rgb")), strict=True):
        np.testing.assert_allclose(model.points3D[int(i)].xyz, xyz, rtol=1e-6)
        assert model.points3D[int(i)].color.tolist() == rgb.tolist()
    model.update_point_3d_errors()
    assert 0.2 < model.compute_mean_reprojection_error() <= 1.5
    camera, own = model.cameras[1], doubles.rig().camera("video")
    seen = camera.img_from_cam(np.array([[0.3, -0.2, 1.0]]))
    np.testing.assert_allclose(seen - 0.5, own.project(np.array([[0.3, -0.2, 1.0]])), atol=1e-9)


def test_a_model_that_the_poses_do_not_fit_is_an_error_and_not_an_empty_folder(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Landmarks in another frame than the poses, as a damaged or foreign folder has them."""
    found = scene()
    elsewhere = replace(found.landmarks, xyz_in_world=found.landmarks.xyz_in_world + 5)
    (run / "landmarks.npz").write_bytes(map_bytes({"monocular": replace(found, landmarks=elsewhere)}))
    assert main(["export", str(run), "--format", "colmap"]) == 2
    message = capsys.readouterr().err
    assert "of 480 observations" in message and "--max-error-px" in message and message.count("\n") == 1
    assert not (run / "export").exists()


def test_methods_that_fit_are_written_before_one_that_does_not_is_named(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = scene()
    alone = replace(found, seen_from=found.seen_from[:60], seen_ids=found.seen_ids[:60], seen_uv=found.seen_uv[:60])
    (run / "stereo.tum").write_text(tum_text(found.key_frames))
    (run / "landmarks.npz").write_bytes(map_bytes({"monocular": found, "stereo": alone}))
    assert main(["export", str(run), "--format", "colmap"]) == 2
    assert "keyframes of stereo" in capsys.readouterr().err
    assert (run / "export" / "colmap" / "monocular" / "points3D.txt").exists()


@pytest.mark.parametrize(("variant", "kept"), [("modern", 0.95), ("paper", 0.9)])
def test_a_model_of_a_good_run_keeps_its_observations(
    variant: str, kept: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each method's landmarks agree with its final poses, whatever was revised since they were found."""
    out = tmp_path / "run"
    arguments = ["sim:tiny", "--max-exposures", "60", "--no-recording", "--variant", variant, "--out", str(out)]
    assert main(["run", *arguments]) == 0
    capsys.readouterr()
    assert main(["export", str(out), "--format", "colmap"]) == 0
    counts = re.findall(r"(\d+) of (\d+) observations", capsys.readouterr().out)
    assert len(counts) == 3
    for fitting, observations in counts:
        assert int(observations) > 300 and int(fitting) >= kept * int(observations)


@pytest.mark.parametrize("form", ["tum", "kitti", "euroc", "vslam-lab", "ply", "csv"])
def test_every_format_of_a_run(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    ran(make_drive(tmp_path / "kitti"), run, "--no-recording", builder=helpers.build)
    maps = read_maps(run / "landmarks.npz")
    assert list(maps) == list(METHODS) and len(maps["stereo"].seen_ids)
    capsys.readouterr()
    exported(run, form)
    out = capsys.readouterr().out
    assert all(method in out for method in METHODS)
    assert main(["export", str(run), "--format", form, "--methods", "stereo", "--out", str(tmp_path / "one")]) == 0
    assert all("stereo" in str(path) for path in (tmp_path / "one").rglob("[!.]*.*"))


def test_an_incomplete_run_is_exported_with_a_notice(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (run / MARKER).write_text("Stopped by a signal.\n")
    exported(run, "tum")
    assert "not complete" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("damage", "form", "message"),
    [
        (("run.yaml", None), "tum", "holds no run"),
        (("run.yaml", "options: [1"), "tum", "is not valid YAML"),
        (("monocular.tum", None), "tum", "no trajectory of any method"),
        (("monocular.tum", "0 0 0\n"), "tum", "line 1 has 3 columns"),
        (("landmarks.npz", None), "ply", "landmarks.npz is missing"),
        (("landmarks.npz", "x"), "csv", "is damaged"),
        (("rig.yaml", "left: 1"), "colmap", "left"),
        (("export", "a file in the way"), "tum", "cannot be created"),
    ],
)
def test_a_mistake_is_one_sentence(
    damage: tuple[str, str | None], form: str, message: str, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, text = damage
    if text is None:
        (run / name).unlink()
    else:
        (run / name).write_text(text)
    assert main(["export", str(run), "--format", form]) == 2
    printed = capsys.readouterr().err
    assert message in printed and printed.startswith("ispom: ") and printed.count("\n") == 1


def test_a_folder_with_other_files_is_left_alone(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (run / "monocular.tum").read_text()
    assert main(["export", str(run), "--format", "tum", "--out", str(run)]) == 2
    assert "is not empty" in capsys.readouterr().err and (run / "monocular.tum").read_text() == before
    exported(run, "tum")
    exported(run, "tum")
