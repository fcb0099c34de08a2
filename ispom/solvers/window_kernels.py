"""The compiled parts of a window's adjustment: cost, normal equations without the points, the points' steps.

With q a point in its camera, a pose's left twist moves q by B = [I | -[q]x] times it, and the point's own step moves q
by R: all derivatives of an observation follow from those by q. So 3 x 3 terms are summed up first, and widened to 6 x 6
by B at the very end. Scalars instead of small arrays: the compiler keeps them in registers, and counts no references.
Products may be rounded once with the sum they go into (`contract`): the same on each run of one machine.
"""

from __future__ import annotations

import numpy as np

from ispom.kernels import kernel

MIN_DEPTH = 1e-6
"""Points nearer are behind their camera."""
GROSS = 1e6
"""A point behind its camera costs what an error of a thousand scales does: its square."""
TERMS = 12
"""Of an observation: second derivatives by q (6 of a symmetric matrix), gradient by q (3), and derivative by the first
correction times those by q (3), all weighted. After them, per correction: what the derivative
by it is of that by the first."""


@kernel(error_model="numpy", fastmath={"contract"})
def _errors(q0, q1, q2, seen_x, seen_y, seen_right, baseline, e0, e1, e2, e3, rate):
    """Image x, y, right x of a point before its camera, and their errors; without a right place its error is 0."""
    iz = 1.0 / q2
    x, y, right, er = q0 * iz, q1 * iz, 0.0, 0.0
    ex, ey = x - seen_x, y - seen_y
    if baseline == 0.0:
        stretch = e0 + e1 * (x * x + y * y)
        ex, ey = ex + stretch * x, ey + stretch * y
    elif seen_right == seen_right:
        right = x - baseline * iz
        square = right * right
        er = right + e0 + e1 * rate * (1.0 + square) + (e2 + e3 * square) * square - seen_right
    return x, y, right, ex, ey, er


@kernel(error_model="numpy", fastmath={"contract"})
def squared_errors(rotations, translations, points, cameras, owners, seen, rates, baseline, extra):
    """(K,) over all images; inf behind the camera."""
    out, e0, e1 = np.empty(len(cameras)), extra[0], extra[1]
    e2, e3 = (extra[2], extra[3]) if len(extra) > 2 else (0.0, 0.0)
    for k in range(len(cameras)):
        c, m = cameras[k], owners[k]
        p0, p1, p2 = points[m, 0], points[m, 1], points[m, 2]
        q0 = rotations[c, 0, 0] * p0 + rotations[c, 0, 1] * p1 + rotations[c, 0, 2] * p2 + translations[c, 0]
        q1 = rotations[c, 1, 0] * p0 + rotations[c, 1, 1] * p1 + rotations[c, 1, 2] * p2 + translations[c, 1]
        q2 = rotations[c, 2, 0] * p0 + rotations[c, 2, 1] * p1 + rotations[c, 2, 2] * p2 + translations[c, 2]
        if q2 > MIN_DEPTH:
            _, _, _, ex, ey, er = _errors(
                q0, q1, q2, seen[k, 0], seen[k, 1], seen[k, 2], baseline, e0, e1, e2, e3, rates[k]
            )
            out[k] = ex * ex + ey * ey + er * er
        else:
            out[k] = np.inf
    return out


@kernel(error_model="numpy")
def robust_cost(squares, scale):
    """Half the sum of log(1 + squared error in scales)."""
    total, product, per = 0.0, 1.0, 1.0 / (scale * scale)
    for k in range(len(squares)):
        # the logarithm of a product of 32 instead of 32 logarithms; 1e6 to the 32nd is still a number
        product *= 1.0 + min(squares[k] * per, GROSS)
        if k % 32 == 31:
            total, product = total + np.log(product), 1.0
    return 0.5 * (total + np.log(product))


