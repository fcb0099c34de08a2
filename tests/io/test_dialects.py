"""Calibrations of other programs: each dialect's example is read right, by it alone, and damaged files are refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import NOMINAL_RATE
from ispom.io.calibrations.dialects import dialects, modules, recognised
from ispom.io.calibrations.files import Format, camera_text, rig_files
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.sequences import open_sequence
from ispom.types import Camera, Rig
from tests.io.dialect_examples import CAMERA, EXAMPLES, NAMED, PLAIN, Example, mutations

IDS = [f"{each.dialect}-{each.name}" for each in EXAMPLES]
DAMAGED = 30


def written(folder: Path, example: Example) -> Path:
    for name, content in ((example.name, example.content), *example.beside):
        (folder / name).write_bytes(content)
    return folder / example.name


def assert_alike(camera: Camera | None, expected: Camera) -> None:
    """To 1e-6 px, whatever zeros stand at the end of the distortion."""
    assert camera is not None
    assert (camera.width, camera.height, camera.lens) == (expected.width, expected.height, expected.lens)
    np.testing.assert_allclose(camera.matrix, expected.matrix, atol=1e-6)
    full = [[*each.distortion, *(0.0,) * 8][:8] for each in (camera, expected)]
    np.testing.assert_allclose(*full, atol=1e-9)


def place_of_right(rig: Rig) -> Pose:
    return rig.rig_from_left.inverse() @ rig.rig_from_right


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_an_example_is_read_right(example: Example, tmp_path: Path) -> None:
    path = written(tmp_path, example)
    size = (example.expected.width, example.expected.height)
    rig, notes = one_rig((path,), size=(lambda: size) if example.image_size else None)
    if example.left_from_right is None:
        assert_alike(rig.video, example.expected)
        camera, entries, _ = one_camera(path, lambda: size)
        assert_alike(camera, example.expected)
        assert entries.get(NOMINAL_RATE) == example.rate_hz
    else:
        assert_alike(rig.left, example.expected)
        np.testing.assert_allclose(place_of_right(rig).matrix, example.left_from_right.matrix, atol=2e-6)
    assert all(str(path.parent) in note for note in notes)


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_an_example_is_recognised_by_its_dialect_alone(example: Example, tmp_path: Path) -> None:
    content = Content.of(written(tmp_path, example))
    found = recognised(content)
    assert found is not None and found.name == example.dialect
    others = [each.name for each in dialects() if each.order == found.order and each.recognises(content)]
    assert others == [example.dialect]


def test_each_dialect_has_an_example_and_says_its_conventions() -> None:
    assert {each.dialect for each in EXAMPLES} == {each.name for each in dialects()}
    for name, module in modules().items():
        words = " ".join((module.__doc__ or "").split())
        assert "(0, 0)" in words and "Source: " in words, name


CAMERAS = st.builds(
    lambda width, shape, focal, aspect, cx, cy, distortion, lens: Camera(
        width, round(width * shape), focal * width, focal * width * aspect, cx * width, cy * width * shape,
        tuple(distortion), lens,
    ),
    st.integers(64, 4000), st.floats(0.5, 1.2), st.floats(0.7, 2), st.floats(0.9, 1.1), st.floats(0.45, 0.55),
    st.floats(0.45, 0.55), st.lists(st.floats(-0.01, 0.01), min_size=4, max_size=4),
    st.sampled_from(["opencv", "fisheye"]),
)  # fmt: skip


@settings(max_examples=10, deadline=None)
@given(camera=CAMERAS)
@pytest.mark.parametrize("form", ["camera", "kalibr", "euroc", "opencv", "ros", "colmap"])
def test_what_is_written_of_any_camera_is_read_back(
    form: Format, camera: Camera, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("camera")
    for name, text in rig_files(Rig.single(camera), form).items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        assert_alike(one_camera(path)[0], camera)


@settings(max_examples=10, deadline=None)
@given(camera=CAMERAS)
def test_what_pycolmap_writes_is_read(camera: Camera, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Text and binary: pixels of both are the same, for a fisheye, too."""
    pycolmap = pytest.importorskip("pycolmap")
    folder = tmp_path_factory.mktemp("colmap")
    model = "OPENCV_FISHEYE" if camera.lens == "fisheye" else "OPENCV"
    params = [camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5, *camera.distortion]
    theirs = pycolmap.Camera(model=model, width=camera.width, height=camera.height, params=params, camera_id=1)
    reconstruction = pycolmap.Reconstruction()
    reconstruction.add_camera(theirs)
    reconstruction.write_text(str(folder))
    assert_alike(one_camera(folder / "cameras.txt")[0], camera)
    reconstruction.write_binary(str(folder))
    found = one_camera(folder)[0]  # the binary file comes first
    assert_alike(found, camera)
    seen = np.array([[0.1, -0.2, 1.0], [-0.3, 0.1, 1.0]])
    np.testing.assert_allclose(found.project(seen), np.asarray(theirs.img_from_cam(seen)) - 0.5, atol=1e-6)


