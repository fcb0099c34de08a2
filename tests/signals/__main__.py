"""`python -m tests.signals --count 300 --seed S`: sends signals at random moments and shows what went wrong."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

from .commands import COMMANDS
from .inputs import made_inputs
from .run import cases, duration_s, fault


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="how many signals")
    parser.add_argument("--seed", type=int, default=0, help="of the moments")
    parser.add_argument("--case", type=int, nargs="+", default=[], help="these cases only")
    parser.add_argument("--commands", nargs="+", default=list(COMMANDS), choices=list(COMMANDS), help="these only")
    asked = parser.parse_args()
    chosen = [(n, case) for n, case in enumerate(cases(asked.count, asked.seed)) if case.name in asked.commands]
    chosen = [(n, case) for n, case in chosen if not asked.case or n in asked.case]
    faults = 0
    with tempfile.TemporaryDirectory(prefix="signals-inputs-") as name:
        inputs = made_inputs(Path(name))
        takes_s = {}
        for command in asked.commands:
            folder = Path(name) / f"timed-{command}"
            folder.mkdir()
            takes_s[command] = duration_s(command, inputs, folder)
            sys.stdout.write(f"{command} takes {takes_s[command]:.1f} s\n")
            sys.stdout.flush()
        begun_s = time.monotonic()
        for done, (number, case) in enumerate(chosen, 1):
            wrong = fault(case, inputs, takes_s[case.name])
            if wrong or asked.case:
                faults += bool(wrong)
                sys.stdout.write(f"--- case {number}: {case}\n{wrong or 'as it should be'}\n")
            if done % 10 == 0:
                sys.stdout.write(
                    f"{done} of {len(chosen)} done in {time.monotonic() - begun_s:.0f} s, {faults} faults\n"
                )
            sys.stdout.flush()
    sys.stdout.write(f"{len(chosen)} signals, {faults} faults\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
