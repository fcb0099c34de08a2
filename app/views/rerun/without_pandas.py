"""Keeps pandas out of a process that has no use for it.

With its first array pyarrow imports pandas, where something has brought one into the environment, to ask whether the
values are pandas'. Rerun makes many arrays, none of them from pandas: 40 MB and a second of each start for a no.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any


class _Absent:
    """Finds that there is no pandas."""

    @staticmethod
    def find_spec(name: str, _path: Sequence[str] | None = None, _target: Any = None) -> None:
        if name == "pandas":
            raise ModuleNotFoundError("not wanted here", name=name)


def spare_pandas() -> None:
    """Has pyarrow ask now, and find none; for others pandas stays what it is. Nothing, where it is there already.

    Comes before Rerun's entities are imported: those make arrays at once.
    """
    if "pandas" in sys.modules:
        return
    import pyarrow  # not before its allocator is chosen

    finder: Any = _Absent()
    sys.meta_path.insert(0, finder)
    try:
        pyarrow.array([0])
    finally:
        sys.meta_path.remove(finder)