@kernel(error_model="numpy", fastmath={"contract"})
def reduce_points(
    scale, damping, blocks, side, corner, inverses, gradients, cross, cross_extra,
    rotations, translations, points, cameras, owners, seen, rates, baseline, extra,
):  # fmt: skip
    """Adds to the normal equations of poses and corrections, the points eliminated; fills what gives those back.

    Of poses: `blocks` (C, C, 6, 6), those with the first index not below the second; `side` (C, E + 1, 6): of the E
    corrections with poses, then the gradient by poses; `corner` (E, E + 1): of the corrections (lower triangle), then
    their gradient. Per point `inverses` (M, 6) of its own 3 x 3 block, `gradients` (M, 3), `cross_extra` (M, E, 3) with
    the corrections; per observation `cross` (K, 12): q, and the 3 x 3 that B' makes the product of pose and point.
    """
    n_obs, k, longest, per, n_extra = len(cameras), 0, 0, 1.0 / (scale * scale), len(extra)
    for i in range(n_obs):
        k = k + 1 if i > 0 and owners[i] == owners[i - 1] else 1
        longest = max(longest, k)
    terms, k, e0, e1 = np.zeros((longest, TERMS + n_extra)), 0, extra[0], extra[1]
    e2, e3 = (extra[2], extra[3]) if n_extra > 2 else (0.0, 0.0)
    for m in range(len(points)):
        begin, p0, p1, p2 = k, points[m, 0], points[m, 1], points[m, 2]
        v00, v01, v02, v11, v12, v22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        b0, b1, b2 = 0.0, 0.0, 0.0
        for e in range(n_extra):
            cross_extra[m, e, 0], cross_extra[m, e, 1], cross_extra[m, e, 2] = 0.0, 0.0, 0.0
        while k < n_obs and owners[k] == m:
            c, n = cameras[k], k - begin
            k += 1
            r00, r01, r02 = rotations[c, 0, 0], rotations[c, 0, 1], rotations[c, 0, 2]
            r10, r11, r12 = rotations[c, 1, 0], rotations[c, 1, 1], rotations[c, 1, 2]
            r20, r21, r22 = rotations[c, 2, 0], rotations[c, 2, 1], rotations[c, 2, 2]
            q0 = r00 * p0 + r01 * p1 + r02 * p2 + translations[c, 0]
            q1 = r10 * p0 + r11 * p1 + r12 * p2 + translations[c, 1]
            q2 = r20 * p0 + r21 * p1 + r22 * p2 + translations[c, 2]
            if q2 <= MIN_DEPTH:
                for a in range(12):
                    cross[k - 1, a] = 0.0
                for a in range(TERMS + n_extra):
                    terms[n, a] = 0.0
                continue
            x, y, xr, ex, ey, er = _errors(
                q0, q1, q2, seen[k - 1, 0], seen[k - 1, 1], seen[k - 1, 2], baseline, e0, e1, e2, e3, rates[k - 1]
            )
            # s: derivative of the errors by (x, y); f: of the right one by right x; u: of all by the first correction
            s00, s01, s11, f, ux, uy, ur, square = 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, xr * xr
            terms[n, TERMS], terms[n, TERMS + 1] = 1.0, rates[k - 1] * (1.0 + square)
            if n_extra > 2:
                terms[n, TERMS + 2], terms[n, TERMS + 3] = square, square * square
            if baseline == 0.0:
                square = x * x + y * y
                terms[n, TERMS + 1] = square
                stretch, bend, ux, uy = 1.0 + e0 + e1 * square, 2.0 * e1, x, y
                s00, s01, s11 = stretch + bend * x * x, bend * x * y, stretch + bend * y * y
            elif seen[k - 1, 2] == seen[k - 1, 2]:
                ur = 1.0
                f = 1.0 + 2.0 * xr * (e1 * rates[k - 1] + e2 + 2.0 * e3 * square)
            # By q, x and y have (1, 0, -x) / z and (0, 1, -y) / z, right x has (1, 0, -right) / z.
            w, iz = per / (1.0 + (ex * ex + ey * ey + er * er) * per), 1.0 / q2
            wz = w * iz
            ww, ff = wz * iz, f * f
            t00, t01, t11 = s00 * s00 + s01 * s01, s01 * (s00 + s11), s01 * s01 + s11 * s11
            tx, ty = t00 * x + t01 * y, t01 * x + t11 * y
            h00, h01, h02 = ww * (t00 + ff), ww * t01, -ww * (tx + ff * xr)
            h11, h12, h22 = ww * t11, -ww * ty, ww * (tx * x + ty * y + ff * xr * xr)
            ax, ay, ar = s00 * ex + s01 * ey, s01 * ex + s11 * ey, f * er
            g0, g1, g2 = wz * (ax + ar), wz * ay, -wz * (ax * x + ay * y + ar * xr)
            ax, ay, ar = s00 * ux + s01 * uy, s01 * ux + s11 * uy, f * ur
            n0, n1, n2 = wz * (ax + ar), wz * ay, -wz * (ax * x + ay * y + ar * xr)
            terms[n, 0], terms[n, 1], terms[n, 2], terms[n, 3], terms[n, 4], terms[n, 5] = h00, h01, h02, h11, h12, h22
            terms[n, 6], terms[n, 7], terms[n, 8] = g0, g1, g2
            terms[n, 9], terms[n, 10], terms[n, 11] = n0, n1, n2
            # by the point: the product of the second derivatives with the rotation, and the rotation's with that
            c00, c01, c02 = (
                h00 * r00 + h01 * r10 + h02 * r20,
                h00 * r01 + h01 * r11 + h02 * r21,
                h00 * r02 + h01 * r12 + h02 * r22,
            )
            c10, c11, c12 = (
                h01 * r00 + h11 * r10 + h12 * r20,
                h01 * r01 + h11 * r11 + h12 * r21,
                h01 * r02 + h11 * r12 + h12 * r22,
            )
            c20, c21, c22 = (
                h02 * r00 + h12 * r10 + h22 * r20,
                h02 * r01 + h12 * r11 + h22 * r21,
                h02 * r02 + h12 * r12 + h22 * r22,
            )
            cross[k - 1, 0], cross[k - 1, 1], cross[k - 1, 2] = q0, q1, q2
            cross[k - 1, 3], cross[k - 1, 4], cross[k - 1, 5] = c00, c01, c02
            cross[k - 1, 6], cross[k - 1, 7], cross[k - 1, 8] = c10, c11, c12
            cross[k - 1, 9], cross[k - 1, 10], cross[k - 1, 11] = c20, c21, c22
            v00 += r00 * c00 + r10 * c10 + r20 * c20
            v01 += r00 * c01 + r10 * c11 + r20 * c21
            v02 += r00 * c02 + r10 * c12 + r20 * c22
            v11 += r01 * c01 + r11 * c11 + r21 * c21
            v12 += r01 * c02 + r11 * c12 + r21 * c22
            v22 += r02 * c02 + r12 * c12 + r22 * c22
            b0 += r00 * g0 + r10 * g1 + r20 * g2
            b1 += r01 * g0 + r11 * g1 + r21 * g2
            b2 += r02 * g0 + r12 * g1 + r22 * g2
            a0, a1, a2 = (
                r00 * n0 + r10 * n1 + r20 * n2,
                r01 * n0 + r11 * n1 + r21 * n2,
                r02 * n0 + r12 * n1 + r22 * n2,
            )
            u2, ue = w * (ux * ux + uy * uy + ur * ur), w * (ux * ex + uy * ey + ur * er)
            for e in range(n_extra):
                h = terms[n, TERMS + e]
                cross_extra[m, e, 0] += h * a0
                cross_extra[m, e, 1] += h * a1
                cross_extra[m, e, 2] += h * a2
                for d in range(e + 1):
                    corner[e, d] += h * terms[n, TERMS + d] * u2
                corner[e, n_extra] += h * ue
        # A share of the block: anything fixed, however little, would hold what is far where it was first thought.
        f = 1e-10 * (v00 + v11 + v22)
        v00, v11, v22 = v00 + damping * v00 + f, v11 + damping * v11 + f, v22 + damping * v22 + f
        c00, c01, c02 = v11 * v22 - v12 * v12, v02 * v12 - v01 * v22, v01 * v12 - v02 * v11
        det = v00 * c00 + v01 * c01 + v02 * c02
        f = 1.0 / det if abs(det) > 1e-300 else 0.0
        i00, i01, i02, i11 = c00 * f, c01 * f, c02 * f, (v00 * v22 - v02 * v02) * f
        i12, i22 = (v01 * v02 - v00 * v12) * f, (v00 * v11 - v01 * v01) * f
        inverses[m, 0], inverses[m, 1], inverses[m, 2] = i00, i01, i02
        inverses[m, 3], inverses[m, 4], inverses[m, 5] = i11, i12, i22
        gradients[m, 0], gradients[m, 1], gradients[m, 2] = b0, b1, b2
        for e in range(n_extra):
            x0, x1, x2 = cross_extra[m, e, 0], cross_extra[m, e, 1], cross_extra[m, e, 2]
            a0, a1, a2 = i00 * x0 + i01 * x1 + i02 * x2, i01 * x0 + i11 * x1 + i12 * x2, i02 * x0 + i12 * x1 + i22 * x2
            for d in range(e + 1):
                corner[e, d] -= cross_extra[m, d, 0] * a0 + cross_extra[m, d, 1] * a1 + cross_extra[m, d, 2] * a2
            corner[e, n_extra] -= b0 * a0 + b1 * a1 + b2 * a2
        for i in range(begin, k):
            c, n, q0, q1, q2 = cameras[i], i - begin, cross[i, 0], cross[i, 1], cross[i, 2]
            # d: this observation's product with the point, times the inverse of the point's own block
            f0, f1, f2 = cross[i, 3], cross[i, 4], cross[i, 5]
            d00, d01, d02 = (
                f0 * i00 + f1 * i01 + f2 * i02,
                f0 * i01 + f1 * i11 + f2 * i12,
                f0 * i02 + f1 * i12 + f2 * i22,
            )
            f0, f1, f2 = cross[i, 6], cross[i, 7], cross[i, 8]
            d10, d11, d12 = (
                f0 * i00 + f1 * i01 + f2 * i02,
                f0 * i01 + f1 * i11 + f2 * i12,
                f0 * i02 + f1 * i12 + f2 * i22,
            )
            f0, f1, f2 = cross[i, 9], cross[i, 10], cross[i, 11]
            d20, d21, d22 = (
                f0 * i00 + f1 * i01 + f2 * i02,
                f0 * i01 + f1 * i11 + f2 * i12,
                f0 * i02 + f1 * i12 + f2 * i22,
            )
            for e in range(n_extra + 1):
                if e < n_extra:
                    h = terms[n, TERMS + e]
                    g0, g1, g2 = h * terms[n, 9], h * terms[n, 10], h * terms[n, 11]
                    f0, f1, f2 = cross_extra[m, e, 0], cross_extra[m, e, 1], cross_extra[m, e, 2]
                else:
                    g0, g1, g2, f0, f1, f2 = terms[n, 6], terms[n, 7], terms[n, 8], b0, b1, b2
                a0 = g0 - (d00 * f0 + d01 * f1 + d02 * f2)
                a1 = g1 - (d10 * f0 + d11 * f1 + d12 * f2)
                a2 = g2 - (d20 * f0 + d21 * f1 + d22 * f2)
                side[c, e, 0] += a0
                side[c, e, 1] += a1
                side[c, e, 2] += a2
                side[c, e, 3] += q1 * a2 - q2 * a1
                side[c, e, 4] += q2 * a0 - q0 * a2
                side[c, e, 5] += q0 * a1 - q1 * a0
            for j in range(i, k):
                o, u0, u1, u2 = cameras[j], cross[j, 0], cross[j, 1], cross[j, 2]
                f0, f1, f2 = cross[j, 3], cross[j, 4], cross[j, 5]
                k00, k01, k02 = (
                    d00 * f0 + d01 * f1 + d02 * f2,
                    d10 * f0 + d11 * f1 + d12 * f2,
                    d20 * f0 + d21 * f1 + d22 * f2,
                )
                f0, f1, f2 = cross[j, 6], cross[j, 7], cross[j, 8]
                k10, k11, k12 = (
                    d00 * f0 + d01 * f1 + d02 * f2,
                    d10 * f0 + d11 * f1 + d12 * f2,
                    d20 * f0 + d21 * f1 + d22 * f2,
                )
                f0, f1, f2 = cross[j, 9], cross[j, 10], cross[j, 11]
                k20, k21, k22 = (
                    d00 * f0 + d01 * f1 + d02 * f2,
                    d10 * f0 + d11 * f1 + d12 * f2,
                    d20 * f0 + d21 * f1 + d22 * f2,
                )
                if i == j:
                    k00, k01, k02 = k00 - terms[n, 0], k01 - terms[n, 1], k02 - terms[n, 2]
                    k10, k11, k12 = k10 - terms[n, 1], k11 - terms[n, 3], k12 - terms[n, 4]
                    k20, k21, k22 = k20 - terms[n, 2], k21 - terms[n, 4], k22 - terms[n, 5]
                # B(u)' K B(q), column by column
                for a0, a1, a2, a in (
                    (k00, k10, k20, 0),
                    (k01, k11, k21, 1),
                    (k02, k12, k22, 2),
                    (q1 * k02 - q2 * k01, q1 * k12 - q2 * k11, q1 * k22 - q2 * k21, 3),
                    (q2 * k00 - q0 * k02, q2 * k10 - q0 * k12, q2 * k20 - q0 * k22, 4),
                    (q0 * k01 - q1 * k00, q0 * k11 - q1 * k10, q0 * k21 - q1 * k20, 5),
                ):
                    blocks[o, c, 0, a] -= a0
                    blocks[o, c, 1, a] -= a1
                    blocks[o, c, 2, a] -= a2
                    blocks[o, c, 3, a] -= u1 * a2 - u2 * a1
                    blocks[o, c, 4, a] -= u2 * a0 - u0 * a2
                    blocks[o, c, 5, a] -= u0 * a1 - u1 * a0


