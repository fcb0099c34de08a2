"""`ispom map`: a run's folder gets a surface and a laser's points, and what lacks something is told in one sentence."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.made_map import made_map
from ispom_app.session.current_run import CurrentRun
from ispom_app.session.review.folder import read_stored
from ispom_app.session.review.recording import identity
from rerun.chunk import RrdReader

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.io.meshes import GLTF_FROM_WORLD, open3d, read_coloured_mesh
from ispom.io.timed_points import read_timed_points
from ispom.reconstruction.model import Surface
from ispom.simulation.motions import Flight
from ispom.simulation.places.city import build_city
from tests.app.helpers import ran


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With its map, and what the command printed."""
    try:
        open3d()
    except InputError as error:
        pytest.skip(str(error))
    out = tmp_path_factory.mktemp("map") / "run"
    ran("sim:tiny", out, "--methods", "stereo", "integrated")
    assert main(["map", str(out), "--laser", "sim"]) == 0
    return out


def numbers(run: Path) -> dict:
    return json.loads((run / "map" / "map.json").read_text())


def test_the_surface_is_the_simulated_one(run: Path) -> None:
    mesh = read_coloured_mesh(run / "map" / "mesh.ply")
    dense = numbers(run)["dense"]
    assert dense["fused"] == 7 and dense["skipped"] == 2 and dense["triangles"] == len(mesh.triangles) > 20_000
    start = Flight.seeded(0).pose_at(11_300_000)  # the first pair: there the world of the run begins
    corners = start.apply(mesh.triangles[::20, 0].astype(float))
    far = Surface(build_city(0).triangles).distances(corners)
    assert np.median(far) < 0.03
    assert 30 < mesh.rgb.mean() < 220 and mesh.rgb.std() > 15


def test_the_video_shows_the_surface_as_well(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "video"
    assert main(["map", str(run), "--depth-from", "video", "--out", str(out)]) == 0
    dense = json.loads((out / "map.json").read_text())["dense"]
    assert dense["depth_from"] == "video" and dense["fused"] > 4
    corners = (
        Flight.seeded(0)
        .pose_at(11_300_000)
        .apply(read_coloured_mesh(out / "mesh.ply").triangles[::20, 0].astype(float))
    )
    far = Surface(build_city(0).triangles).distances(corners)
    assert np.median(far) < 0.03


def test_gltf_is_the_same_surface_with_y_up(run: Path) -> None:
    ply, glb = (read_coloured_mesh(run / "map" / name) for name in ("mesh.ply", "mesh.glb"))
    back = GLTF_FROM_WORLD.inverse().apply(glb.triangles.astype(float))
    np.testing.assert_allclose(back, ply.triangles, atol=1e-5)
    assert np.array_equal(glb.rgb, ply.rgb)


def test_poses_at_the_rate_of_the_video_are_worth_it(run: Path) -> None:
    laser = numbers(run)["laser"]
    assert laser["integrated"]["rmse_m"] < 0.35 * laser["stereo"]["rmse_m"]
    assert laser["truth"]["rmse_m"] < 0.01 and laser["integrated"]["points"] > 30_000
    assert (run / "map" / "laser.png").read_bytes().startswith(b"\x89PNG")


def test_a_file_of_points_gives_what_the_profiler_gives(run: Path, tmp_path: Path) -> None:
    points = run / "map" / "points.csv"
    assert len(read_timed_points(points)) > 30_000
    out = tmp_path / "again"
    assert main(["map", str(run), "--no-dense", "--laser", str(points), "--out", str(out)]) == 0
    again, laser = json.loads((out / "map.json").read_text())["laser"], numbers(run)["laser"]
    assert again["integrated"]["rmse_m"] == pytest.approx(laser["integrated"]["rmse_m"], abs=1e-4)


def test_lines_between_poses_are_optional_and_worse(run: Path, tmp_path: Path) -> None:
    arguments = [
        "map",
        str(run),
        "--no-dense",
        "--laser",
        "sim",
        "--interpolate",
        "linear",
        "--out",
        str(tmp_path / "l"),
    ]
    assert main(arguments) == 0
    found = json.loads((tmp_path / "l" / "map.json").read_text())
    assert found["interpolate"] == "linear"
    assert found["laser"]["truth"]["rmse_m"] > numbers(run)["laser"]["truth"]["rmse_m"]


def test_the_recording_belongs_to_the_runs(run: Path) -> None:
    assert identity(run / "map" / "map.rrd") == identity(run / "run.rrd")
    chunks = RrdReader(run / "map" / "map.rrd").stream().to_chunks()
    found = {chunk.entity_path.lstrip("/") for chunk in chunks}
    assert {"world/integrated/map", "world/integrated/laser", "world/stereo/laser"} <= found


def test_review_finds_the_map(run: Path, tmp_path: Path) -> None:
    made = made_map(run)
    assert made is not None and made.method == "integrated" and made.preview.stat().st_size > 100_000
    stored = read_stored(run, lambda source, options: options.open(source), build)
    assert CurrentRun.of_stored(stored, 1 << 26).opened.map == made
    assert made_map(tmp_path) is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["{run}", "--method", "monocular"], "has no poses of monocular: give --method as one of"),
        (["{run}", "--voxel-m", "-1"], "--voxel-m is -1: give a positive number"),
        (["{run}", "--no-dense"], "leaves nothing to do"),
        (["{run}", "--laser", "{folder}/none.csv"], "none.csv"),
        (["{run}", "--source", "sim:tiny?duration_s=1"], "is not the source that the run had"),
        (["{folder}"], "holds no run"),
        (["{run}", "--out", "{run}"], "is not empty"),
    ],
)
def test_a_mistake_is_one_sentence(
    run: Path, arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    filled = [word.format(run=run, folder=tmp_path) for word in arguments]
    assert main(["map", *filled]) == 2
    assert said in capsys.readouterr().err


def test_a_run_that_is_not_there_is_named_before_what_the_machine_lacks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)  # as where it is not installed
    assert main(["map", str(tmp_path / "nowhere")]) == 2
    error = capsys.readouterr().err
    assert "nowhere" in error and "Open3D" not in error


def test_without_open3d_a_lasers_points_are_placed_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    command = ["run", "sim:tiny", "--methods", "stereo.paper", "--max-exposures", "40", "--no-recording"]
    assert main([*command, "--out", str(out)]) == 0
    monkeypatch.setitem(sys.modules, "open3d", None)
    capsys.readouterr()
    assert main(["map", str(out), "--laser", "sim", "--no-dense"]) == 0
    assert "Open3D" in capsys.readouterr().out
    assert (out / "map" / "laser.stereo.paper.ply").stat().st_size > 1000
    assert "rmse_m" not in json.loads((out / "map" / "map.json").read_text())["laser"]["stereo.paper"]
    assert main(["map", str(out)]) == 2
    assert "Open3D" in capsys.readouterr().err
