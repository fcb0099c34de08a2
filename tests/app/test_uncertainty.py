"""Ellipsoids of poses: where, how large, drawn while a method tells a covariance, hidden as a layer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import rerun as rr
from ispom_app.engine.events import Opened, Stepped
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.features.explain.view import explain
from ispom_app.presentation import uncertainty
from ispom_app.session.state import State
from ispom_app.views.rerun import blueprint
from ispom_app.views.rerun.recorder import Recorder

from ispom.geometry import Pose, Similarity
from ispom.methods import Config
from ispom.types import Status, Step
from tests import doubles

COVARIANCE = np.diag([1e-6, 4e-6, 9e-4, 1e-6, 1e-6, 4e-6])
POSE = Pose.from_rotvec(np.array([0.3, -0.5, 0.2]), np.array([1.0, 2.0, 3.0]))


def report(state: State) -> str:
    """All that is said of the frame."""
    return repr(explain(state, None, state.index))


def test_the_ellipsoid_holds_95_percent_of_the_poses_around():
    found = uncertainty.ellipsoid(POSE, COVARIANCE)
    assert found is not None and np.isclose(np.linalg.det(found.axes), 1)
    twists = np.random.default_rng(0).multivariate_normal(np.zeros(6), COVARIANCE, 4000)
    positions = np.array([(POSE @ Pose.exp(twist)).translation for twist in twists])
    inside = np.linalg.norm((positions - found.centre) @ found.axes / found.half_sizes, axis=1) <= 1
    assert abs(inside.mean() - 0.95) < 0.012
    np.testing.assert_allclose(abs(found.axes[:, 2]), abs(POSE.rotation[:, 2]), atol=1e-12)


def test_what_is_reported_is_the_largest_of_each():
    step = Step(0, Status.TRACKING, world_from_frame=POSE, covariance=COVARIANCE, method="stereo")
    assert uncertainty.describe(step, 1.0) == "95 % confidence: 83.9 mm, 0.32° (largest axis)"
    assert uncertainty.describe(step, 10.0) == "95 % confidence: 839 mm, 0.32° (largest axis)"
    assert uncertainty.describe(replace(step, covariance=None), 1.0) == ""
    assert uncertainty.describe(replace(step, covariance=np.full((6, 6), np.inf)), 1.0) == ""


def test_it_is_drawn_while_there_is_one_and_shown_in_the_panel():
    sequence = doubles.sequence()
    recorder = Recorder(Opened(sequence, ("stereo",), Config(), None))
    step = Step(
        int(sequence.times_ns[0]), Status.TRACKING, world_from_frame=POSE, covariance=COVARIANCE, method="stereo"
    )
    logged = []
    for index, given in enumerate((step, replace(step, covariance=None), replace(step, covariance=None))):
        event = Stepped(index, sequence[index], (given,), {"stereo": Similarity()}, {})
        entries = {entry.path: entry.value for entry in recorder.batch(event).entries if hasattr(entry, "value")}
        logged.append(entries.get("world/stereo/uncertainty"))
        assert (
            "95 % confidence" in report(State("", methods=("stereo",), displayed=ExposureRecord.of(event, None)))
        ) == (index == 0)
    assert isinstance(logged[0], rr.Ellipsoids3D) and isinstance(logged[1], rr.Clear) and logged[2] is None


def test_it_is_a_layer_that_can_be_hidden():
    opened = Opened(doubles.sequence(), ("stereo",), Config(), None)
    hidden = blueprint.hidden_paths(opened.methods, {"uncertainty"})
    assert any("/overrides/world/stereo/uncertainty/" in path for path in hidden)


def test_how_far_the_unit_may_have_drifted_is_plotted_and_shown_in_the_panel():
    sequence = doubles.sequence()
    recorder = Recorder(Opened(sequence, ("monocular",), Config(), None))
    step = Step(
        int(sequence.times_ns[0]), Status.TRACKING, "video", POSE, scale=1.002, scale_sigma=0.015, method="monocular"
    )
    placed = {"monocular": Similarity()}
    first, second = (recorder.batch(Stepped(i, sequence[i], (step,), placed, {})).entries for i in range(2))
    series, band = [e.value for e in first if e.path == "plots/scale/monocular/drift"]
    assert isinstance(series, rr.SeriesLines) and isinstance(band, rr.Scalars)
    assert [e.static for e in second if e.path == "plots/scale/monocular/drift"] == [False]
    record = ExposureRecord.of(Stepped(0, sequence[0], (step,), placed, {}), None)
    text = report(State("", methods=("monocular",), displayed=record))
    assert "± 1.5 %" in text and "1.002 scale" in text


def test_a_unit_that_nobody_knows_is_never_called_metres():
    step = Step(0, Status.TRACKING, world_from_frame=Pose(), covariance=np.eye(6), method="monocular")
    assert "2.8 of" in uncertainty.describe(step, None)
    assert "2.80 m" in uncertainty.describe(step, 1.0)
