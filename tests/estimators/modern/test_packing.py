"""The window's observations are those of points seen twice, sorted, with what the right camera's errors do to each."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.stereo.window import pack
from ispom.geometry import so3_exp
from ispom.solvers.right_camera import LAG, PAIR, by_column, drift, without_errors


def test_points_seen_twice_are_packed_by_point_and_key_frame() -> None:
    rng = np.random.default_rng(0)
    known, frames = np.sort(rng.choice(200, 60, replace=False)), 5
    xyz = rng.uniform((-3, -2, 4), (3, 2, 20), (60, 3))
    ids = [np.sort(rng.choice(220, 60, replace=False)) for _ in range(frames)]  # some that the map does not know
    seen = [np.column_stack([rng.uniform(-0.5, 0.5, (60, 3))]) for _ in range(frames)]
    seen[2][7, 2] = np.nan
    rotations, translations = so3_exp(rng.normal(0, 0.05, (frames, 3))), rng.normal(0, 0.5, (frames, 3))
    rates, extra, baseline = rng.normal(0, 0.3, (frames, 6)), rng.normal(0, 0.003, PAIR), 0.4
    sizes = np.array([len(i) for i in ids])
    packed = pack(
        known, xyz, np.concatenate(ids), sizes, np.concatenate(seen), rotations, translations, rates, extra, baseline
    )
    every = np.concatenate(ids)
    wanted = [p for p, name in enumerate(known) if (every == name).sum() >= 2]
    assert packed.used.tolist() == wanted
    observed = [
        (m, c, int(np.flatnonzero(ids[c] == known[p])[0]))
        for m, p in enumerate(wanted)
        for c in range(frames)
        if known[p] in ids[c]
    ]
    assert list(zip(packed.owners.tolist(), packed.cameras.tolist(), packed.origin.tolist(), strict=True)) == observed
    for k, (m, c, i) in enumerate(observed):
        np.testing.assert_array_equal(packed.seen[k], seen[c][i])
        near = rotations[c] @ xyz[wanted[m]] + translations[c]
        late = drift(near[None], rates[c][None], extra[LAG], baseline)
        x, y, right = without_errors(seen[c][i : i + 1], extra, late)[0]
        factors = by_column(np.array([[right, y]]), np.array([x - right]), late)
        np.testing.assert_allclose(packed.factors[k], factors[0], atol=1e-9)


def test_nothing_is_packed_of_points_seen_once() -> None:
    once = pack(
        np.arange(4), np.ones((4, 3)), np.arange(4), np.array([2, 2]), np.zeros((4, 3)), np.stack([np.eye(3)] * 2),
        np.zeros((2, 3)), np.zeros((2, 6)), np.zeros(PAIR), 0.4,
    )  # fmt: skip
    assert not len(once.used) and not len(once.cameras)
