"""A live camera: its images come as they are sent, can be read again, and whatever ends it is told in one sentence."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence, spool
from ispom.sequences.address import without_secrets
from ispom.sequences.formats import live
from ispom.types import Image, Sequence, is_video
from tests.sequences.folders import images
from tests.sequences.live_stream import streaming
from tests.sequences.own_folders import CAMERA

N = 12


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA)
    return path


def grown(sequence: Sequence) -> Sequence:
    """All that comes until it ends."""
    while sequence.grow is not None:
        sequence = sequence.grow(len(sequence), None)
    return sequence


def sent(image: Image) -> Image:
    """What is left of it after the codec."""
    decoded = cv2.imdecode(cv2.imencode(".jpg", image)[1], cv2.IMREAD_COLOR_RGB)
    return np.asarray(decoded, np.uint8)


def image_of(sequence: Sequence, i: int) -> Image:
    frame = sequence[i]
    assert is_video(frame) and frame.time_ns == sequence.times_ns[i]
    return frame.image


def test_all_that_is_sent_comes_in_order_and_stays(calibration: Path) -> None:
    made = images(N, 0)
    with streaming(made) as stream:
        sequence = grown(open_sequence(stream.url, camera=calibration))
    assert len(sequence) == N and set(sequence.kinds) == {"video"} and sequence.grow is None
    assert (np.diff(sequence.times_ns) > 0).all() and sequence.times_ns.dtype == np.int64
    assert "after 12 images" in sequence.notes[-1]
    for i in (*range(N), 3, 0):  # again, in any order, after the stream is gone
        image = image_of(sequence, i)
        assert image.shape == (64, 96, 3) and not image.flags.writeable
        assert abs(image.astype(int) - sent(made[i])).mean() < 2  # decoders round differently


def test_it_ends_after_the_requested_images(calibration: Path) -> None:
    with streaming(images(N, 0), holds=True) as stream:
        sequence = grown(open_sequence(stream.url, camera=calibration, max_exposures=5))
    assert len(sequence) == 5 and len(sequence.notes) == 1


def test_a_person_ends_it(calibration: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "SOURCE_TIMEOUT_S", 1.0)
    with streaming(images(N, 0), holds=True) as stream:
        sequence = open_sequence(stream.url, camera=calibration)
        while len(sequence) < N:
            assert sequence.grow is not None
            sequence = sequence.grow(len(sequence), None)
        assert sequence.grow is not None and len(sequence.grow(N, 0.0)) == N  # nothing new, and not over
        assert sequence.stop is not None
        sequence.stop()
        sequence = grown(sequence)
    assert len(sequence) == N and len(sequence.notes) == 1


def test_a_stream_that_stalls_is_reported_once_after_all_it_gave(
    calibration: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "SOURCE_TIMEOUT_S", 0.3)
    with streaming(images(N, 0), holds=True) as stream:
        sequence = open_sequence(stream.url, camera=calibration)
        with pytest.raises(InputError, match=r"stream.mjpg .*0.3 s after 12"):
            sequence = grown(sequence)
        while len(sequence) < N:  # the sequence of before the failure goes on to its end
            assert sequence.grow is not None
            sequence = sequence.grow(len(sequence), None)
        assert grown(sequence).grow is None


def test_the_room_on_disk_ends_it(calibration: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spool, "MAX_BYTES", 7 * 96 * 64 * 3 + 5)
    with streaming(images(N, 0), holds=True) as stream:
        sequence = grown(open_sequence(stream.url, camera=calibration))
    assert len(sequence) == 7 and "after 7 images" in sequence.notes[-1]


def test_an_address_that_cannot_be_opened(calibration: Path) -> None:
    with streaming([]) as stream:
        missing = stream.url.replace("stream", "nothing")
        with pytest.raises(InputError, match=r"nothing.mjpg cannot be opened"):
            open_sequence(missing, camera=calibration)
    with pytest.raises(InputError, match="cannot be opened"):
        open_sequence(stream.url, camera=calibration)
    with pytest.raises(InputError, match=r"^rtsp://127.0.0.1:9/x "):
        open_sequence("rtsp://me:secret@127.0.0.1:9/x", camera=calibration)


def test_a_stream_of_too_few_images(calibration: Path) -> None:
    with streaming(images(2, 0)) as stream, pytest.raises(InputError, match=r"ended after 2 images"):
        open_sequence(stream.url, camera=calibration)


def test_images_of_another_size_than_the_calibration(calibration: Path) -> None:
    made = [image[:48, :80] for image in images(4, 0)]
    with streaming(made) as stream, pytest.raises(InputError, match=r"80 x 48, not 96 x 64"):
        open_sequence(stream.url, camera=calibration)


def test_without_a_calibration() -> None:
    with pytest.raises(InputError, match=r"camera:0 .*--camera FILE"):
        open_sequence("camera:0")


def test_a_device_that_is_not_there(calibration: Path) -> None:
    with pytest.raises(InputError, match=r"camera:977 .*/dev/video977"):
        open_sequence("camera:977", camera=calibration)


def test_a_device_is_set_to_the_size_of_its_calibration(
    calibration: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings_of_device: list[tuple[object, ...]] = []

    class Device:
        """Stands in for cv2.VideoCapture of a device."""

        def __init__(self, *arguments: object) -> None:
            self.made = iter(images(4, 0))
            settings_of_device.append(arguments)

        def isOpened(self) -> bool:
            return True

        def set(self, *values: object) -> None:
            settings_of_device.append(values)

        def read(self) -> tuple[bool, Image | None]:
            image = next(self.made, None)
            return image is not None, image

        def release(self) -> None:
            settings_of_device.append(("release",))

    device = tmp_path / "video0"
    device.touch()
    monkeypatch.setattr(cv2, "VideoCapture", Device)
    sequence = grown(open_sequence(f"camera:{device}", camera=calibration))
    size = [(cv2.CAP_PROP_FRAME_WIDTH, 96), (cv2.CAP_PROP_FRAME_HEIGHT, 64)]
    assert settings_of_device == [(str(device), cv2.CAP_V4L2), *size, ("release",)] and len(sequence) == 4


def test_another_kind_of_source_takes_no_calibration(calibration: Path) -> None:
    with pytest.raises(InputError, match=r"sim:tiny .*own calibration"):
        open_sequence("sim:tiny", camera=calibration)


@pytest.mark.parametrize(
    ("source", "shown"),
    [
        ("rtsp://me:pass@cam.local/1", "rtsp://cam.local/1"),
        ("rtsp://me:p@ss/word@cam.local/1", "rtsp://cam.local/1"),
        ("RTSP://me:pass@cam.local/1", "RTSP://cam.local/1"),
        ("http://cam.local/video.cgi?user=me&password=secret", "http://cam.local/video.cgi?…"),
        ("http://token@cam.local/1?x=a@b", "http://cam.local/1?…"),
        ("http://cam.local/live@2", "http://cam.local/live@2"),
        ("/data/a@b", "/data/a@b"),
    ],
)
def test_passwords_are_not_shown(source: str, shown: str) -> None:
    assert without_secrets(source) == shown


@pytest.mark.parametrize("address", ["gopher://me:secret@cam.local/1", "FTP://me:secret@cam.local/1"])
def test_an_address_of_no_known_kind_is_refused_without_its_password(address: str, calibration: Path) -> None:
    with pytest.raises(InputError, match="address of a stream") as caught:
        open_sequence(address, camera=calibration)
    assert "secret" not in str(caught.value)


def test_a_clock_that_is_set_back_changes_no_interval(calibration: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Decoding an image takes more than a microsecond; a clock set back left gaps of a nanosecond, then a leap."""
    backwards = iter(range(2_000_000_000_000_000_000, 0, -1_000_000_000))
    monkeypatch.setattr(live.time, "time_ns", lambda: next(backwards))
    with streaming(images(N, 0)) as stream:
        sequence = grown(open_sequence(stream.url, camera=calibration))
    assert (np.diff(sequence.times_ns) > 1000).all()
    assert abs(int(sequence.times_ns[0]) - 2_000_000_000_000_000_000) < 60 * 10**9
