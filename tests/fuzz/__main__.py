"""`python -m tests.fuzz --count 5000`: works through the cases and shows those that end in anything but a success or
one sentence. `--case N` repeats one of them."""

from __future__ import annotations

import argparse
import sys

from tests.fuzz.run import outcomes
from tests.fuzz.worker import STRANGERS


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--count", type=int, default=5000, help="how many cases")
    parser.add_argument("--case", type=int, nargs="+", default=[], help="these cases only")
    parser.add_argument(
        "--strangers", action="store_true", help="2,000 cases of folders that somebody else handed over"
    )
    asked = parser.parse_args()
    first, count = (STRANGERS, 2000) if asked.strangers else (asked.first, asked.count)
    numbers = asked.case or list(range(first, first + count))
    faults = 0
    for done, (number, what, fault) in enumerate(outcomes(numbers), 1):
        if fault or asked.case:
            faults += bool(fault)
            sys.stdout.write(f"--- case {number}: {what}\n{fault or 'as it should be'}\n")
        if done % 250 == 0:
            sys.stdout.write(f"{done} of {len(numbers)} done, {faults} faults\n")
        sys.stdout.flush()
    sys.stdout.write(f"{len(numbers)} cases, {faults} faults\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
