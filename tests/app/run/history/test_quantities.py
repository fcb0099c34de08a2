"""Quantities: one stable name each, the same in tables, break points and comparisons."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ispom_app.engine.events import Stepped
from ispom_app.engine.history.quantities import (
    CHANGES,
    NO_ROW,
    POSE,
    STEP_QUANTITIES,
    Row,
    quantities,
    row_after,
    step_values,
)
from ispom_app.engine.history.step_quantities.motion import USUAL_STEPS
from ispom_app.engine.run_folder.step_log import STEP_COLUMNS
from scipy.spatial.transform import Rotation

from ispom.geometry import Pose
from ispom.methods import names, registry
from ispom.types import Check, Decision, Measurement, Step
from tests import doubles


def stepped(count: int) -> list[tuple[int, Measurement, Step]]:
    """Of a video method alone."""
    sequence, estimator, found = doubles.sequence(count), doubles.FullEstimator("monocular"), []
    state = estimator.start()
    for i in range(len(sequence)):
        if sequence.kinds[i] == "video":
            state, step = estimator.step(state, sequence[i])
            found.append((i, sequence[i], step))
    return found


def rows(found: list[tuple[int, Measurement, Step]]) -> list[Row]:
    made, row = [], NO_ROW
    for i, exposure, step in found:
        event = Stepped(i, exposure, (step,), {}, {"monocular": 0.5})
        row = row_after(row, event.index, exposure.time_ns, event.steps, event.errors_m)
        made.append(row)
    return made


@pytest.mark.parametrize("method", names())
def test_no_two_quantities_of_a_method_have_one_name(method: str) -> None:
    own = [*(q.key for q in STEP_QUANTITIES), *POSE, *(q.key for q in CHANGES), "time_s"]
    keys = own + list(registry()[method].checks)
    assert len(set(keys)) == len(keys) and all(re.fullmatch(r"[a-z]+(_[a-z]+)*", key) for key in keys)
    of_checks = 4 * len(registry()[method].checks)
    assert len([q for q in quantities(names()).values() if q.method == method]) == len(own) + of_checks


def test_every_quantity_of_a_step_is_a_column() -> None:
    assert {q.key for q in STEP_QUANTITIES} | set(POSE) <= set(STEP_COLUMNS)


MOTION = ("moved", "turned_deg", "moved_usual")


def at(
    row: Row,
    index: int,
    x_m: float,
    *,
    turn_deg: float = 0.0,
    restarted: bool = False,
    lost: bool = False,
    time_ns: int | None = None,
) -> Row:
    """The row of a step at this place, after another row."""
    _, exposure, step = stepped(3)[0]
    pose = None if lost else Pose(Rotation.from_euler("y", turn_deg, degrees=True).as_matrix(), np.array([x_m, 0, 0]))
    made = replace(step, world_from_frame=pose, restarted=restarted)
    return row_after(row, index, exposure.time_ns + 10**8 * index if time_ns is None else time_ns, (made,), {})


def test_a_step_is_compared_with_the_usual_one() -> None:
    row, changes = NO_ROW, []
    for i, x in enumerate([0.0, 1.0, 2.0, 4.0, 4.0, 5.0]):
        row = at(row, i, x, turn_deg=10.0 * x)
        changes.append([row["monocular"][key] for key in MOTION])
    assert changes[0] == [None, None, None]
    assert changes[1] == [1.0, pytest.approx(10.0), None]
    assert changes[2] == [1.0, pytest.approx(10.0), 1.0]
    assert changes[3] == [2.0, pytest.approx(20.0), 1.0]
    assert changes[5][2] == changes[4][2], "a step that does not move changes nothing"
    assert changes[4] == [0.0, pytest.approx(0.0, abs=1e-6), 1 + 1 / USUAL_STEPS]


def test_two_poses_of_one_moment_are_no_motion() -> None:
    """As of a video frame and a pair at one time: the second pose is a better one, not a farther one."""
    row = NO_ROW
    for i, x in enumerate([0.0, 0.0, 1.0, 1.01, 2.0, 2.01]):
        row = at(row, i, x, time_ns=i // 2 * 10**9)
    assert row["monocular"]["moved"] == pytest.approx(0.99)
    assert row["monocular"]["moved_usual"] == pytest.approx(1.0, abs=0.01)
    assert row["monocular"]["way_x"] == pytest.approx(0.1 + 0.9 / 10, abs=0.01)


def test_a_quantity_sees_the_step_before_and_the_time() -> None:
    step = stepped(3)[0][2]
    row = NO_ROW
    for index in range(3):
        row = row_after(row, index, 500_000_000 * (index + 1), (replace(step, restarted=index == 2),), {})
        assert row["monocular"]["time_s"] == 0.5 * (index + 1)
        assert row["monocular"]["moved"] == (0.0 if index == 1 else None), "over a restart nothing is known"


def test_no_step_goes_over_a_gap_or_into_a_new_world() -> None:
    row = at(at(at(NO_ROW, 0, 0.0), 1, 1.0), 2, 0.0, lost=True)
    assert [row["monocular"][key] for key in MOTION] == [None, None, 1.0]
    row = at(row, 3, 9.0)
    assert [row["monocular"][key] for key in MOTION] == [None, None, 1.0]
    assert [at(row, 4, 0.0, restarted=True)["monocular"][key] for key in MOTION] == [None, None, None]


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1), st.floats(0, 180))
def test_the_angle_of_a_step_is_that_of_its_rotation(quaternion: list[float], angle: float) -> None:
    first = Rotation.from_quat(quaternion)
    second = Rotation.from_rotvec([0, np.radians(angle), 0]) * first
    _, exposure, step = stepped(3)[0]
    row = NO_ROW
    for i, turned in enumerate((first, second)):
        made = replace(step, world_from_frame=Pose(turned.as_matrix(), np.zeros(3)))
        row = row_after(row, i, exposure.time_ns, (made,), {})
    assert row["monocular"]["turned_deg"] == pytest.approx(angle, abs=1e-5)


def test_what_a_step_says_is_finite_or_missing_and_of_its_kind() -> None:
    known = quantities(["monocular"])
    python = {"number": (int, float), "flag": (bool,), "text": (str,)}
    for row in rows(stepped(30)):
        for key, value in row["monocular"].items():
            quantity = known[f"monocular.{key}"]
            assert value is None or type(value) in python[quantity.kind]
            assert not isinstance(value, float) or np.isfinite(value)
            assert not quantity.choices or value in quantity.choices


def test_a_method_that_did_not_step_keeps_its_last_values() -> None:
    _, exposure, step = stepped(3)[1]
    first = row_after(NO_ROW, 0, exposure.time_ns, (step,), {})
    second = row_after(first, 1, 500_000_000, (replace(step, method="stereo"),), {})
    assert second["monocular"] is first["monocular"] and "stereo" not in first
    assert second[""] == {"exposure": 1, "time_s": 0.5}


def test_a_key_frame_and_a_restart_are_of_one_exposure() -> None:
    _, exposure, step = stepped(3)[0]
    first = row_after(NO_ROW, 0, exposure.time_ns, (replace(step, key_frame=True, restarted=True),), {})
    second = row_after(first, 1, 500_000_000, (replace(step, method="stereo", key_frame=False),), {})
    assert first["monocular"]["key_frame"] and first["monocular"]["restarted"]
    assert not second["monocular"]["key_frame"] and not second["monocular"]["restarted"]
    assert second["monocular"]["inliers"] == first["monocular"]["inliers"]


def test_what_a_method_does_not_say_again_is_missing() -> None:
    _, exposure, step = stepped(3)[0]
    first = row_after(NO_ROW, 0, exposure.time_ns, (step,), {})
    second = row_after(first, 1, exposure.time_ns, (replace(step, decisions=()),), {})
    assert "parallax" in first["monocular"] and "parallax" not in second["monocular"]


def test_of_a_check_made_several_times_the_least_margin_counts() -> None:
    check = Check("cost", "cost", "requirement", relation="<")
    made = tuple(replace(check.of(value, 5.0), about=str(value)) for value in (1.0, 7.0, 3.0))
    found = step_values(replace(stepped(3)[0][2], decisions=made), None)
    wanted = {"cost": 7.0, "cost.threshold": 5.0, "cost.margin": -2.0, "cost.passed": False}
    assert wanted.items() <= found.items()


def test_numbers_that_are_not_finite_are_missing() -> None:
    decision = Decision("a", float("nan"), float("inf"), False, key="a")
    step = replace(stepped(3)[0][2], decisions=(decision,), scale=np.nan)
    found = step_values(step, float("inf"))
    assert all(found[key] is None for key in ("a", "a.threshold", "a.margin", "scale", "error_m"))
