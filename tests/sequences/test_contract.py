"""Every kind of recording, opened by its path, keeps the contract of a sequence."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.sequences import open_sequence
from ispom.types import Camera, Image, Sequence, images_of, is_stereo, is_video
from tests.sequences import bag_folders, car_folders, folders, own_folders

MAKERS = {**folders.MAKERS, **car_folders.CARS, **own_folders.OWN, **bag_folders.BAGS}


@pytest.fixture(params=MAKERS)
def path(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    return str(MAKERS[request.param](tmp_path / "made"))


def test_times_are_ordered_and_each_has_a_kind(path: str) -> None:
    sequence = open_sequence(path)
    assert sequence.times_ns.dtype == np.int64 and sequence.name
    assert (np.diff(sequence.times_ns) >= 0).all()
    assert len(sequence.kinds) == len(sequence) and all(sequence.rig.has(kind) for kind in set(sequence.kinds))
    for kind in ("video", "stereo"):
        assert (np.diff(sequence.times_ns[np.array(sequence.kinds) == kind]) > 0).all()
    assert (sequence.rig.has_stereo, sequence.rig.video is not None) == tuple(
        kind in sequence.kinds for kind in ("stereo", "video")
    )


def test_what_is_loaded_is_what_was_announced(path: str) -> None:
    sequence = open_sequence(path)
    for i, kind in enumerate(sequence.kinds):
        exposure = sequence[i]
        assert exposure.time_ns == sequence.times_ns[i]
        if is_video(exposure):
            assert kind == "video"
            fits(exposure.image, sequence.rig.video)
        elif not images_of(exposure):
            assert exposure.kind == kind and sequence.rig.has(kind)
        else:
            assert is_stereo(exposure) and kind == "stereo"
            fits(exposure.left, sequence.rig.left)
            fits(exposure.right, sequence.rig.right)


def fits(image: Image, camera: Camera | None) -> None:
    assert camera is not None and image.dtype == np.uint8 and not image.flags.writeable
    assert image.shape[:2] == (camera.height, camera.width) and image.shape[2:] in ((), (3,))


def test_the_truth_is_of_the_rig_and_inside(path: str) -> None:
    sequence = open_sequence(path)
    if sequence.truth is None:
        return
    truth = sequence.truth
    assert truth.frame == "rig" and len(truth) and (np.diff(truth.times_ns) > 0).all()
    assert sequence.times_ns[0] <= truth.times_ns[0] and truth.times_ns[-1] <= sequence.times_ns[-1]
    identities = truth.rotations @ truth.rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(identities, np.tile(np.eye(3), (len(truth), 1, 1)), atol=1e-9)


def test_any_order_gives_the_same_images(path: str) -> None:
    first, second = open_sequence(path), open_sequence(path)
    forward = [content(first, i) for i in range(len(first))]
    assert [content(second, i) for i in reversed(range(len(second)))] == forward[::-1]


def content(sequence: Sequence, i: int) -> bytes:
    exposure = sequence[i]
    return b"".join(image.tobytes() for _, image in sorted(images_of(exposure).items()))


def test_opening_decodes_the_first_images_at_most(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """To find the size, and to see that a run can begin."""
    decoded, imdecode = [], cv2.imdecode

    def counted(*arguments):
        decoded.append(arguments)
        return imdecode(*arguments)

    monkeypatch.setattr(cv2, "imdecode", counted)
    open_sequence(path)
    assert len(decoded) <= 3
