"""scipy, without the parts of numpy that it would only copy the names of.

Its wrapper of numpy takes over every name there is, and so has all of numpy loaded: its compiler of Fortran, what its
tests need, masked arrays. Nothing here uses them: 7 MB and a tenth of a second of each start. Who does still gets them.

What is imported first of scipy is to come from here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np


@contextmanager
def _what_is_loaded() -> Iterator[None]:
    """numpy names no modules meanwhile that it would load when they are asked for."""
    numpy: Any = np
    every, listing = numpy.__all__, numpy.__dir__
    numpy.__all__ = [name for name in every if name in vars(np)]
    numpy.__dir__ = lambda: list(vars(np))
    try:
        yield
    finally:
        numpy.__all__, numpy.__dir__ = every, listing


with _what_is_loaded():
    import scipy.linalg
    from scipy.spatial.transform import Rotation, Slerp

__all__ = ["Rotation", "Slerp", "scipy"]
