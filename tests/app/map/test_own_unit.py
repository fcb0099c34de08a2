"""A dense model from one camera: in the unit of the method's poses, of one segment, with exact poses exact depth."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.options import SourceOptions
from ispom_app.features.mapping.inputs import Ran, _near_depth, read_ran
from ispom_app.features.mapping.looks import DenseSettings, Look, _compared, looks

from ispom.errors import InputError
from ispom.evaluation.trajectory_error import alignment, associate
from ispom.geometry import Pose
from ispom.io.maps import SceneMap
from ispom.io.meshes import open3d, read_coloured_mesh
from ispom.reconstruction.model import Surface
from ispom.simulation.places.city import build_city
from ispom.simulation.rendering.renderer import Renderer
from ispom.types import Landmarks, Sequence, Trajectory

SIDEWAYS = "sim:tiny?motion=sideways&duration_s=4&place=city"
UNIT_M, NEAR_M, FAR_M = 0.37, 4.0, 30.0


@pytest.fixture(scope="module")
def sequence() -> Sequence:
    return SourceOptions().open(SIDEWAYS)


def true_path(sequence: Sequence) -> Trajectory:
    """world_from_video [m] of the video frames."""
    assert sequence.truth is not None
    path = sequence.truth.moved(right=sequence.rig.rig_from_video, frame="video")
    kinds = np.array(sequence.kinds)
    return path.select(np.isin(path.times_ns, sequence.times_ns[kinds == "video"]))


def errors(sequence: Sequence, path: Trajectory) -> tuple[float, np.ndarray]:
    """Share of the pixels with depth, and how far their depths are off, as shares; poses in units of UNIT_M."""
    own = replace(path, translations=path.translations / UNIT_M)
    settings = DenseSettings(NEAR_M / 4 / UNIT_M, 0.05, FAR_M / UNIT_M, 4.0, "spline", "video", as_given=True)
    made = looks(sequence, own, settings)
    look = made[len(made) // 2]()
    assert isinstance(look, Look)
    here = int(np.argmin(np.linalg.norm(own.translations - look.world_from_camera.translation, axis=1)))
    true = Renderer(build_city(0)).depth(look.camera, true_path(sequence).pose(here))
    known = look.depth > 0
    return float(known.mean()), np.abs(UNIT_M * look.depth[known] / true[known] - 1)


def test_exact_poses_in_any_unit_give_the_true_depth(sequence: Sequence) -> None:
    share, off = errors(sequence, true_path(sequence))
    assert share > 0.2
    assert np.median(off) < 0.01 and np.percentile(off, 90) < 0.06


def test_noise_of_the_poses_leaves_it_about_right(sequence: Sequence) -> None:
    rng, true = np.random.default_rng(2), true_path(sequence)
    noise = rng.normal(0, [3e-3] * 3 + [1e-4] * 3, (len(true), 6))
    noisy = [(t, pose @ Pose.exp(n)) for (t, pose), n in zip(true.items(), noise, strict=True)]
    share, off = errors(sequence, Trajectory.of(noisy, "video"))
    assert share > 0.2 and np.median(off) < 0.02


def test_close_images_are_compared_with_some_a_baseline_away() -> None:
    compared = _compared(np.arange(0, 6, 0.25))
    assert list(compared) == [8, 12]
    assert compared[8].tolist() == [4, 12, 0, 16]


def test_images_farther_apart_are_compared_with_their_neighbours_and_never_with_themselves() -> None:
    compared = _compared(np.array([0.0, 3.0, 6.5, 9.0, 15.0]))
    assert list(compared) == [1, 2, 3, 4]
    assert compared[1].tolist() == [0, 2] and compared[3].tolist() == [2, 4] and compared[4].tolist() == [3]


def test_the_near_depth_is_that_of_the_points_in_the_keyframes_of_the_path() -> None:
    turned = Pose.exp(np.array([0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0]))
    keys = Trajectory.of([(5, Pose()), (6, turned), (9, Pose(translation=np.array([0.0, 0.0, 2.0])))], "video")
    xyz = np.array([[0.0, 0.0, 4.0], [7.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    landmarks = Landmarks(np.array([3, 5, 8]), xyz, np.zeros((3, 3), np.uint8))
    seen_from, seen_ids = np.array([0, 1, 2, 2, 0]), np.array([3, 5, 3, 8, 4])  # 8 is behind, 4 has no position
    scene = SceneMap(landmarks, keys, seen_from, seen_ids, np.zeros((5, 2), np.float32))
    assert _near_depth(scene, keys.select(slice(0, 1))) == pytest.approx(4.0)
    assert _near_depth(scene, keys.select(slice(1, 2))) == pytest.approx(7.0)
    assert _near_depth(scene, keys.select(slice(2, 3))) == pytest.approx(2.0)
    assert _near_depth(scene, Trajectory.empty("video")) is None


def test_segments_are_never_mixed(sequence: Sequence) -> None:
    path = true_path(sequence)
    parts = (path.select(slice(0, 5)), path.select(slice(5, 20)), path.select(slice(20, 22)))
    ran = Ran(Path("run"), None, sequence, {}, {"monocular": parts})  # type: ignore[arg-type]
    assert ran.method(None) == "monocular"
    assert ran.segment("monocular", None) == 1 and ran.segment("monocular", 3) == 2
    with pytest.raises(InputError, match="3 segments"):
        ran.segment("monocular", 4)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With maps of monocular and of sfm."""
    try:
        open3d()
    except InputError as error:
        pytest.skip(str(error))
    out = tmp_path_factory.mktemp("own") / "run"
    assert main(["run", SIDEWAYS, "--methods", "monocular", "sfm", "--no-recording", "--out", str(out)]) == 0
    assert main(["map", str(out), "--out", str(out / "map")]) == 0
    return out


