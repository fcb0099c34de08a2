"""A user's own route through a user's own mesh."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.trajectories import tum_text
from ispom.sequences.formats.simulated import open_scenario
from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import Flight
from ispom.simulation.places.meshes import mesh_name, mesh_place
from ispom.simulation.scenario.scenario import scenario_of_words
from ispom.types import Trajectory

SQUARE_M, WALL_M = 0.5, 4.0
CAMERA = simulated_rig(0.4).camera("left")


def route(folder: Path, still: bool = False) -> Path:
    flight = Flight.seeded(3)
    poses = [(t, Pose() if still else flight.pose_at(t)) for t in range(5_000_000_000, 6_500_000_000, 50_000_000)]
    (folder / "route.tum").write_text(tum_text(Trajectory.of(poses)))
    return folder / "route.tum"


def chessboard(folder: Path) -> Path:
    """16 x 16 squares in the plane z = 4, as a texture on two triangles."""
    texture = np.kron(np.indices((16, 16)).sum(axis=0) % 2, np.ones((32, 32))) * 200 + 20
    cv2.imwrite(str(folder / "board.png"), texture.astype(np.uint8))
    half = 8 * SQUARE_M
    (folder / "board.mtl").write_text("newmtl board\nmap_Kd board.png\n")
    (folder / "board.obj").write_text(
        "mtllib board.mtl\n"
        + "".join(f"v {x} {y} {WALL_M}\n" for x, y in ((-half, half), (half, half), (half, -half), (-half, -half)))
        + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl board\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    return folder / "board.obj"


def test_the_rig_moves_through_the_poses_of_the_file(tmp_path: Path) -> None:
    found = open_scenario(scenario_of_words(f"tiny?route={route(tmp_path)}"), 0, tmp_path)
    assert found.truth is not None and found.times_ns[-1] == pytest.approx(1.45e9, abs=4e7)
    for time_ns, pose in found.truth.items()[::9]:
        np.testing.assert_allclose(pose.matrix, Flight.seeded(3).pose_at(5_000_000_000 + time_ns).matrix, atol=2e-3)


def test_a_texture_is_seen_where_it_is(tmp_path: Path) -> None:
    place, pose = (
        mesh_place(mesh_name(str(chessboard(tmp_path)))),
        Pose.from_rotvec(np.array([0.1, 0.2, 0.3]), np.zeros(3)),
    )
    image = place.image(CAMERA, pose, 1)
    grid = (np.stack(np.meshgrid(np.arange(-3, 4), np.arange(-3, 4)), axis=-1).reshape(-1, 2)) * SQUARE_M
    uv = CAMERA.project(pose.inverse().apply(np.column_stack([grid, np.full(len(grid), WALL_M)])))
    inside = ((uv > 12) & (uv < (CAMERA.width - 12, CAMERA.height - 12))).all(axis=1)
    grey = cv2.cvtColor(image.clip(0, 255).astype(np.uint8), cv2.COLOR_RGB2GRAY)
    start = uv[inside].astype(np.float32)[:, None] + np.float32([1.2, -0.8])
    found = cv2.cornerSubPix(grey, start.copy(), (5, 5), (-1, -1), (3, 50, 0.001))[:, 0]
    assert inside.sum() > 15 and np.abs(found - uv[inside]).max() < 0.15
    assert np.array_equal(image, place.image(CAMERA, pose, 3)), "for any number of threads"


def test_colours_of_corners_are_mixed_between_them(tmp_path: Path) -> None:
    (tmp_path / "a.ply").write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\n"
        + "".join(f"property float {a}\n" for a in "xyz")
        + "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
        + "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        + "-20 20 4 255 0 0\n20 20 4 0 255 0\n0 -20 4 0 0 255\n3 0 1 2\n"
    )
    image = mesh_place(mesh_name(str(tmp_path / "a.ply"))).image(CAMERA, Pose(), 1)
    np.testing.assert_allclose(image[CAMERA.height // 2, CAMERA.width // 2], [255 / 4, 255 / 4, 255 / 2], atol=3)


def test_a_mesh_is_a_sequence_like_any_other(tmp_path: Path) -> None:
    words = f"tiny?mesh={chessboard(tmp_path)}&route={route(tmp_path, still=True)}&duration_s=0.1"
    found = open_scenario(scenario_of_words(words), 0, tmp_path)
    pair = found[1]
    left, right = (np.asarray(i).mean(axis=2) for i in (pair.left, pair.right))  # type: ignore[union-attr]
    shift = round(found.rig.camera("left").fx * found.rig.baseline_m / WALL_M)
    assert left.std() > 50 and np.abs(left[:, shift:] - right[:, :-shift]).mean() < 15


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("tiny?mesh={folder}/board.obj", "a mesh needs a route"),
        ("tiny?mesh={folder}/none.obj&route={folder}/route.tum", "none.obj"),
        ("tiny?mesh={folder}/board.mtl&route={folder}/route.tum", "is no mesh"),
        ("tiny?route={folder}/short.tum", "has 1 poses: a route needs at least 4"),
        ("tiny?route={folder}/route.tum&duration_s=9", "cannot last 9 s"),
        ("town?vehicles=3", "vehicles and people are in the city only"),
    ],
)
def test_a_mistake_is_a_sentence(words: str, sentence: str, tmp_path: Path) -> None:
    chessboard(tmp_path)
    route(tmp_path)
    (tmp_path / "short.tum").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(InputError, match=sentence):
        open_scenario(scenario_of_words(words.format(folder=tmp_path)), 0, tmp_path)


def test_another_content_is_another_name(tmp_path: Path) -> None:
    path = chessboard(tmp_path)
    before = mesh_name(str(path))
    path.write_text(path.read_text().replace("v -4.0", "v -3.0", 1))
    assert mesh_name(str(path)) != before
