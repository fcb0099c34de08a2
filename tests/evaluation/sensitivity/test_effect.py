from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.evaluation.sensitivity.effect import Sensitivity, shift_m
from ispom.evaluation.sensitivity.linear import Values
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.evaluation.sensitivity.scene import Adjustment, Scene
from ispom.geometry import Array
from ispom.solvers import right_camera
from ispom.solvers.right_camera import by_column, by_row
from ispom.solvers.window.adjustment import Window, adjust
from ispom.types import Trajectory
from tests.evaluation.sensitivity.scenes import rig, scene_map

WHOLE = 100
"""A window that holds every key frame."""
PAIR = Adjustment((0.0,) * right_camera.PAIR, 0.3, WHOLE)
SELF_CALIBRATED = Adjustment(tuple(ModernStereoConfig(lag_sigma_s=1e-5).pair_sigma(460.0).tolist()), 0.3, WHOLE)
LENS = Adjustment((0.0, 0.0), 0.5, WHOLE)


def adjusted(scene: Scene, values: Values, wrong: Perturbation, adjustment: Adjustment) -> Trajectory:
    """By the solver of the estimators, from the run's own poses and points, with the wrong calibration."""
    stated_rig = wrong.of_rig(scene.rig)
    order = np.lexsort((scene.view, scene.point))
    camera = stated_rig.camera(scene.camera)
    seen = np.column_stack([camera.normalise(scene.uv), (scene.right_px - camera.cx) / camera.fx])[order]
    sigmas, late = np.array(adjustment.sigmas), np.zeros((len(order), 2))
    right, disparity = seen[:, [2, 1]], seen[:, 0] - seen[:, 2]
    factors = by_column(right, disparity, late) if scene.is_pair else np.zeros((0, len(sigmas)))
    window = Window(
        values.rotations, values.translations, values.xyz_in_world, scene.view[order], scene.point[order], seen,
        stated_rig.baseline_m if scene.is_pair else 0.0, np.zeros(len(sigmas)), sigmas, factors, fixed=1,
    )  # fmt: skip
    if sigmas.any():
        from ispom.solvers.window.prior import Evidence, anchored

        prior = anchored(values.rotations[0], values.translations[0], sigmas)
        if scene.is_pair:  # rows as they should be
            rows = (camera.fx / adjustment.loss_px) * by_row(right, disparity, late)
            none = np.zeros(len(rows))
            prior = prior.with_evidence(Evidence(rows * (sigmas > 0), none, none, np.arange(len(rows))))
        window = replace(window, prior=prior, fixed=0)
    found = adjust(window, adjustment.loss_px / camera.fx, iterations=60, tolerance=1e-10).window
    rotations = np.swapaxes(found.rotations, 1, 2)
    places: Array = -np.einsum("kij,kj->ki", rotations, found.translations)
    return Trajectory(scene.times_ns, rotations, places, scene.camera)


@pytest.mark.parametrize(
    ("wrong", "adjustment"),
    [
        (Perturbation(baseline_percent=1), PAIR),
        (Perturbation(pair_focal_percent=0.5), PAIR),
        (Perturbation(pair_centre_x_px=1), PAIR),
        (Perturbation(pair_centre_y_px=-1), PAIR),
        (Perturbation(pair_focal_percent=0.5, baseline_percent=-1), SELF_CALIBRATED),
        (Perturbation(video_focal_percent=0.5), LENS),
        (Perturbation(video_centre_x_px=1), LENS),
    ],
    ids=lambda v: " ".join(v.nonzero) if isinstance(v, Perturbation) else str(v.sigmas),
)
def test_the_prediction_is_where_the_adjustment_goes(wrong: Perturbation, adjustment: Adjustment) -> None:
    camera = "left" if "pair" in "".join(wrong.nonzero) or wrong.baseline_percent else "video"
    scene = Scene.of(scene_map(camera), rig(camera))
    found = Sensitivity.of(scene, adjustment)
    run = scene_map(camera).key_frames
    predicted = found.predicted(run, wrong)
    rerun = adjusted(scene, found.values, wrong, adjustment)
    kind = "none" if camera == "left" else "sim3"
    moved_m = shift_m(run, rerun, kind)
    assert moved_m > 1e-4
    assert shift_m(rerun, predicted, kind) < 0.1 * moved_m
    assert found.nonlinearity(wrong) < 0.3


def test_a_longer_baseline_makes_the_path_as_much_longer() -> None:
    scene, run = Scene.of(scene_map("left"), rig("left")), scene_map("left").key_frames
    predicted = Sensitivity.of(scene, PAIR).predicted(run, Perturbation(baseline_percent=1))
    assert predicted.length == pytest.approx(1.01 * run.length, rel=1e-4)


def test_no_error_moves_nothing() -> None:
    scene, run = Scene.of(scene_map("left"), rig("left")), scene_map("left").key_frames
    found = Sensitivity.of(scene, PAIR)
    assert shift_m(run, found.predicted(run, Perturbation()), "none") == 0.0
    assert found.nonlinearity(Perturbation()) == 0.0


def test_a_method_that_corrects_its_lens_takes_most_of_a_wrong_focal_length_back() -> None:
    scene = Scene.of(scene_map("video"), rig("video"))
    found = Sensitivity.of(scene, replace(LENS, sigmas=(0.05, 0.05)))
    correction = found.whole.extra @ found.amounts(Perturbation(video_focal_percent=1))
    assert correction[0] == pytest.approx(-0.01, rel=0.3)


def test_an_error_too_large_for_a_line_is_seen_by_the_second_step() -> None:
    found = Sensitivity.of(Scene.of(scene_map("video"), rig("video")), LENS)
    small, large = (found.nonlinearity(Perturbation(video_focal_percent=percent)) for percent in (0.5, 30))
    assert small < 0.03 < 0.3 < large