def surface_error(run: Path, folder: Path, method: str) -> float:
    """Median distance of the mesh from the true surfaces [m], once the path is laid on the true one."""
    ran = read_ran(run, None)
    own, true = associate(ran.own[method][0], true_path(ran.sequence))
    corners = read_coloured_mesh(folder / "mesh.ply").triangles[::10, 0].astype(float)
    placed = alignment(own, true, "sim3").apply(corners)
    return float(np.median(Surface(build_city(0).triangles).distances(placed)))


def test_the_map_of_monocular_is_the_place_in_its_own_unit(run: Path) -> None:
    numbers = json.loads((run / "map" / "map.json").read_text())
    dense = numbers["dense"]
    assert numbers["method"] == "monocular" and dense["unit"] == "own"
    assert (dense["segment"], dense["segments"], dense["depth_from"]) == (1, 1, "video")
    assert dense["triangles"] > 5_000 and "voxel_m" not in dense
    assert surface_error(run, run / "map", "monocular") < 0.15


def test_the_map_of_sfm_has_only_its_key_images(run: Path, tmp_path: Path) -> None:
    assert main(["map", str(run), "--method", "sfm", "--out", str(tmp_path / "sfm")]) == 0
    dense = json.loads((tmp_path / "sfm" / "map.json").read_text())["dense"]
    assert dense["unit"] == "own" and 1 <= dense["fused"] < 10
    assert surface_error(run, tmp_path / "sfm", "sfm") < 0.15


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--depth-from", "stereo"], "monocular has a unit of its own"),
        (["--segment", "2"], "monocular has 1 segments"),
        (["--laser", "sim", "--no-dense"], "has no metric poses"),
        (["--method", "stereo"], "has no poses of stereo: give --method as one of monocular, sfm"),
    ],
)
def test_a_mistake_is_one_sentence(
    run: Path, arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["map", str(run), *arguments, "--out", str(tmp_path / "map")]) == 2
    assert said in capsys.readouterr().err
