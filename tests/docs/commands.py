"""The command lines of README and documentation, and a process that parses them as the program does."""

from __future__ import annotations

import json
import re
import shlex
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

ROOT = Path(__file__).parents[2]


def pages() -> list[Path]:
    """README, CONTRIBUTING, the pages of docs that people write, and READMEs of examples and recordings."""
    docs = [
        path for path in (ROOT / "docs").rglob("*.md") if not path.relative_to(ROOT / "docs").parts[0].startswith("_")
    ]
    written = [path for path in docs if not path.read_text(encoding="utf-8").startswith("<!-- generated")]
    others = [*(ROOT / "examples").rglob("*.md"), *(ROOT / "recordings").glob("README.md")]
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(written), *sorted(others)]


def command_lines(text: str) -> list[list[str]]:
    """The words of each `ispom ...` line in blocks of shell commands."""
    found = []
    for block in re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            for part in line.split(" && "):
                words = shlex.split(part, comments=True)
                if words and Path(words[0]).name == "ispom":
                    found.append(words[1:])
    return found


INSTALLED = {
    "orb/bin/ispom-orbslam3": "examples/orbslam3/ispom_orbslam3.py",
    "svo/bin/ispom-svo": "examples/svo/ispom_svo.py",
}
"""Programs that readers install from examples, and the file that each of them runs."""


def installed(word: str) -> str:
    """Returns a word of a command line, with the files of the examples instead of programs that are not here."""
    for program, file in INSTALLED.items():
        word = word.replace(program, shlex.join([Path(sys.executable).as_posix(), (ROOT / file).as_posix()]))
    return word


def main() -> None:
    """Reads command lines as JSON from standard input, and prints what is wrong with each, or nothing."""
    from ispom.errors import InputError
    from ispom.methods import add, names

    sys.path.insert(0, str(ROOT / "examples" / "own_estimator"))
    from own_estimator import METHOD  # type: ignore[import-not-found]

    lines = [[installed(word) for word in words] for words in json.load(sys.stdin)]
    add(METHOD)
    from ispom_app.engine.external import add_programs

    for words in lines:
        fault = add_programs(words)
        if fault and "which there is already" not in fault:
            print(json.dumps([words, fault]))  # noqa: T201
    from ispom_app.cli.commands import COMMANDS
    from ispom_app.engine.conditions.parser import parse
    from ispom_app.engine.history.quantities import quantities

    known, names_of = COMMANDS.items(), quantities(names())
    for words in lines or [[]]:
        if not words:  # `ispom` alone opens the start screen
            continue
        said = StringIO()
        try:
            with redirect_stderr(said), redirect_stdout(said):
                options = known[words[0]].read(words[1:])
            if until := getattr(options, "until", None):
                parse(until, names_of)
        except (SystemExit, KeyError, InputError) as fault:
            print(json.dumps([words, f"{fault!r} {said.getvalue()[-600:]}"]))  # noqa: T201


if __name__ == "__main__":
    main()
