"""Nothing that a program answers is trusted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ispom.estimators.program.pipe import ProgramFault
from ispom.estimators.program.protocol import read_step
from ispom.types import Camera, Check, Status, Step, Tracks, TrackStatus

CAMERAS = {"video": Camera(320, 240, 230.0, 230.0, 159.5, 119.5)}
CHECKS = {"inliers": Check("inliers", "tracks that agree", "requirement")}
POSE = {"translation": [1, 2.5, 3], "rotation_xyzw": [0, 0, 0, 1]}
INLIERS = {"key": "inliers", "value": 12, "threshold": 10}
BEFORE = {"video": Tracks.of(np.array([4, 7]), np.array([[1, 2], [3, 4]]))}


def read(**parts: Any) -> Step:
    answer = {"status": "tracking", "pose": POSE, **parts}
    return read_step(answer, 5, CHECKS, CAMERAS, BEFORE, {"video": 8})


def tracked(**parts: Any) -> Any:
    return {"tracks": {"video": {"ids": [4], "uv": [[1.5, 2]], **parts}}}


def test_a_whole_answer() -> None:
    step = read(key_frame=True, checks=[INLIERS], **tracked(ids=[4, 9], uv=[[1.5, 2], [8, 9]], ended={"7": "epipolar"}))
    assert step.status is Status.TRACKING and step.key_frame and step.decisions[0].passed
    assert step.world_from_frame is not None and step.world_from_frame.translation.tolist() == [1, 2.5, 3]
    tracks = step.tracks["video"]
    assert tracks.ids.tolist() == [4, 9, 7]
    assert tracks.status.tolist() == [TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.EPIPOLAR]
    assert tracks.uv.tolist() == [[1.5, 2], [8, 9], [3, 4]]
    np.testing.assert_equal(tracks.uv_prev, np.array([[1, 2], [np.nan, np.nan], [3, 4]], np.float32))


def test_tracks_that_are_not_named_any_more_are_lost() -> None:
    assert read().tracks["video"].status.tolist() == [TrackStatus.LOST] * 2


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ({"status": "fine"}, "status 'fine', not one of"),
        ({"status": ["lost"]}, "not one of"),
        ({"pose": None}, "tracks, but with no pose"),
        ({"pose": {**POSE, "translation": [1, 2]}}, "not a list of 3"),
        ({"pose": {**POSE, "translation": [1, 2, "3"]}}, "'3', not a finite number"),
        ({"pose": {**POSE, "translation": [1, 2, True]}}, "True, not a finite number"),
        ({"pose": {**POSE, "translation": [1, 2, float("inf")]}}, "inf, not a finite number"),
        ({"pose": {**POSE, "translation": [1, 2, 10**400]}}, "not a finite number"),
        ({"pose": {**POSE, "translation": [1, 2, 1e12]}}, "not within"),
        ({"pose": {**POSE, "rotation_xyzw": [0, 0, 0, 0]}}, "not of length 1"),
        ({"pose": {**POSE, "rotation_xyzw": [1e200, 0, 0, 0]}}, "not of length 1"),
        ({"pose": {**POSE, "scale": 2}}, "'scale', which a pose does not have"),
        ({"poze": POSE}, "'poze', which an answer does not have"),
        ({"key_frame": 1}, "key_frame 1, not true or false"),
        ({"tracks": []}, "tracks \\[\\], not an object"),
        ({"tracks": {"left": {}}}, "'left', which the frame does not have"),
        (tracked(ids=[4, 4], uv=[[1, 2], [1, 2]]), "ids that are not unique"),
        (tracked(ids=[4.5]), "4.5, not an integer"),
        (tracked(ids=[-1]), "-1, not an integer"),
        (tracked(ids=[2**53 + 1]), "not an integer"),
        (tracked(ids=[4, 7]), "not a list of 2"),
        (tracked(ids=list(range(20_001))), "not a list of at most 20000"),
        (tracked(uv=[[1]]), "not a list of 2"),
        (tracked(uv=[[320, 2]]), "outside of its image"),
        (tracked(uv=[[1, -1]]), "outside of its image"),
        (tracked(uv=[[1e300, 1]]), "outside of its image"),
        (tracked(uv=[[1, -1e308]]), "outside of its image"),
        ({"pose": {**POSE, "translation": [1, 2, -1e308]}}, "not within"),
        ({"pose": {**POSE, "rotation_xyzw": [1e308, -1e308, 1e-320, 0]}}, "not of length 1"),
        (tracked(ids=[5]), "the track 5 in tracks.video, which ended before"),
        (tracked(ended={"4": "lost"}), "'4', which is no track that ends here"),
        (tracked(ended={"7": "alive"}), "'alive', not one of"),
        ({"checks": [{**INLIERS, "key": "parallax"}]}, "'parallax', not one of 'inliers'"),
        ({"checks": [{**INLIERS, "value": None}]}, "inliers's value None, not a finite number"),
        ({"checks": [INLIERS, INLIERS]}, "'inliers' twice"),
        ({"checks": [{**INLIERS, "consequence": "a\nb"}]}, "not a text of one line"),
    ],
)
def test_what_is_wrong_is_named(parts: dict[str, Any], said: str) -> None:
    with np.errstate(all="raise", under="ignore"), pytest.raises(ProgramFault, match=said):
        read(**parts)
