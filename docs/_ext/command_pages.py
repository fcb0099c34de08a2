"""A page for each command of the command line, from its own parser; settings of methods are on the methods' pages."""

from __future__ import annotations

import re
import warnings
from dataclasses import fields

from markdown_text import as_cell, table
from stability import of_command


def pages() -> dict[str, str]:
    """Returns a page for each command, and the table of all of them."""
    import tyro
    from ispom_app.cli.commands import COMMANDS

    found, rows = {}, []
    for name, command in COMMANDS.items().items():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            parser = tyro.extras.get_parser(command.options_class(), prog=f"ispom {name}")
        own = [action for action in parser._actions if action.dest != "help"]
        words = " ".join((parser.description or "").split())
        if command.listed:
            rows.append((f"[`ispom {name}`](command_line/{name}.md)", as_cell(words)))
        places, flags = [a for a in own if not a.option_strings], [a for a in own if a.option_strings]
        text = [f"# `ispom {name}`", as_cell(words), of_command(name, "../../")]
        if places:
            text += ["## Arguments", table(("argument", "meaning"), [(f"`{a.dest}`", _help(a)) for a in places])]
        if flags:
            text += ["## Options", table(("option", "values", "meaning"), [_flag(a) for a in flags])]
        if "settings" in {f.name for f in fields(command.options_class())}:
            text.append(
                "Every setting of a method is an option, too, such as `--stereo.max-tracks 300`. "
                "The [pages of the methods](../../methods/index.md) list them."
            )
        found[f"reference/command_line/{name}.md"] = "\n\n".join(text)
    found["_generated/commands.md"] = table(("command", "what it does"), rows)
    return found


def _help(action) -> str:
    return as_cell(re.sub(r"\x1b\[[0-9;]*m", "", action.help or ""))


def _flag(action) -> tuple[str, str, str]:
    names = ", ".join(f"`{name}`" for name in action.option_strings)
    values = "" if action.nargs == 0 else str(action.metavar or "")
    values = f"`{values}`" if values else ""
    return names, values.replace("|", "\\|"), _help(action)