@kernel(error_model="numpy", fastmath={"contract"})
def point_steps(cameras, owners, inverses, gradients, cross, cross_extra, pose_step, extra_step):
    """(M, 3), once the steps of the poses (C, 6) and the corrections (E,) are known; changes `gradients`."""
    out = np.empty((len(gradients), 3))
    for k in range(len(cameras)):
        c, m, q0, q1, q2 = cameras[k], owners[k], cross[k, 0], cross[k, 1], cross[k, 2]
        a0 = pose_step[c, 0] + pose_step[c, 4] * q2 - pose_step[c, 5] * q1
        a1 = pose_step[c, 1] + pose_step[c, 5] * q0 - pose_step[c, 3] * q2
        a2 = pose_step[c, 2] + pose_step[c, 3] * q1 - pose_step[c, 4] * q0
        for d in range(3):
            gradients[m, d] += cross[k, 3 + d] * a0 + cross[k, 6 + d] * a1 + cross[k, 9 + d] * a2
    for m in range(len(out)):
        b0, b1, b2 = -gradients[m, 0], -gradients[m, 1], -gradients[m, 2]
        for e in range(len(extra_step)):
            b0 -= cross_extra[m, e, 0] * extra_step[e]
            b1 -= cross_extra[m, e, 1] * extra_step[e]
            b2 -= cross_extra[m, e, 2] * extra_step[e]
        out[m, 0] = inverses[m, 0] * b0 + inverses[m, 1] * b1 + inverses[m, 2] * b2
        out[m, 1] = inverses[m, 1] * b0 + inverses[m, 3] * b1 + inverses[m, 4] * b2
        out[m, 2] = inverses[m, 2] * b0 + inverses[m, 4] * b1 + inverses[m, 5] * b2
    return out
