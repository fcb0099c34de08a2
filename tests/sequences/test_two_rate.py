"""two_rate: which image plays which camera, in which order, read how often."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences.formats.kitti import open_kitti
from ispom.sequences.two_rate import two_rate
from ispom.types import Image, is_stereo, is_video
from tests.sequences.kitti_folder import HEIGHT, WIDTH, make_drive


def test_every_left_image_is_video_and_some_pairs_are_stereo(tmp_path: Path) -> None:
    recording = open_kitti(make_drive(tmp_path))
    sequence = two_rate(recording, stereo_every=4, video_scale=0.5)
    assert sequence.kinds == ("stereo", *["video"] * 4, "stereo", *["video"] * 2)
    assert (np.diff(sequence.times_ns) >= 0).all()
    pair, frame = sequence[5], sequence[6]
    assert is_stereo(pair) and is_video(frame)
    assert pair.time_ns == frame.time_ns == recording.times_ns[4]
    assert pair.left.shape == (HEIGHT, WIDTH)
    expected = cv2.resize(recording.read("left", 4), (WIDTH // 2, HEIGHT // 2), interpolation=cv2.INTER_AREA)
    np.testing.assert_array_equal(frame.image, expected)
    assert "Emulated" in sequence.notes[0] and "one pair in 4" in sequence.notes[0]


def test_the_video_camera_sits_in_the_left_one(tmp_path: Path) -> None:
    rig = two_rate(open_kitti(make_drive(tmp_path)), video_scale=0.5).rig
    np.testing.assert_array_equal(rig.rig_from_video.matrix, rig.rig_from_left.matrix)
    assert rig.video is not None and rig.left is not None
    assert rig.video == rig.left.scaled(0.5)


def test_no_image_is_decoded_twice_in_a_row(tmp_path: Path) -> None:
    recording, read = open_kitti(make_drive(tmp_path)), []

    def counted(side, i: int) -> Image:
        read.append((side, i))
        return recording.read(side, i)

    sequence = two_rate(replace(recording, read=counted), stereo_every=2)
    for i in range(len(sequence)):
        sequence[i]
    assert read.count(("left", 2)) == 1 and len(read) == 6 + 3


@pytest.mark.parametrize(
    ("options", "flag"), [((0, 1.0), "--stereo-every"), ((1, 0.0), "--video-scale"), ((1, 2.0), "--video-scale")]
)
def test_options_out_of_range(options: tuple[int, float], flag: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=flag):
        two_rate(open_kitti(make_drive(tmp_path)), *options)
