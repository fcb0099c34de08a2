"""The normal equations of a trajectory seen by several cameras, reduced to its spline: hot loops of `continuous`.

Everything is sequential, so results repeat bit for bit. Unknowns, in this order: six per knot (rotation, position),
then seven of the rig: rotation and position of the video camera, and how late its clock stamps.
"""

from __future__ import annotations

import numpy as np

from ispom.kernels import kernel

RIG = 7
"""Unknowns of the rig: rig_from_video's rotation (in the camera) [rad] and position [m], the clock offset [s]."""
MIN_DEPTH = 1e-4
"""Of a point in a camera, as a share of its distance from its anchor; nearer or behind, it tells nothing."""
GROSS = 1e4
"""Square of the error, in standard deviations, that such a point costs."""


@kernel()
def squared_errors(
    r, p, cameras_r, cameras_t, baseline, exposure, camera, owner, seen, inverse_sigma, anchors_r, anchors_t, points
):
    """(O,) squares of the reprojection errors, in standard deviations."""
    out = np.empty(len(exposure))
    d, y, x = np.empty(3), np.empty(3), np.empty(3)
    for o in range(len(exposure)):
        e, c, m = exposure[o], camera[o], owner[o]
        into_camera(r[e], p[e], cameras_r[c], cameras_t[c], anchors_r[m], anchors_t[m], points[m], d, y, x)
        if x[2] <= MIN_DEPTH:
            out[o] = GROSS
        else:
            a = (x[0] / x[2] - seen[o, 0]) * inverse_sigma[o, 0]
            b = (x[1] / x[2] - seen[o, 1]) * inverse_sigma[o, 1]
            out[o] = a * a + b * b
            if inverse_sigma[o, 2] > 0.0:
                a = (baseline * points[m, 2] / x[2] - seen[o, 2]) * inverse_sigma[o, 2]
                out[o] += a * a
    return out


@kernel(inline="always")
def into_camera(r, p, camera_r, camera_t, anchor_r, anchor_t, point, world, rig, camera):
    """Where a point is, times its inverse depth (finite at infinity): from the rig, in the rig, in the camera."""
    a, b, rho = point[0], point[1], point[2]
    for i in range(3):
        world[i] = anchor_r[i, 0] * a + anchor_r[i, 1] * b + anchor_r[i, 2] + rho * (anchor_t[i] - p[i])
    for i in range(3):
        rig[i] = r[0, i] * world[0] + r[1, i] * world[1] + r[2, i] * world[2]
    x, y, z = rig[0] - rho * camera_t[0], rig[1] - rho * camera_t[1], rig[2] - rho * camera_t[2]
    for i in range(3):
        camera[i] = camera_r[0, i] * x + camera_r[1, i] * y + camera_r[2, i] * z


