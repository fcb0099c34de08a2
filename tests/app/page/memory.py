"""What a browser and the app hold of memory, process by process."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import psutil


def of_browser() -> Counter[str]:
    """Bytes of the Chromium that this process started, by kind of process: browser, renderer, gpu-process ..."""
    return of(p for p in psutil.Process().children(recursive=True) if "chrom" in p.name())


def of_app(pid: int) -> Counter[str]:
    """Bytes of the app and the processes that it started."""
    app = psutil.Process(pid)
    return of([app, *app.children(recursive=True)])


def of(processes: Iterable[psutil.Process]) -> Counter[str]:
    """Bytes by kind. What processes share counts once where the system tells (PSS, on Linux); else in each (RSS)."""
    found = Counter[str]()
    for process in processes:
        try:
            words, held = process.cmdline(), process.memory_full_info()
        except psutil.Error:  # it ended meanwhile
            continue
        kind = next((word.removeprefix("--type=") for word in words if word.startswith("--type=")), process.name())
        found[kind] += getattr(held, "pss", held.rss)
    return found
