"""`ispom.run` and `ispom.stepper`, as a stranger in a notebook calls them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import ispom

FRAMES = 24


@pytest.fixture(scope="module")
def sequence() -> ispom.Sequence:
    return ispom.open_sequence("sim:tiny", max_exposures=FRAMES)


@pytest.fixture(scope="module")
def run(sequence: ispom.Sequence) -> ispom.Run:
    return ispom.run(sequence, "stereo", max_tracks=300)


def test_it_is_what_the_ensemble_computes(run: ispom.Run, sequence: ispom.Sequence) -> None:
    config = ispom.Config({"stereo": ispom.method("stereo").config(max_tracks=300)})
    ensemble = ispom.build(config, ("stereo",), sequence.rig)
    state, steps = ensemble.start(), []
    for i in range(len(sequence)):
        state, found = ensemble.step(state, sequence[i])
        steps += found
    np.testing.assert_array_equal(run.trajectory.translations, ensemble.finish(state)["stereo"].translations)
    assert [step.inliers for step in run.steps] == [len(step.residuals_px) for step in steps]
    assert run.covariances.shape == (len(steps), 6, 6) and run.located.all()


def test_its_errors_are_those_of_the_evaluation(run: ispom.Run, sequence: ispom.Sequence) -> None:
    assert sequence.truth is not None
    found = run.evaluate()
    errors = ispom.path_errors(run.trajectory, sequence.truth, sequence.rig, metric=True)
    assert found.ate == found.measures["ate_rmse_m"] == pytest.approx(errors["ate_m"]) and found.coverage == 1
    away = run.evaluate(sequence.truth.moved(left=ispom.Pose(translation=np.array([5.0, 0, 0]))))
    assert away.ate == pytest.approx(found.ate), "worlds are aligned"


def test_a_step_is_found_by_its_frame(run: ispom.Run, sequence: ispom.Sequence) -> None:
    pair = sequence.kinds.index("stereo")
    assert run.step_at(pair).time_ns == sequence.times_ns[pair]
    with pytest.raises(ispom.InputError, match="video"):
        run.step_at(sequence.kinds.index("video"))


def test_what_is_printed_is_short_and_no_markup_of_a_stranger(run: ispom.Run, sequence: ispom.Sequence) -> None:
    things: list[Any] = [run, run.steps[0], run.trajectory, sequence, sequence[0], run.evaluate()]
    assert all(20 < len(repr(thing)) < 200 for thing in things)
    hostile = replace(run, settings={"x": "<script>"})
    assert "<script>" not in hostile._repr_html_() and "ATE" in hostile._repr_html_()
    assert "ate_rmse_m" in run.evaluate()._repr_html_()


def test_the_path_is_drawn(run: ispom.Run) -> None:
    (axes,) = run.plot().axes
    assert [line.get_label() for line in axes.lines] == ["ground truth", "stereo"]


def test_images_with_their_cameras_are_a_source(sequence: ispom.Sequence, run: ispom.Run) -> None:
    frames: list[Any] = [sequence[i] for i in range(len(sequence))]
    pairs = [(frame.left, frame.right) for frame in frames if frame.kind == "stereo"]
    found = ispom.run(pairs, "stereo", rig=sequence.rig, rate_hz=3, max_tracks=300)
    np.testing.assert_allclose(found.trajectory.translations, run.trajectory.translations, atol=0.02)
    video = [frame.image for frame in frames[:9] if frame.kind == "video"]
    assert len(ispom.run(video, "monocular", rig=sequence.rig).steps) == len(video)


def test_a_part_of_a_sequence_is_a_sequence(sequence: ispom.Sequence) -> None:
    part = sequence[4:12:2]
    assert len(part) == 4 and part.times_ns.tolist() == sequence.times_ns[4:12:2].tolist()
    assert [part[i].time_ns for i in range(4)] == part.times_ns.tolist() and sequence[-1].time_ns == sequence.times_ns[
        -1
    ]
    with pytest.raises(IndexError):
        sequence[len(sequence)]
    with pytest.raises(ValueError):
        sequence[::-1]
    assert len(sequence[:0]) == 0 and repr(sequence[:0])


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("stereoo", {}),
        (("stereo",), {}),
        ("stereo", {"tracks": 3}),
        ("stereo", {"max_tracks": -5}),
        ("stereo", {"max_tracks": "many"}),
        ("multicamera", {}),
    ],
)
def test_a_wrong_call_is_one_sentence(sequence: ispom.Sequence, name: Any, options: dict[str, Any]) -> None:
    for call in (ispom.run, ispom.stepper):
        with pytest.raises(ispom.InputError):
            call(sequence, name, **options)


def test_wrong_images_are_one_sentence(sequence: ispom.Sequence) -> None:
    good = np.zeros((sequence.rig.camera("video").height, sequence.rig.camera("video").width), np.uint8)
    for images in ([good[:10, :10]] * 3, [good.astype(float)] * 3, [(good,)] * 3, ["a.png"] * 3):
        with pytest.raises(ispom.InputError):
            ispom.run(images, "monocular", rig=sequence.rig)
    with pytest.raises(ispom.InputError, match="rig="):
        ispom.run([good] * 3, "monocular")
    with pytest.raises(ispom.InputError):
        ispom.run([good] * 3, "monocular", rig=sequence.rig, rate_hz=0)
    with pytest.raises(ispom.InputError, match="left"):
        _ = ispom.Frame.video(0, good).left


def test_a_run_without_truth_says_so(sequence: ispom.Sequence) -> None:
    good = np.zeros((sequence.rig.camera("video").height, sequence.rig.camera("video").width), np.uint8)
    lost = ispom.run([good] * 3, "monocular", rig=sequence.rig)
    with pytest.raises(ispom.InputError, match="truth"):
        lost.evaluate()
    with pytest.raises(ispom.InputError, match="3"):
        lost.evaluate(sequence.truth)
    assert "of 3" in repr(lost) and lost._repr_html_() and lost.plot()


def test_a_stepper_stops_goes_back_and_forks(sequence: ispom.Sequence, run: ispom.Run) -> None:
    walk = ispom.stepper(sequence, "stereo", window=1, max_tracks=300)
    first = [next(walk), next(walk)]
    assert [step.inliers for step in first] == [step.inliers for step in run.steps[:2]]
    at = walk.frame
    walk.back()
    again = next(walk)
    assert again.inliers == first[1].inliers and walk.frame == at
    with pytest.raises(ispom.InputError):
        walk.back(2)
    rest = list(walk)
    assert [step.inliers for step in (*first, *rest)] == [step.inliers for step in run.steps]
    np.testing.assert_array_equal(walk.trajectory.translations, run.trajectory.translations)
    other = ispom.stepper(sequence, "stereo", max_tracks=300).fork(max_tracks=100)
    assert other.settings == {"max_tracks": 100} and next(other).status and next(other).inliers < first[1].inliers
    assert "max" not in repr(walk) and len(repr(walk)) < 200
    with pytest.raises(ispom.InputError):
        ispom.stepper(sequence, "stereo", window=-1)


MISTAKES: dict[str, Any] = {
    "0": lambda s: ispom.run(s, "stereo", frames=0),
    "-3": lambda s: ispom.run(s, "stereo", frames=-3),
    "2.5": lambda s: ispom.run(s, "stereo", frames=2.5),  # type: ignore[arg-type]
    "None": lambda s: ispom.run(None, "stereo"),  # type: ignore[arg-type]
    r"\[\]": lambda s: ispom.run([], "stereo", rig=s.rig),
    "str": lambda s: ispom.run([np.zeros((9, 9), np.uint8)], "monocular", rig="kitti"),  # type: ignore[arg-type]
    "video": lambda s: ispom.run([np.zeros((240, 320), np.uint8)] * 3, "stereo", rig=s.rig),
    "name": lambda s: ispom.run(s, ispom.method("stereo")),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("named", MISTAKES)
def test_a_wrong_argument_is_named(named: str, sequence: ispom.Sequence) -> None:
    with pytest.raises(ispom.InputError, match=named):
        MISTAKES[named](sequence)


def test_other_objects_are_printed_short_too(run: ispom.Run, sequence: ispom.Sequence) -> None:
    step = run.steps[-1]
    things: list[Any] = [run.rig, ispom.method("stereo"), step.tracks["left"], step.landmarks]
    assert all(10 < len(repr(thing)) < 200 for thing in things)


def test_the_truth_may_be_a_file_and_nothing_else(run: ispom.Run, tmp_path: Path) -> None:
    assert run.truth is not None
    file = tmp_path / "truth.txt"
    rows = np.hstack([run.truth.times_ns[:, None] * 1e-9, run.truth.translations, run.truth.xyzw])
    np.savetxt(file, rows, fmt="%.9f")
    assert run.evaluate(file).ate == pytest.approx(run.evaluate().ate, rel=1e-3)
    with pytest.raises(ispom.InputError, match="int"):
        run.evaluate(5)  # type: ignore[arg-type]
    with pytest.raises(ispom.InputError, match="500"):
        run.step_at(500)
    assert run.trajectory[0].translation.shape == (3,) and len(run.trajectory[1:3]) == 2


def test_a_film_without_calibration_runs_with_the_camera_that_its_images_give(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The estimate itself has tests of its own; this one stands in for it."""

    def estimated(film: ispom.Sequence) -> ispom.Sequence:
        return replace(film, rig=ispom.Rig.single(replace(film.rig.camera("video"), fx=123.0)), guess=None)

    monkeypatch.setattr("ispom.calibration.tracked.self_calibration.self_calibrated", estimated)
    sequence = ispom.open_sequence("sim:tiny")
    for k in [k for k, kind in enumerate(sequence.kinds) if kind == "video"][:8]:
        cv2.imwrite(str(tmp_path / f"{k:03}.png"), sequence[k].images["video"])
    assert ispom.open_sequence(str(tmp_path)).rig.camera("video").fx != 123
    assert ispom.run(str(tmp_path), "monocular", frames=3).rig.camera("video").fx == 123
    assert ispom.stepper(str(tmp_path), "monocular").sequence.rig.camera("video").fx == 123


def test_a_stepper_gives_the_steps_of_its_method_and_not_those_it_depends_on(sequence: ispom.Sequence) -> None:
    found, run = list(ispom.stepper(sequence, "integrated")), ispom.run(sequence, "integrated")
    assert {step.method for step in found} == {"integrated"}
    assert [step.time_ns for step in found] == [step.time_ns for step in run.steps]
