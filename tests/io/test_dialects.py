"""Calibrations of other programs: each dialect's example is read right, by it alone, and damaged files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import NOMINAL_RATE
from ispom.io.calibrations.dialects import dialects, recognised
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.types import Camera, Rig
from tests.io.dialect_examples import EXAMPLES, NAMED, Example, mutations

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
        with pytest.raises(InputError, match="is no calibration that is known") as caught:
            one_camera(path)
        assert word in caught.value.args[0]


def test_a_file_of_a_pair_says_how_many_cameras_it_has(tmp_path: Path) -> None:
    example = next(each for each in EXAMPLES if each.name == "rectified.yaml")
    with pytest.raises(InputError, match=r"holds 2 cameras \(left, right\)"):
        one_camera(written(tmp_path, example))
