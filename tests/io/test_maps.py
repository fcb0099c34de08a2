"""landmarks.npz: read back as written; damaged files are told."""

import tracemalloc
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.io.maps import SceneMap, map_bytes, read_maps
from ispom.types import Landmarks, Trajectory, WorldLines
from tests import doubles


def scene(noise_px: float = 0.0, outliers: int = 0) -> SceneMap:
    """Sixty points, all seen from eight key frames of the video camera, with noise and gross mistakes."""
    rng, rig = np.random.default_rng(3), doubles.rig()
    keys = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 8 * 10**8, 10**8)])
    keys = keys.moved(right=rig.rig_from_video, frame="video")
    xyz = rng.uniform((-3, -2, 8), (3, 2, 14), (60, 3))
    rgb = rng.integers(0, 256, (60, 3), np.uint8)
    uv = np.concatenate([rig.camera("video").project(pose.inverse().apply(xyz)) for _, pose in keys.items()])
    uv += rng.normal(0, noise_px, uv.shape) if noise_px else 0
    uv[rng.choice(len(uv), outliers, replace=False)] += 20
    ids = np.arange(60) * 3
    landmarks = Landmarks(ids, xyz, rgb)
    return SceneMap(landmarks, keys, np.repeat(np.arange(8), 60), np.tile(ids, 8), uv.astype(np.float32))


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(map_bytes({"monocular": scene(), "stereo": scene()}))
    found, expected = read_maps(tmp_path / "a.npz"), scene()
    assert list(found) == ["monocular", "stereo"]
    assert found["stereo"].key_frames.frame == "video"
    np.testing.assert_array_equal(found["stereo"].key_frames.rotations, expected.key_frames.rotations)
    np.testing.assert_allclose(found["stereo"].landmarks.xyz_in_world, expected.landmarks.xyz_in_world, rtol=1e-6)
    np.testing.assert_array_equal(found["stereo"].seen_uv, expected.seen_uv)


LINES = WorldLines(
    np.array([[[0.1, 0, 3], [0.1, 2, 3]], [[-1, 0, 4], [1, 0, 4.7]], [[0, 0, 5], [0, 1, 6]]]), np.arange(3)
)


def test_lines_are_read_back_exactly_and_methods_without_have_none(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(map_bytes({"tags": replace(scene(), lines=LINES), "stereo": scene()}))
    found = read_maps(tmp_path / "a.npz")
    np.testing.assert_array_equal(found["tags"].lines.xyz_in_world, LINES.xyz_in_world)
    np.testing.assert_array_equal(found["tags"].lines.group, LINES.group)
    assert not len(found["stereo"].lines)


def test_lines_without_an_end_or_a_place_are_refused(tmp_path: Path) -> None:
    for bad in (LINES.xyz_in_world[:, :1], LINES.xyz_in_world * np.nan, LINES.xyz_in_world[:2]):
        lines = WorldLines(bad, LINES.group)
        (tmp_path / "a.npz").write_bytes(map_bytes({"tags": replace(scene(), lines=lines)}))
        with pytest.raises(InputError, match="is damaged"):
            read_maps(tmp_path / "a.npz")


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is missing"):
        read_maps(tmp_path / "a.npz")


def test_observations_of_no_key_frame_are_refused(tmp_path: Path) -> None:
    good = scene()
    bad = SceneMap(good.landmarks, good.key_frames, good.seen_from + 1, good.seen_ids, good.seen_uv)
    (tmp_path / "a.npz").write_bytes(map_bytes({"monocular": bad}))
    with pytest.raises(InputError, match="is damaged"):
        read_maps(tmp_path / "a.npz")


def peak_of_refusal(path: Path) -> int:
    """The memory that reading took [bytes]."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            read_maps(path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_small_file_that_unpacks_to_much_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", **{"monocular.ids": np.zeros(25_000_000, np.int64)})
    assert (tmp_path / "a.npz").stat().st_size < 1 << 20
    assert peak_of_refusal(tmp_path / "a.npz") < 10 << 20


@pytest.mark.parametrize("shape", ["(99999999999999,)", "(400000000,)", "(0,)"])
def test_an_array_that_claims_another_size_than_its_archive_is_refused(shape: str, tmp_path: Path) -> None:
    header = f"{{'descr': '<i8', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    with ZipFile(tmp_path / "a.npz", "w") as file:
        file.writestr(
            "monocular.ids.npy", b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header.encode() + bytes(80)
        )
    assert peak_of_refusal(tmp_path / "a.npz") < 10 << 20


@settings(max_examples=40)
@given(st.data())
def test_damaged_files_are_reported(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    content = bytearray(CONTENT[: data.draw(st.integers(0, len(CONTENT)))])
    for _ in range(data.draw(st.integers(0, 4)) if content else 0):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.npz"
    path.write_bytes(content)
    try:
        read_maps(path)
    except InputError as error:
        assert str(path) in str(error)


CONTENT = map_bytes({"monocular": scene()})
