"""What is wrong with a right camera, by OpenCV's whole model of it: how columns and rows move, and what rows tell."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.geometry import Array
from ispom.solvers.right_camera import (
    COLUMNS,
    LAG,
    PAIR,
    TERMS,
    by_column,
    by_row,
    drift,
    row_evidence,
    without_errors,
)
from ispom.solvers.window.prior import Evidence
from tests.solvers.pairs import BASELINE, RATE, SIGMA, F, points, seen, seen_left

SMALL = 1e-4


def patterns(xyz: Array, rate: Array = RATE) -> tuple[Array, Array]:
    """(N, COLUMNS) of columns and (N, E) of rows."""
    ideal, disparity = seen(xyz, np.zeros(PAIR)), BASELINE / xyz[:, 2]
    late = drift(xyz, np.tile(rate, (len(xyz), 1)), 0.0, BASELINE)
    return by_column(ideal, disparity, late), by_row(ideal, disparity, late)


@pytest.mark.parametrize("term", range(PAIR), ids=TERMS)
def test_each_error_moves_columns_and_rows_as_the_camera_model_does(term: int) -> None:
    xyz, extra = points(), np.zeros(PAIR)
    extra[term] = SMALL
    moved, (columns, rows) = (seen(xyz, extra) - seen(xyz, -extra)) / 2, patterns(xyz)
    left = (seen_left(xyz, extra) - seen_left(xyz, -extra)) / 2
    np.testing.assert_allclose(columns @ extra[:COLUMNS], moved[:, 0], atol=1e-8)
    np.testing.assert_allclose(rows @ extra, moved[:, 1] - left[:, 1], atol=1e-8)


def test_the_right_image_drifts_by_motion_and_depth() -> None:
    xyz, extra = points(), np.zeros(PAIR)
    extra[LAG] = 0.004
    wanted = seen(xyz, extra) - seen(xyz, 0 * extra)
    found = 0.004 * drift(xyz, np.tile(RATE, (len(xyz), 1)), 0.004, BASELINE)
    assert np.abs(wanted[:, 0]).max() > 5 / F
    np.testing.assert_allclose(found, wanted, atol=0.02 / F)


@pytest.mark.parametrize("terms", [("both_k1", "both_k2"), ("k1", "k2"), ("p1", "p2")], ids=" ".join)
def test_lenses_that_are_wrong_are_corrected_wholly(terms: tuple[str, str]) -> None:
    """What is open by 0.01 is no small error: by patterns where points are seen it is off by 0.1-0.7 px."""
    xyz = points()
    extra = np.where(np.isin(TERMS, terms), np.random.default_rng(1).normal(0, SIGMA), 0.0)
    observed = np.column_stack([seen_left(xyz, extra), seen(xyz, extra)[:, 0]])
    perfect = np.column_stack([seen_left(xyz, 0 * extra), seen(xyz, 0 * extra)[:, 0]])
    assert np.abs(observed - perfect).max() > 0.4 / F
    np.testing.assert_allclose(without_errors(observed, extra), perfect, atol=1e-4 / F)


def test_observations_without_a_right_one_stay_so() -> None:
    found = without_errors(np.array([[0.3, 0.1, np.nan]]), SIGMA)
    assert np.isfinite(found[0, :2]).all() and np.isnan(found[0, 2])


def told(rows: Array, lower: Array, scale: float) -> Evidence:
    """By points of which nothing was known before."""
    return row_evidence(np.arange(len(rows)), rows, lower, np.zeros(PAIR), np.diag(SIGMA**2), scale)


def known_by(evidence: Evidence) -> tuple[Array, Array]:
    """The corrections (E,) and their covariance (E, E) by rows and what was known before."""
    design, rows = evidence.design, evidence.seen
    covariance = np.linalg.inv(design.T @ design + np.diag(SIGMA**-2))
    return covariance @ design.T @ rows, covariance


def test_rows_without_noise_tell_what_they_depend_on() -> None:
    xyz = points()
    truth = np.random.default_rng(0).normal(0, SIGMA)
    _, rows = patterns(xyz)
    evidence = told(rows, rows @ truth, 1e-4 / F)
    found, covariance = known_by(evidence)
    shown = np.sqrt(np.diag(covariance)) < 0.01 * SIGMA
    assert {TERMS[i] for i in np.flatnonzero(shown)} >= {"offset_y", "pitch", "roll", "focal", "k1", "down"}
    np.testing.assert_allclose(found[shown], truth[shown], atol=0.01 * SIGMA.max())
    np.testing.assert_allclose(rows @ found, rows @ truth, atol=1e-3 / F)


def test_rows_with_noise_and_false_matches_are_as_good_as_they_say() -> None:
    rng, xyz, score = np.random.default_rng(3), points(), []
    _, rows = patterns(xyz)
    for _ in range(20):
        truth = rng.normal(0, SIGMA)
        lower = rows @ truth + rng.normal(0, 0.1 / F, len(xyz))
        lower[::10] += rng.uniform(-2, 2, len(xyz[::10])) / F
        lower[1::10] = np.nan
        found, covariance = known_by(told(rows, lower, 0.17 / F))
        score.append((found - truth) @ np.linalg.solve(covariance, found - truth) / PAIR)
    assert 0.3 < np.mean(score) < 1.3


def test_what_rows_do_not_show_stays_as_uncertain_as_it_was() -> None:
    xyz = points()
    xyz *= 1e4 / xyz[:, 2:]
    _, rows = patterns(xyz, np.zeros(6))
    evidence = told(rows, np.zeros(len(xyz)), 0.17 / F)
    spread = dict(zip(TERMS, np.sqrt(np.diag(known_by(evidence)[1])) / SIGMA, strict=True))
    assert min(spread[name] for name in ("offset_x", "down", "ahead", "lag")) > 0.99
    assert max(spread[name] for name in ("offset_y", "pitch", "roll")) < 0.2


def test_without_rows_nothing_is_said() -> None:
    evidence = told(np.zeros((3, PAIR)), np.full(3, np.nan), 0.1)
    assert evidence.design.shape == (0, PAIR) and not len(evidence.seen) and not len(evidence.ids)


def test_what_a_row_is_off_by_is_as_if_it_had_had_no_part() -> None:
    """Few rows tell much of some corrections, and leave little there."""
    rng, xyz = np.random.default_rng(5), points()[:40]
    _, rows = patterns(xyz)
    lower, ids = rng.normal(0, 0.1 / F, len(rows)), 7 + np.arange(len(rows))
    known, wide = np.diag(SIGMA**2), 3 / F  # so wide a loss has one weight for all
    evidence = row_evidence(ids, rows, lower, np.zeros(PAIR), known, wide)
    np.testing.assert_array_equal(evidence.ids, ids)
    for i in (0, 17, 39):
        others = np.arange(len(rows)) != i
        told_by = row_evidence(ids[others], rows[others], lower[others], np.zeros(PAIR), known, wide)
        found, _ = known_by(told_by)
        assert evidence.left[i] == pytest.approx((rows[i] @ found - lower[i]) / wide, rel=0.02, abs=1e-5)
