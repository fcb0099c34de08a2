"""The renderer's first compilation, in a process of its own: in this one it would hold up the page for seconds."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import ispom.simulation
from ispom.types import Sequence

COMPILE = "from ispom.sequences.simulated import compile_renderer; compile_renderer()"


def compiled_before() -> bool:
    """Whether numba kept the renderer's machine code beside its source. A wrong no costs a second, a wrong yes more."""
    return any(Path(ispom.simulation.__path__[0]).glob("__pycache__/renderer._shade*.nbc"))


def compiling_ahead(opener: Callable[[str], Sequence]) -> Callable[[str], Sequence]:
    """Begins to compile at once where that is still to be done; the returned opener waits for it with simulations."""
    if compiled_before():
        return opener
    process = subprocess.Popen([sys.executable, "-c", COMPILE], stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def open_compiled(source: str) -> Sequence:
        # Whatever became of it: what is not compiled then is compiled when it is needed.
        if source.startswith("sim:"):
            process.wait()
        return opener(source)

    return open_compiled
