"""Files of the working directory that libraries obey: with them, a stranger's folder changes what is computed."""

from __future__ import annotations

import os

OBEYED = {".numba_config.yaml": "numba", "matplotlibrc": "Matplotlib"}
"""Numba and Matplotlib look for these first, in whatever folder they are started. A file of aliases hangs numba, and
`text.usetex` has Matplotlib start TeX."""


def refusal() -> str | None:
    """One sentence where the working directory holds such a file; None where it holds none."""
    for name, library in OBEYED.items():
        if os.path.exists(name) and not os.path.isdir(name):
            return (
                f"the working directory holds {name}, which {library} would obey: start in another folder, or remove it"
            )
    return None
