"""Where the command `ispom` begins: with what takes longest to get ready, before anything else is imported."""

from __future__ import annotations

import sys


def main() -> int:
    """As `cli.main` of the words on the command line."""
    words = sys.argv[1:]
    if words[:1] == ["demo"] or (words[:1] == ["app"] and any(word.startswith("sim:") for word in words)):
        from ispom.simulation.cache import anything_rendered
        from ispom.simulation.process import render_pool

        if not anything_rendered():
            render_pool().start()
    from .cli import main as run

    return run(words)


if __name__ == "__main__":
    sys.exit(main())
