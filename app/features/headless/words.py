"""The command line that runs the same again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from ispom.methods import method


def run_words(
    source: str, methods: Iterable[str], config: Mapping[str, Mapping[str, Any]], external: Iterable[str] = ()
) -> list[str]:
    """Returns the command that runs these methods over a source, with every setting that is not its default."""
    words = ["ispom", "run", source, "--methods", *methods]
    words += [word for each in external for word in ("--external", each)]
    for name, values in config.items():
        words += flags(values, asdict(method(name).config()), f"{name}.")
    return words


def flags(values: Mapping[str, Any], defaults: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yields the flags, with their values, of what is not as by default; all names begin with the prefix."""
    for name, value in values.items():
        flag = f"{prefix}{name.replace('_', '-')}"
        if isinstance(value, dict) and isinstance(defaults.get(name), dict):
            yield from flags(value, defaults[name], f"{flag}.")
        elif value != defaults.get(name):
            if isinstance(value, bool):
                yield f"--{prefix}{'' if value else 'no-'}{name.replace('_', '-')}"
            else:
                yield from (f"--{flag}", *map(str, value if isinstance(value, list | tuple) else (value,)))