@pytest.mark.parametrize("factor", [2, 3, 0.5])
def test_a_calibration_of_another_size_is_offered_scaled(factor: float, tmp_path: Path) -> None:
    folder = tmp_path / "images"
    folder.mkdir()
    for n in range(4):
        cv2.imwrite(str(folder / f"{n:03d}.png"), np.full((240, 320), 40 * n, np.uint8))
    (tmp_path / "camera.yaml").write_text(camera_text(CAMERA.scaled(factor)))
    with pytest.raises(InputError, match=r"same shape.*--scale-calibration"):
        open_sequence(str(folder))
    opened = open_sequence(str(folder), scale_calibration=True)
    assert_alike(opened.rig.video, CAMERA)
    assert any("scaled by" in note for note in opened.notes)


def test_the_images_of_a_rig_are_offered_scaled(tmp_path: Path) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for n in range(4):
            cv2.imwrite(str(tmp_path / side / f"{n:03d}.png"), np.full((240, 320), 40 * n, np.uint8))
    path = tmp_path / "rig.yaml"
    path.write_text(next(each for each in EXAMPLES if each.dialect == "ispom_rig").content.decode())
    with pytest.raises(InputError, match=r"halve it .*--scale-calibration"):
        open_sequence(str(tmp_path))
    opened = open_sequence(str(tmp_path), scale_calibration=True)
    assert (opened.rig.camera("left").fx, opened.rig.camera("left").cx) == (230, 159.5)


def test_the_rate_of_settings_counts_where_images_have_no_times(tmp_path: Path) -> None:
    example = next(each for each in EXAMPLES if each.rate_hz == 30 and each.name == "mono.yaml")
    path = written(tmp_path, example)
    for folder, name, step in (("numbers", "{:03d}.png", 33_333_333), ("stamps", "{}.png", 50_000_000)):
        (tmp_path / folder).mkdir()
        for n in range(4):
            stamp = n if folder == "numbers" else 1_520_530_308_199_447_626 + step * n
            cv2.imwrite(str(tmp_path / folder / name.format(stamp)), np.full((240, 320), 40 * n, np.uint8))
        times = open_sequence(str(tmp_path / folder), camera=path).times_ns
        assert abs(int(times[1] - times[0]) - step) <= 1


def test_the_size_of_a_file_without_one_is_an_option_of_convert(tmp_path: Path) -> None:
    path, out = tmp_path / "K.txt", tmp_path / "rig.yaml"
    path.write_text("226.0 0 160.9\n0 227.5 118.3\n0 0 1\n")
    assert main(["calibrate", "convert", str(path), "--out", str(out)]) == 2
    assert main(["calibrate", "convert", str(path), "--out", str(out), "--image-size", "320"]) == 2
    assert main(["calibrate", "convert", str(path), "--out", str(out), "--image-size", "320x240"]) == 0
    assert_alike(one_camera(out)[0], PLAIN)


@pytest.mark.parametrize(("dialect", "name", "content", "word"), NAMED, ids=[f"{d}-{n}" for d, n, _, _ in NAMED])
def test_what_cannot_be_read_is_named(dialect: str, name: str, content: bytes, word: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    found = recognised(Content.of(path))
    assert found is not None and found.name == dialect
    with pytest.raises(InputError) as caught:
        one_rig((path,), size=lambda: (320, 240))
    assert word in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize("example", EXAMPLES, ids=IDS)
def test_a_damaged_file_is_read_or_refused_in_one_sentence(example: Example, tmp_path: Path) -> None:
    path = written(tmp_path, example)
    for n, content in enumerate(mutations(example.content, DAMAGED, seed=len(example.name))):
        path.write_bytes(content)
        try:
            one_rig((path,), size=lambda: (320, 240))
        except InputError as fault:
            assert "\n" not in str(fault), n


def test_what_is_not_recognised_says_what_was_looked_for(tmp_path: Path) -> None:
    for name, text, word in (
        ("a.yaml", "speed: 3\n", "Camera.fx"),
        ("a.json", '{"a": 1}', "cameraData"),
        ("a.txt", "hello\n", "[STEREO]"),
    ):
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(InputError, match="no calibration") as caught:
            one_camera(path)
        assert word in caught.value.args[0]


def test_a_file_of_a_pair_says_how_many_cameras_it_has(tmp_path: Path) -> None:
    example = next(each for each in EXAMPLES if each.name == "rectified.yaml")
    with pytest.raises(InputError, match=r"2 cameras \(left, right\)"):
        one_camera(written(tmp_path, example))
