"""A process that works through cases, one after the other, and says what came of each: `python -m tests.fuzz.worker`.

A case may use CPU_S of processor time, however busy the machine is; after that the system ends the process. What waits
without computing is found by whoever started it.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import sys
import traceback
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.sequences import open_sequence
from tests.app.helpers import build
from tests.fuzz.corpus import READ, Item, make_corpus
from tests.fuzz.mutations import mutate
from tests.fuzz.strangers import ACTIONS, make_strangers

STRANGERS = 1_000_000
"""The cases from this number on are of the folders in `tests/fuzz/strangers.py`."""
CPU_S = 60
MORE_MEMORY_KB = 500_000
"""The highest the process may rise above what the largest case before took."""


def work(numbers: list[int]) -> None:
    """Prints a line of JSON per case: its number, what was done, and what is wrong with the outcome ("" if nothing)."""
    out = os.fdopen(os.dup(1), "w")
    with TemporaryDirectory() as root:
        folder = Path(root) / "case"
        with redirect_stdout(StringIO()):
            others = make_corpus(Path(root) / "whole") if min(numbers) < STRANGERS else []
            strangers = make_strangers(Path(root) / "strangers", folder) if max(numbers) >= STRANGERS else []
        for number in numbers:
            corpus = strangers if number >= STRANGERS else others
            sys.stderr.flush()
            print(json.dumps([number, "begun", ""]), file=out, flush=True)
            what, fault = _case(number, corpus, folder)
            print(json.dumps([number, what, fault]), file=out, flush=True)
            shutil.rmtree(folder)


def _case(number: int, corpus: list[Item], folder: Path) -> tuple[str, str]:
    random = Random(number)
    item = random.choices(corpus, [item.weight for item in corpus])[0]
    shutil.copytree(item.folder, folder, symlinks=True)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    texts = [path for path in files if path.suffix != ".png"]  # which are few beside images
    command = tuple(word.replace("{}", str(folder)) for word in random.choice(item.commands))
    named = [path for path in files if str(path) in command]  # where a command names files, others hardly matter
    change = mutate(random.choice(named or texts or files if random.random() < 0.7 else files), random)
    what = f"{item.name}: {change}: {' '.join(command)}"
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    used_s = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
    resource.setrlimit(resource.RLIMIT_CPU, (int(used_s) + CPU_S, resource.RLIM_INFINITY))
    fault = _outcome(command, folder.parent / "descriptor-2")
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    if not fault and grown_kb > MORE_MEMORY_KB:
        fault = f"took {grown_kb / 1e3:.0f} MB"
    return what, fault


def _outcome(command: tuple[str, ...], chatter: Path) -> str:
    """What is wrong with it: anything but success, or one sentence with code 2, and nothing from any decoder."""
    said, kept = StringIO(), os.dup(2)
    with chatter.open("wb") as file:
        os.dup2(file.fileno(), 2)
    try:
        with redirect_stderr(said), redirect_stdout(StringIO()):
            action = _read if command[0] == READ else ACTIONS.get(command[0])
            code = _acted(action, command[1]) if action is not None else main(list(command), build)
    except SystemExit as end:
        code = end.code
    except BaseException:
        return traceback.format_exc()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
    if text := chatter.read_text(errors="replace"):
        return f"written to descriptor 2: {text[:500]}"
    sentence = said.getvalue()
    if code == 0 and not sentence:
        return ""
    good = code == 2 and sentence.startswith("ispom: ") and sentence.count("\n") == 1 and sentence[:-1].isprintable()
    return "" if good else f"code {code}, said {sentence[:2000]!r}"


def _acted(action: Callable[[str], None], what: str) -> int:
    try:
        action(what)
    except InputError as mistake:
        sys.stderr.write(f"ispom: {mistake}\n")
        return 2
    return 0


def _read(source: str) -> None:
    sequence = open_sequence(source)
    for i in range(len(sequence)):
        sequence[i]


if __name__ == "__main__":
    work(json.loads(sys.argv[1]))