@kernel()
def reduce(
    r,
    p,
    first,
    turns,
    weights,
    rates,
    knots,
    cameras_r,
    cameras_t,
    baseline,
    exposure,
    camera,
    owner,
    seen,
    inverse_sigma,
    anchors_r,
    anchors_t,
    points,
    depth_prior,
    loss,
    damping,
    with_rig,
):
    """Hessian (n, n) and right side (n,) of spline and rig, without the points; and what finds the points' step.

    Observations are sorted by owner. Without `with_rig` the rig's rows stay zero. `depth_prior` (M, 2): expected
    inverse depth and its inverse variance.
    """
    n, n_points, n_obs, n_exp = 6 * knots + RIG, len(points), len(exposure), len(r)
    hessian, right = np.zeros((n, n)), np.zeros(n)
    own_h, own_b = np.zeros((n_exp, 6, 6)), np.zeros((n_exp, 6))
    own_g = np.zeros((n_exp, RIG, 6))
    inverses, sides = np.zeros((n_points, 3, 3)), np.zeros((n_points, 3))
    cross, cross_rig = np.zeros((n_obs, 6, 3)), np.zeros((n_points, RIG, 3))
    spread = np.zeros((3, n))
    jp, jg, jl, row, error = np.zeros((3, 6)), np.zeros((2, RIG)), np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    d, y, x = np.empty(3), np.empty(3), np.empty(3)
    g = 6 * knots
    o = 0
    for m in range(n_points):
        begin = o
        v, b = np.zeros((3, 3)), np.zeros(3)
        v[2, 2] = depth_prior[m, 1]
        b[2] = depth_prior[m, 1] * (depth_prior[m, 0] - points[m, 2])
        low, high = knots, 0
        while o < n_obs and owner[o] == m:
            e, c = exposure[o], camera[o]
            rt, ct, ar = r[e], cameras_r[c], anchors_r[m]
            into_camera(rt, p[e], ct, cameras_t[c], ar, anchors_t[m], points[m], d, y, x)
            if x[2] > MIN_DEPTH:
                low, high = min(low, first[e]), max(high, first[e] + 4)
                iz = 1.0 / x[2]
                u, w = x[0] * iz, x[1] * iz
                rho = points[m, 2]
                disparity = baseline * rho * iz
                error[0], error[1] = (u - seen[o, 0]) * inverse_sigma[o, 0], (w - seen[o, 1]) * inverse_sigma[o, 1]
                rows = 3 if inverse_sigma[o, 2] > 0.0 else 2
                error[2] = (disparity - seen[o, 2]) * inverse_sigma[o, 2] if rows == 3 else 0.0
                square = error[0] * error[0] + error[1] * error[1] + error[2] * error[2]
                weight = 1.0 / (1.0 + square / (loss * loss))
                for i in range(rows):
                    s = inverse_sigma[o, i] * iz
                    a = u if i == 0 else (w if i == 1 else disparity)
                    # The row of the image's Jacobian, turned into the rig, then into the world.
                    for k in range(3):
                        row[k] = s * ((ct[k, i] if i < 2 else 0.0) - a * ct[k, 2])
                    wx = rt[0, 0] * row[0] + rt[0, 1] * row[1] + rt[0, 2] * row[2]
                    wy = rt[1, 0] * row[0] + rt[1, 1] * row[1] + rt[1, 2] * row[2]
                    wz = rt[2, 0] * row[0] + rt[2, 1] * row[1] + rt[2, 2] * row[2]
                    jp[i, 0] = row[1] * y[2] - row[2] * y[1]
                    jp[i, 1] = row[2] * y[0] - row[0] * y[2]
                    jp[i, 2] = row[0] * y[1] - row[1] * y[0]
                    jp[i, 3], jp[i, 4], jp[i, 5] = -rho * wx, -rho * wy, -rho * wz
                    jl[i, 0] = wx * ar[0, 0] + wy * ar[1, 0] + wz * ar[2, 0]
                    jl[i, 1] = wx * ar[0, 1] + wy * ar[1, 1] + wz * ar[2, 1]
                    jl[i, 2] = (
                        wx * (anchors_t[m, 0] - p[e, 0])
                        + wy * (anchors_t[m, 1] - p[e, 1])
                        + wz * (anchors_t[m, 2] - p[e, 2])
                        - row[0] * cameras_t[c, 0]
                        - row[1] * cameras_t[c, 1]
                        - row[2] * cameras_t[c, 2]
                    )
                    if i == 2:
                        jl[i, 2] += s * baseline
                    if c == 0 and with_rig:
                        i0, i1, i2 = (s if i == 0 else 0.0), (s if i == 1 else 0.0), -s * a
                        jg[i, 0] = i1 * x[2] - i2 * x[1]
                        jg[i, 1] = i2 * x[0] - i0 * x[2]
                        jg[i, 2] = i0 * x[1] - i1 * x[0]
                        jg[i, 3], jg[i, 4], jg[i, 5] = -rho * row[0], -rho * row[1], -rho * row[2]
                        jg[i, 6] = 0.0
                        for k in range(6):
                            jg[i, 6] += jp[i, k] * rates[e, k]
                for i in range(rows):
                    for k in range(3):
                        f = weight * jl[i, k]
                        b[k] -= f * error[i]
                        for j in range(3):
                            v[k, j] += f * jl[i, j]
                    for k in range(6):
                        f = weight * jp[i, k]
                        own_b[e, k] -= f * error[i]
                        for j in range(6):
                            own_h[e, k, j] += f * jp[i, j]
                        for j in range(3):
                            cross[o, k, j] += f * jl[i, j]
                if c == 0 and with_rig:
                    for k in range(RIG):
                        right[g + k] -= weight * (jg[0, k] * error[0] + jg[1, k] * error[1])
                        for j in range(6):
                            own_g[e, k, j] += weight * (jg[0, k] * jp[0, j] + jg[1, k] * jp[1, j])
                        for j in range(3):
                            cross_rig[m, k, j] += weight * (jg[0, k] * jl[0, j] + jg[1, k] * jl[1, j])
                        for j in range(RIG):
                            hessian[g + k, g + j] += weight * (jg[0, k] * jg[0, j] + jg[1, k] * jg[1, j])
            o += 1
        for k in range(3):
            v[k, k] *= 1.0 + damping
        if high <= low:
            continue
        inverse = _inverse3(v)
        inverses[m], sides[m] = inverse, b
        # What the point says of the exposures, spread over their knots.
        begin_row, end_row = 6 * low, 6 * high
        spread[:, begin_row:end_row] = 0.0
        for i in range(begin, o):
            e = exposure[i]
            for q in range(4):
                base, t, wk = 6 * (first[e] + q), turns[e, q], weights[e, q]
                for j in range(3):
                    c0, c1, c2 = cross[i, 0, j], cross[i, 1, j], cross[i, 2, j]
                    for k in range(3):
                        spread[j, base + k] += t[0, k] * c0 + t[1, k] * c1 + t[2, k] * c2
                        spread[j, base + 3 + k] += wk * cross[i, 3 + k, j]
        row0, row1, row2 = spread[0], spread[1], spread[2]
        for k in range(begin_row, end_row):
            s0 = row0[k] * inverse[0, 0] + row1[k] * inverse[1, 0] + row2[k] * inverse[2, 0]
            s1 = row0[k] * inverse[0, 1] + row1[k] * inverse[1, 1] + row2[k] * inverse[2, 1]
            s2 = row0[k] * inverse[0, 2] + row1[k] * inverse[1, 2] + row2[k] * inverse[2, 2]
            right[k] -= s0 * b[0] + s1 * b[1] + s2 * b[2]
            line = hessian[k]
            for j in range(begin_row, k + 1):
                line[j] -= s0 * row0[j] + s1 * row1[j] + s2 * row2[j]
        for k in range(RIG if with_rig else 0):
            c0, c1, c2 = cross_rig[m, k, 0], cross_rig[m, k, 1], cross_rig[m, k, 2]
            s0 = c0 * inverse[0, 0] + c1 * inverse[1, 0] + c2 * inverse[2, 0]
            s1 = c0 * inverse[0, 1] + c1 * inverse[1, 1] + c2 * inverse[2, 1]
            s2 = c0 * inverse[0, 2] + c1 * inverse[1, 2] + c2 * inverse[2, 2]
            right[g + k] -= s0 * b[0] + s1 * b[1] + s2 * b[2]
            line = hessian[g + k]
            for j in range(begin_row, end_row):
                line[j] -= s0 * row0[j] + s1 * row1[j] + s2 * row2[j]
            for j in range(RIG):
                line[g + j] -= s0 * cross_rig[m, j, 0] + s1 * cross_rig[m, j, 1] + s2 * cross_rig[m, j, 2]
    for e in range(n_exp):
        _spread_exposure(hessian, right, own_h[e], own_b[e], own_g[e], first[e], turns[e], weights[e], g)
    for k in range(n):
        for j in range(k + 1, n):
            hessian[k, j] = hessian[j, k]
    return hessian, right, inverses, sides, cross, cross_rig


