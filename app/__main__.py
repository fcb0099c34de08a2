"""Where the command `ispom` begins: with what takes longest to get ready, before anything else is imported."""

from __future__ import annotations

import _signal  # pyright: ignore[reportMissingImports] (signal takes as long to import as all else here)
import os
import sys


def main() -> int:
    """As `cli.main` of the words on the command line."""
    _end_silently()
    _complete_streams()
    from .cli.refusals import obeyed_file, too_little

    if sentence := obeyed_file() or too_little(sys.argv[1:]):
        sys.stderr.write(f"ispom: {sentence}\n")
        return 2
    words = sys.argv[1:]
    if words[:1] == ["demo"] or (words[:1] == ["app"] and any(word.startswith("sim:") for word in words)):
        from ispom.simulation.rendering.cache import anything_rendered
        from ispom.simulation.rendering.process import render_pool

        if not anything_rendered():
            render_pool().start()
    if any(word.split("=")[0] == "--external" for word in words):
        from .engine.external import add_programs

        if fault := add_programs(words):  # before `options` makes flags of all methods
            sys.stderr.write(f"ispom: {fault}\n")
            return 2
    from .cli.main import main as run

    try:
        return run(words)
    finally:
        _end_rendering()


def _end_rendering() -> None:
    """Ends the processes that render. Without this, Python waits at its end for an image that nobody needs."""
    if (process := sys.modules.get("ispom.simulation.rendering.process")) is not None:
        process.render_pool().end()


def _end_silently() -> None:
    """From here on SIGTERM and Ctrl-C end the process without a word, until a command begins to write. Nothing that
    takes time comes before, the module `signal` included: Python prints a traceback for Ctrl-C."""

    def end(number: int, _: object) -> None:
        os._exit(128 + number)

    for number, usual in ((_signal.SIGINT, _signal.default_int_handler), (_signal.SIGTERM, _signal.SIG_DFL)):
        if _signal.getsignal(number) == usual:  # one that is ignored stays so
            _signal.signal(number, end)


def _complete_streams() -> None:
    """Standard streams that were closed lead nowhere: else the first files opened would get their numbers, and what
    is printed would land in them. Python's standard error gets a descriptor of its own, away from C libraries'."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    from io import TextIOWrapper

    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (until the end)
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    if sys.stderr.fileno() == 2:
        sys.stderr = open(os.dup(2), "w", 1, sys.stderr.encoding, "backslashreplace")  # noqa: SIM115


if __name__ == "__main__":
    sys.exit(main())
