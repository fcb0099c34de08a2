"""Linear algebra in one thread: in several, sums are split differently, and covariances end in other digits."""

from __future__ import annotations

from functools import cache

import scipy.linalg  # noqa: F401  # the compiled kernels use its BLAS: it is loaded before it is limited
from threadpoolctl import ThreadpoolController


def one_thread() -> None:
    """BLAS keeps to one thread in this process from here on, numpy's and scipy's.

    For good, and not around a step: the number is one for the whole process, and what one thread had restored another
    would compute with. Matrices here are too small for several threads to be of use. A BLAS that threadpoolctl does not
    know (Apple's Accelerate) is left as it is.
    """
    _controller().limit(limits=1)


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")