@kernel()
def _spread_exposure(hessian, right, h, b, rig, first, turns, weights, g):
    """Adds what one exposure says of its pose to the four knots that shape it (lower triangle)."""
    jacobian = np.zeros((6, 24))
    for q in range(4):
        jacobian[:3, 6 * q : 6 * q + 3] = turns[q]
        for k in range(3):
            jacobian[3 + k, 6 * q + 3 + k] = weights[q]
    base, hj = 6 * first, h @ jacobian
    block, side, rig_block = jacobian.T @ hj, jacobian.T @ b, rig @ jacobian
    for k in range(24):
        right[base + k] += side[k]
        for j in range(k + 1):
            hessian[base + k, base + j] += block[k, j]
    for k in range(len(rig)):
        for j in range(24):
            hessian[g + k, base + j] += rig_block[k, j]


@kernel()
def _inverse3(a):
    """Of a symmetric positive (3, 3)."""
    out = np.empty((3, 3))
    out[0, 0] = a[1, 1] * a[2, 2] - a[1, 2] * a[1, 2]
    out[0, 1] = out[1, 0] = a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    out[0, 2] = out[2, 0] = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    out[1, 1] = a[0, 0] * a[2, 2] - a[0, 2] * a[0, 2]
    out[1, 2] = out[2, 1] = a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]
    out[2, 2] = a[0, 0] * a[1, 1] - a[0, 1] * a[0, 1]
    return out / max(a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0], 1e-300)


