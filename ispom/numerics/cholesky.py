"""Solves symmetric systems of some hundred unknowns on one thread: for these, a library's threads take longer."""

from __future__ import annotations

import numpy as np

from ispom.kernels import kernel

_MIN_PIVOT = 1e-13
"""Least pivot, relative to its diagonal entry: smaller ones are rounding errors (2e-16 of double precision
times some hundred unknowns), and replaced by it."""


@kernel()
def factor(a):
    """Returns the lower triangular L (n, n) with L L' = a; reads only the lower triangle of a."""
    n = len(a)
    work, column = a.copy(), np.empty(n)
    for k in range(n):
        pivot = np.sqrt(max(work[k, k], _MIN_PIVOT * abs(a[k, k]), 1e-300))
        work[k, k] = pivot
        for i in range(k + 1, n):
            work[i, k] /= pivot
            column[i] = work[i, k]
        for i in range(k + 1, n):
            row, f = work[i], column[i]
            for j in range(k + 1, i + 1):
                row[j] -= f * column[j]
    for k in range(n):
        work[k, k + 1 :] = 0.0
    return work


@kernel()
def solve_factored(lower, b):
    """Returns x (n,) with L L' x = b."""
    n, x = len(b), b.copy()
    for i in range(n):
        for k in range(i):
            x[i] -= lower[i, k] * x[k]
        x[i] /= lower[i, i]
    for i in range(n - 1, -1, -1):
        x[i] /= lower[i, i]
        for k in range(i):
            x[k] -= lower[i, k] * x[i]
    return x


@kernel()
def inverse_factored(lower):
    """Returns the inverse (n, n) of L L'."""
    n = len(lower)
    x, out = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        row = x[i]
        row[i] = 1.0
        for k in range(i):
            f, above = lower[i, k], x[k]
            for j in range(k + 1):
                row[j] -= f * above[j]
        for j in range(i + 1):
            row[j] /= lower[i, i]
    for k in range(n):
        row = x[k]
        for i in range(k + 1):
            f, line = row[i], out[i]
            for j in range(i + 1):
                line[j] += f * row[j]
    for i in range(n):
        for j in range(i):
            out[j, i] = out[i, j]
    return out
