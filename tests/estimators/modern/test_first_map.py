"""What makes a monocular map, and what must not."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.estimators.modern.monocular import first_map as module
from ispom.estimators.modern.monocular.first_map import first_map
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import LOSS
from ispom.estimators.modern.monocular.state import Start
from ispom.estimators.modern.monocular.window import anchored_prior
from ispom.estimators.tracked_frame import TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.multiview.two_view import Hypotheses
from ispom.types import Decision

SIGMA = 1e-3
COUNT = 200


def flown(still: int) -> tuple[Start, TrackedFrame]:
    """Frames of a sideways flight over a deep scene. `still` of its points stand; each other one moves on its own."""
    rng = np.random.default_rng(0)
    xyz = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (COUNT, 3))
    ways = rng.uniform(-0.25, 0.25, (COUNT, 3))
    ways[:still] = 0
    frames = [
        TrackedFrame(i * 100_000_000, np.arange(COUNT), seen(xyz + i * ways, 0.1 * i) + rng.normal(0, 2e-4, (COUNT, 2)))
        for i in range(8)
    ]
    start = Start((frames[0], *frames[1:]))
    return start, frames[-1]


def seen(xyz: Array, along: float) -> Array:
    p = xyz - (along, 0.02 * along, 0)
    return p[:, :2] / p[:, 2:]


def tried(still: int, impatient: bool) -> tuple[Map | None, dict[str, Decision]]:
    start, last = flown(still)
    found, decisions = first_map(start, last, Noise(SIGMA / LOSS, LOSS), impatient)
    return found, {d.key: d for d in decisions}


def test_a_still_scene_makes_a_map() -> None:
    found, decisions = tried(still=COUNT, impatient=False)
    assert found is not None and decisions["ambiguity"].passed


@pytest.mark.parametrize("impatient", [False, True])
def test_no_patience_makes_a_map_of_what_a_third_of_the_points_say(impatient: bool) -> None:
    found, decisions = tried(still=80, impatient=impatient)
    assert found is None and not decisions["explained_share"].passed


def test_a_lone_hypothesis_is_never_clear(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = Hypotheses((Pose(np.eye(3), np.array([-1.0, -0.02, 0.0])),), 0.0, 1)
    monkeypatch.setattr(module, "hypotheses", lambda *_: alone)
    found, decisions = tried(still=COUNT, impatient=False)
    assert found is None and not decisions["ambiguity"].passed


@pytest.mark.parametrize("unit_sigma", [0.0, 0.3])
@pytest.mark.parametrize("place_m", [0.0, 5.0])
def test_the_unit_of_a_map_is_as_sure_as_told_wherever_its_first_pose_may_be(place_m: float, unit_sigma: float) -> None:
    """After a loss the place is not known; how far its first two key frames are apart is what it was."""
    poses = (Pose.exp(np.array([3.0, -1, 2, 0.4, -0.2, 0.9])), Pose.exp(np.array([3.2, -1.4, 2.3, 0.5, -0.3, 0.7])))
    known = np.diag([place_m**2] * 3 + [(0.1 * place_m) ** 2] * 3)
    prior = anchored_prior(poses, np.zeros(2), known, unit_sigma)
    covariance = np.linalg.inv(prior.hessian + np.diag([0.0] * 6 + [1e-4] * 6 + [0.0] * 2))
    apart = poses[1].translation - poses[0].translation
    away = apart / (apart @ apart)
    # Left twists of camera_from_world: its centre moves by -R' rho.
    log_unit = np.concatenate([poses[0].rotation.T @ away, np.zeros(3), -poses[1].rotation.T @ away, np.zeros(5)])
    # Beside 25 m^2 that cancel, rounding may leave a little less than nothing.
    np.testing.assert_allclose(log_unit @ covariance @ log_unit, unit_sigma**2, atol=1e-6, rtol=2e-3)
