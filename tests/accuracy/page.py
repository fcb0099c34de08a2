"""Tables of studies in pages of the documentation, between two marks."""

from __future__ import annotations

from pathlib import Path


def marks(study: str) -> tuple[str, str]:
    """Returns the lines between which the table of a study stands."""
    return f"<!-- python -m tests.accuracy {study}: begin -->", f"<!-- python -m tests.accuracy {study}: end -->"


def write_between(page: Path, study: str, text: str) -> None:
    """Replaces what stands between the marks. Raises ValueError where the page has none."""
    begin, end = marks(study)
    before, _, rest = page.read_text(encoding="utf-8").partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise ValueError(f"{page} has no lines '{begin}' and '{end}'")
    page.write_text(f"{before}{begin}\n\n{text}\n\n{end}{after}", encoding="utf-8")
