"""States how long the sentences of README and documentation are: `python docs/language.py`.

Tables and code do not count: their parts are no sentences.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
LONGEST_MEAN = 25.0
"""Words per sentence of a page, on average."""
NOT_PROSE = (
    "docs/_",
    "docs/reference/checks.md",
    "docs/reference/python_api.md",
)


def pages() -> list[Path]:
    """Returns README, CONTRIBUTING and the pages of docs."""
    found = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [path for path in found if not path.relative_to(ROOT).as_posix().startswith(NOT_PROSE)]


def sentences(text: str) -> list[str]:
    """Returns the sentences of a page's paragraphs and list items."""
    text = re.sub(r"^(```|:::).*?^\1", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text)
    blocks: list[str] = []
    for line in text.split("\n"):
        if re.match(r"\s*(#|\||\(.*\)=)", line) or not line.strip():
            blocks.append("")
        elif re.match(r"\s*([-*]|\d+\.)\s", line) or not blocks:
            blocks.append(re.sub(r"^\s*([-*]|\d+\.)\s", "", line))
        else:
            blocks[-1] = f"{blocks[-1]} {line.strip()}".strip()
    found = [part for block in blocks for part in re.split(r"(?<=[.!?])[\"”)*`]*\s+(?=[\"“(*`\[]*[A-Z0-9`])", block)]
    return [sentence for sentence in found if len(sentence.split()) > 2]


def mean_words(text: str) -> float:
    """Returns the average number of words of a page's sentences; 0 for a page without any."""
    lengths = [len(sentence.split()) for sentence in sentences(text)]
    return sum(lengths) / len(lengths) if lengths else 0.0


def main() -> int:
    """Prints the average of each page, and the longest sentences. Returns 1 where a page is above the limit."""
    rows = sorted(((mean_words(path.read_text(encoding="utf-8")), path) for path in pages()), reverse=True)
    for mean, path in rows:
        sys.stdout.write(f"{mean:5.1f}  {path.relative_to(ROOT)}\n")
    everything = " \n\n".join(path.read_text(encoding="utf-8") for path in pages())
    sys.stdout.write(f"{mean_words(everything):5.1f}  all pages\n\nThe longest sentences:\n")
    for sentence in sorted(sentences(everything), key=lambda s: -len(s.split()))[:8]:
        sys.stdout.write(f"  {len(sentence.split())}: {sentence[:160]}\n")
    return int(rows[0][0] > LONGEST_MEAN)


if __name__ == "__main__":
    sys.exit(main())
