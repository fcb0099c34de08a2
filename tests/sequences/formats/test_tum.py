"""TUM style folders: images in colour, truth at the images' times, and what is wrong named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.types import is_video
from tests.sequences.folders import make_tum


def test_video_in_colour_with_the_truth_at_its_times(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_tum(tmp_path / "desk")))
    assert sequence.name == "TUM desk" and set(sequence.kinds) == {"video"} and sequence.rig.video.distortion
    frame = sequence[1]
    assert is_video(frame) and frame.image.ndim == 3
    assert frame.image[..., 0].mean() + frame.image[..., 2].mean() == pytest.approx(255, abs=2)  # red is 255 - blue
    # The truth starts after the first image; it moves by 1 m/s along x.
    np.testing.assert_array_equal(sequence.truth.times_ns, sequence.times_ns[1:])
    np.testing.assert_allclose(sequence.truth.translations[:, 0], sequence.times_ns[1:] * 1e-9, atol=1e-9)


def test_truth_is_not_interpolated_over_a_gap(tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    rows = (folder / "groundtruth.txt").read_text().splitlines()
    (folder / "groundtruth.txt").write_text("\n".join(rows[:4] + rows[15:]))
    assert open_sequence(str(folder)).truth.times_ns.tolist() == [33_333_000, 166_667_000]


def test_entries_of_a_camera_that_are_not_known_are_reported(tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    assert not any("skipped" in note for note in open_sequence(str(folder)).notes)
    camera = folder / "camera.yaml"
    camera.write_text(camera.read_text().replace("distortion", "distorsion"))
    assert any(note.startswith(f"{camera}: distorsion skipped") for note in open_sequence(str(folder)).notes)


def test_listed_images_that_are_not_there_are_left_out_and_reported(tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    (folder / "rgb" / "2.jpg").unlink()
    sequence = open_sequence(str(folder))
    assert len(sequence) == 5 and "1 of 6 images that" in sequence.notes[0]
    for path in (folder / "rgb").iterdir():
        path.unlink()
    with pytest.raises(InputError, match=r"0.jpg is missing.*rgb.txt"):
        open_sequence(str(folder))


def test_a_byte_order_mark_is_no_mistake_and_another_encoding_one(tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    listing = folder / "rgb.txt"
    lines = listing.read_bytes()
    listing.write_bytes(b"\xef\xbb\xbf" + lines)
    assert len(open_sequence(str(folder))) == 6
    listing.write_bytes(lines.replace(b"rgb/2", b"\xe9/2"))
    with pytest.raises(InputError, match=r"rgb.txt line 4: .*UTF-8"):
        open_sequence(str(folder))


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("camera.yaml", "model: omni", "model is omni"),
        ("camera.yaml", "just words", "is no calibration that is known"),
        ("rgb.txt", "# nothing", "lists no image"),
        ("rgb.txt", "0.0 a.png\n0.0 b.png", "line 2: time 0.0.* is not after"),
        ("groundtruth.txt", "0 1 2 3", "line 1 has 4 columns"),
    ],
)
def test_a_mistake_is_named(file: str, text: str | None, message: str, tmp_path: Path) -> None:
    folder = make_tum(tmp_path)
    (folder / file).unlink() if text is None else (folder / file).write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(str(folder))
    assert str(folder / file) in str(caught.value)
