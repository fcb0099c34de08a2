"""`python -m tests.docs.examples PAGE ... --data DATA`: makes the example of how-tos by running their own commands.

A page has the mark `<!-- python -m tests.docs.examples PAGE: begin -->` and one for the end. The block of commands
above it is run in an empty folder, in which the folders of DATA are linked, and what its last line prints stands
between the marks. Long lines are wrapped, and `[...]` stands for what is left out.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path
from tempfile import TemporaryDirectory

from .commands import ROOT

HOWTO = ROOT / "docs" / "howto"
WIDTH = 88
SHOWN = {
    "evaluate": r"[┃├│┏┡└]|audit of",
    "judge": r"(?!stretch|\d)",
    "doctor": r"Frames|The likely|What to do|  1\.",
    "shrink": r" +(1|12|17)  |(?! *\d+  )",
    "loops": r"(?!loop )|loop 1-276 ",
}
"""By page: the lines that are shown of what is printed, where not all are."""
LONGEST = 420
"""Characters of a line that is shown; its end is left out."""
CUT = "[...]"


def marks(page: str) -> tuple[str, str]:
    """Returns the lines before and after the example of a page."""
    begin, end = (f"<!-- python -m tests.docs.examples {page}: {word} -->" for word in ("begin", "end"))
    return begin, end


def commands(text: str) -> str:
    """Returns the last block of commands of what stands above an example."""
    return re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)[-1]


def printed(block: str, folder: Path, data: Path | None) -> str:
    """Runs the lines of a block in a folder, and returns what the last one prints."""
    for entry in [] if data is None else sorted(data.iterdir()):
        (folder / entry.name).symlink_to(entry.resolve())
    (folder / "loops_lap.py").write_bytes((HOWTO / "loops_lap.py").read_bytes())
    *before, last = block.strip().splitlines()
    path = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}

    def run(lines: str) -> str:
        ended = subprocess.run(
            ["bash", "-c", lines], cwd=folder, env=os.environ | path, stdout=subprocess.PIPE, text=True, check=False
        )
        return ended.stdout

    run("\n".join(before))
    return run(last).replace(str(folder), "/data")


def shown(page: str, text: str) -> str:
    """Returns the lines that a page shows."""
    lines = list[str]()
    for line in text.rstrip().splitlines():
        if not re.match(SHOWN.get(page, ""), line):
            lines += [] if lines[-1:] == [CUT] else [CUT]
            continue
        kept = line if len(line) <= LONGEST else f"{line[:LONGEST].rpartition(' ')[0]} {CUT}"
        indent = " " * (2 + len(line) - len(line.lstrip()))
        lines += _wrapped(kept.rstrip(), indent) or [""]
    return "\n".join(lines).removeprefix(f"{CUT}\n").removesuffix(f"\n{CUT}")


def _wrapped(line: str, indent: str) -> list[str]:
    line = re.sub(rf"(\S{{60,{WIDTH - 8}}},)(?=\S)", r"\1 ", line)  # a long list goes on after a comma
    return textwrap.wrap(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)


def made(page: str, text: str, data: Path | None) -> str:
    """Returns the text of a page with its example made anew. ValueError where it has no marks."""
    begin, end = marks(page)
    before, _, rest = text.partition(begin)
    _, mark, after = rest.partition(end)
    if not mark:
        raise ValueError(f"{page}.md has no lines '{begin}' and '{end}'")
    with TemporaryDirectory() as folder:
        lines = shown(page, printed(commands(before), Path(folder).resolve(), data))
    return f"{before}{begin}\n\n```text\n{lines}\n```\n\n{end}{after}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("pages", nargs="+")
    parser.add_argument("--data", type=Path)
    given = parser.parse_args()
    for page in given.pages:
        path = HOWTO / f"{page}.md"
        path.write_text(made(page, path.read_text(encoding="utf-8"), given.data), encoding="utf-8")


if __name__ == "__main__":
    main()
