"""7-Scenes style folders: colour images and their poses by number, and what is wrong named."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.formats.seven_scenes import PUBLISHED
from ispom.types import is_video
from tests.sequences.folders import make_seven_scenes


def test_colour_images_with_the_truth_of_their_number(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_seven_scenes(tmp_path)))
    assert sequence.name == "7-Scenes chess seq-01" and len(sequence) == 6 and sequence.rig.video.fx == 80
    frame = sequence[1]
    assert is_video(frame) and frame.image.ndim == 3
    np.testing.assert_allclose(sequence.truth.translations[:, 0], np.arange(6) / 10, atol=1e-9)
    np.testing.assert_array_equal(sequence.truth.times_ns, sequence.times_ns)
    assert "30 images per second" in sequence.notes[-1]


def test_a_missing_number_is_a_gap_in_time(tmp_path: Path) -> None:
    folder = make_seven_scenes(tmp_path)
    (folder / "frame-000002.color.png").unlink()
    times_ns = open_sequence(str(folder)).times_ns
    assert np.rint(times_ns * 30e-9).tolist() == [0, 1, 3, 4, 5]


def test_poses_that_the_tracker_lost_are_left_out_and_reported(tmp_path: Path) -> None:
    folder = make_seven_scenes(tmp_path)
    (folder / "frame-000001.pose.txt").write_text("-1.#IND 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    (folder / "frame-000004.pose.txt").unlink()
    sequence = open_sequence(str(folder))
    assert len(sequence.truth) == 4 and any("2 of 6 images" in note for note in sequence.notes)


def test_without_poses_there_is_no_truth(tmp_path: Path) -> None:
    assert open_sequence(str(make_seven_scenes(tmp_path, truth=False))).truth is None


def test_without_a_calibration_that_of_the_data_set_counts(tmp_path: Path) -> None:
    folder = make_seven_scenes(tmp_path)
    (folder.parent / "camera.yaml").unlink()
    with pytest.raises(InputError, match="96 x 64, not 640 x 480"):
        open_sequence(str(folder))
    for image in folder.glob("*.color.png"):
        cv2.imwrite(str(image), np.zeros((480, 640), np.uint8))
    sequence = open_sequence(str(folder))
    assert sequence.rig.video == PUBLISHED and any("585 px" in note for note in sequence.notes)


def test_another_calibration_takes_the_place_of_its_own(tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    other.write_text("{width: 96, height: 64, fx: 70, fy: 70, cx: 47.5, cy: 31.5, rate_hz: 10}")
    sequence = open_sequence(str(make_seven_scenes(tmp_path)), camera=other)
    assert sequence.rig.video.fx == 70 and sequence.times_ns[1] == 100_000_000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 0 0 0\n0 1 0 0\n0 0 1 0\n", "has 3 rows, not 4"),
        ("1 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "line 1 has 3 columns"),
        ("1 0 0 0\n0 x 0 0\n0 0 1 0\n0 0 0 1\n", "line 2: 'x' is not a finite number"),
        ("0 1 0 0\n1 0 0 0\n0 0 1 0\n0 0 0 1\n", "not a rotation"),
        ("", "has 0 rows"),
    ],
)
def test_a_mistake_is_named(text: str, message: str, tmp_path: Path) -> None:
    folder = make_seven_scenes(tmp_path)
    path = folder / "frame-000003.pose.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(str(folder))
    assert str(path) in str(caught.value)


def test_a_damaged_image(tmp_path: Path) -> None:
    folder = make_seven_scenes(tmp_path)
    (folder / "frame-000003.color.png").write_bytes(
        cv2.imencode(".png", np.zeros((64, 96), np.uint8))[1].tobytes()[:50]
    )
    with pytest.raises(InputError, match=r"frame-000003.color.png"):
        open_sequence(str(folder))[3]
