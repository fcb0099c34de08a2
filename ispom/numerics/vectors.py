"""3-vectors and 3 x 3 matrices for compiled loops, as tuples of numbers, which are kept in registers.

A matrix is a tuple of its rows, a symmetric one (00, 01, 02, 11, 12, 22).
"""

from __future__ import annotations

from ispom.kernels import part


@part
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@part
def plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@part
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@part
def plus6(a, b):
    """Of symmetric matrices."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]


@part
def scaled(f, a):
    return f * a[0], f * a[1], f * a[2]


@part
def vector(array, i, first=0):
    """Row i of an array (N, 3), or three of more columns from `first` on."""
    return array[i, first], array[i, first + 1], array[i, first + 2]


@part
def matrix(array, i):
    """Matrix i of an array (N, 3, 3)."""
    return (
        (array[i, 0, 0], array[i, 0, 1], array[i, 0, 2]),
        (array[i, 1, 0], array[i, 1, 1], array[i, 1, 2]),
        (array[i, 2, 0], array[i, 2, 1], array[i, 2, 2]),
    )


@part
def vector3(array, i, j):
    """Vector i, j of an array (N, M, 3)."""
    return array[i, j, 0], array[i, j, 1], array[i, j, 2]


@part
def vector6(array, i):
    """Row i of an array (N, 6)."""
    return array[i, 0], array[i, 1], array[i, 2], array[i, 3], array[i, 4], array[i, 5]


@part
def store(array, i, v, first=0):
    """Writes to row i of an array (N, 3), or to three of more columns from `first` on."""
    array[i, first], array[i, first + 1], array[i, first + 2] = v


@part
def store_matrix(array, i, m):
    """Writes to matrix i of an array (N, 3, 3)."""
    store(array[i], 0, m[0])
    store(array[i], 1, m[1])
    store(array[i], 2, m[2])


@part
def store6(array, i, s):
    """Writes to row i of an array (N, 6)."""
    array[i, 0], array[i, 1], array[i, 2], array[i, 3], array[i, 4], array[i, 5] = s


@part
def transposed(m):
    a, b, c = m
    return (a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2])


@part
def times(m, v):
    """m v."""
    return dot(m[0], v), dot(m[1], v), dot(m[2], v)


@part
def times_transposed(m, v):
    """m' v."""
    a, b, c = m
    return (
        a[0] * v[0] + b[0] * v[1] + c[0] * v[2],
        a[1] * v[0] + b[1] * v[1] + c[1] * v[2],
        a[2] * v[0] + b[2] * v[1] + c[2] * v[2],
    )


@part
def product(m, n):
    """m n."""
    return times_transposed(n, m[0]), times_transposed(n, m[1]), times_transposed(n, m[2])


@part
def product_transposed(m, n):
    """m n'."""
    return times(n, m[0]), times(n, m[1]), times(n, m[2])


@part
def congruent(m, s):
    """s m, and the six numbers of m' s m, of a symmetric s."""
    right = product(symmetric(s), m)
    a, b, c = transposed(m)
    x, y, z = transposed(right)
    return right, (dot(a, x), dot(a, y), dot(a, z), dot(b, y), dot(b, z), dot(c, z))


@part
def plus_square(s, f, v):
    """A symmetric matrix, given by six, plus f v v'."""
    a, b, c = scaled(f, v)
    return s[0] + a * v[0], s[1] + a * v[1], s[2] + a * v[2], s[3] + b * v[1], s[4] + b * v[2], s[5] + c * v[2]


@part
def symmetric(s):
    """All nine entries of a symmetric matrix given by six."""
    return (s[0], s[1], s[2]), (s[1], s[3], s[4]), (s[2], s[4], s[5])


@part
def inverse(s):
    """The inverse, six numbers, of a symmetric matrix; zero for a singular one."""
    c00, c01, c02 = s[3] * s[5] - s[4] * s[4], s[2] * s[4] - s[1] * s[5], s[1] * s[4] - s[2] * s[3]
    determinant = s[0] * c00 + s[1] * c01 + s[2] * c02
    f = 1.0 / determinant if abs(determinant) > 1e-300 else 0.0
    return (
        c00 * f,
        c01 * f,
        c02 * f,
        (s[0] * s[5] - s[2] * s[2]) * f,
        (s[1] * s[2] - s[0] * s[4]) * f,
        (s[0] * s[3] - s[1] * s[1]) * f,
    )


@part
def inverse_by_pivots(s):
    """The same for a positive definite matrix, zero for others; by L D L', which is more accurate for far points."""
    a, b, c = s[0], s[1], s[2]
    if a <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    p, q = b / a, c / a
    second, mixed = s[3] - p * b, s[4] - q * b
    if second <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = mixed / second
    third = s[5] - q * c - r * mixed
    if third <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    first, second, third, u = 1.0 / a, 1.0 / second, 1.0 / third, p * r - q
    return (
        first + p * p * second + u * u * third,
        -p * second - u * r * third,
        u * third,
        second + r * r * third,
        -r * third,
        third,
    )


@part
def damped(s, damping):
    """Returns a point's damped block, six numbers, for its inverse."""
    # The damping is relative to the block: any constant, however small, would hold far points at their first position.
    # Without damping, a point that diverges beyond its anchor leaves a reduced Hessian that is indefinite by rounding.
    a, b, c = s[0], s[3], s[5]
    least = 1e-10 * (a + b + c)
    return a + damping * a + least, s[1], s[2], b + damping * b + least, s[4], c + damping * c + least


@part
def damped_of_pair(s, damping):
    """The same for a point that a pair observes: its disparity determines the depth, so much less damping is enough."""
    a, b, c = s[0], s[3], s[5]
    least = 1e-14 * (a + b + c)
    return a + damping * a + least, s[1], s[2], b + damping * b + least, s[4], c + damping * c + least