@kernel()
def point_steps(step, first, turns, weights, knots, exposure, owner, inverses, sides, cross, cross_rig):
    """Steps (M, 3) of the points that go with a step (n,) of spline and rig."""
    pose = np.zeros((len(first), 6))
    for e in range(len(first)):
        for q in range(4):
            base = 6 * (first[e] + q)
            pose[e, :3] += turns[e, q] @ step[base : base + 3]
            pose[e, 3:] += weights[e, q] * step[base + 3 : base + 6]
    left, g = sides.copy(), 6 * knots
    for o in range(len(exposure)):
        m, e = owner[o], exposure[o]
        for j in range(3):
            for k in range(6):
                left[m, j] -= cross[o, k, j] * pose[e, k]
    for m in range(len(sides)):
        left[m] = inverses[m] @ (left[m] - cross_rig[m].T @ step[g:])
    return left


@kernel()
def point_sensitivity(chosen, first, turns, weights, knots, exposure, owner, inverses, cross, cross_rig):
    """(K, 3, n): how each of the chosen points (K,) follows the unknowns of spline and rig."""
    n = 6 * knots + RIG
    number = np.full(len(inverses), -1)
    for i in range(len(chosen)):
        number[chosen[i]] = i
    out, side = np.zeros((len(chosen), 3, n)), np.zeros((3, n))
    for i in range(len(chosen)):
        for j in range(3):
            for k in range(RIG):
                out[i, j, 6 * knots + k] = cross_rig[chosen[i], k, j]
    for o in range(len(exposure)):
        i, e = number[owner[o]], exposure[o]
        if i < 0:
            continue
        for q in range(4):
            base, t, w = 6 * (first[e] + q), turns[e, q], weights[e, q]
            for j in range(3):
                for k in range(3):
                    out[i, j, base + k] += (
                        t[0, k] * cross[o, 0, j] + t[1, k] * cross[o, 1, j] + t[2, k] * cross[o, 2, j]
                    )
                    out[i, j, base + 3 + k] += w * cross[o, 3 + k, j]
    for i in range(len(chosen)):
        inverse = inverses[chosen[i]]
        side[:] = out[i]
        for j in range(3):
            for k in range(n):
                out[i, j, k] = -inverse[j, 0] * side[0, k] - inverse[j, 1] * side[1, k] - inverse[j, 2] * side[2, k]
    return out
