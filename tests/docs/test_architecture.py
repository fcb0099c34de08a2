"""The architecture of the documentation names files that exist."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_a_reader_of_stereo_needs_at_most_thirteen_files() -> None:
    text = (ROOT / "docs" / "developers" / "architecture.md").read_text()
    part = text[text.index("## Reading `stereo`") : text.index("## Three traces")]
    files = re.findall(r"^\d+\. `([^`]+)`", part, re.MULTILINE)
    assert 10 <= len(files) <= 13 and files[0].endswith("stereo/estimator.py")
    assert all((ROOT / "ispom" / file).is_file() for file in files)
