"""`python -m tests.docs.budget_example DATA`: makes the example of docs/howto/budget.md from KITTI 06 in a folder."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

from ispom_app.cli.main import main as ispom

from .commands import ROOT

PAGE = ROOT / "docs" / "howto" / "budget.md"
BEGIN, END = "<!-- python -m tests.docs.budget_example: begin -->", "<!-- python -m tests.docs.budget_example: end -->"


def example(data: Path) -> str:
    """Returns what the commands of the page print."""
    with TemporaryDirectory() as folder:
        run = str(Path(folder) / "run")
        words = ["run", str(data / "kitti" / "sequences" / "06"), "--max-exposures", "51", "--methods", "stereo"]
        ispom([*words, "--no-recording", "--out", run])
        printed = StringIO()
        with redirect_stdout(printed):
            ispom(["budget", run])
    return printed.getvalue()


def main(data: Path) -> None:
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{PAGE} has no lines '{BEGIN}' and '{END}'")
    lines = "\n".join(line.rstrip() for line in example(data).splitlines())
    PAGE.write_text(f"{before}{BEGIN}\n\n```text\n{lines}\n```\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
