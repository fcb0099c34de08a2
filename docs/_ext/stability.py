"""What is experimental. Pages of methods, commands and the Python API repeat the level of their subject."""

from __future__ import annotations

from markdown_text import table

COMMANDS = {
    "blame": "which tracks and sensors moved a pose",
    "budget": "its shares are tested in simulations only",
    "doctor": "causes are added, and their words change",
    "gate": "how many runs decide may change",
    "grade": "marks of a course",
    "judge": "its limits come from few recordings",
    "loops": "what-if decisions",
    "mcp": "tools for agents are added and renamed",
    "passport": "new; its file has a version",
    "publish": "the published page",
    "shrink": "the folder that it writes",
    "triage": "groups and their words",
    "undecided": "new, tested in simulations and on few recordings",
}
"""Commands that may change with each release, and what in them."""
METHODS = "All methods of the survey, thus all but `monocular`, `stereo`, `integrated` and their `.paper` variants"
MODULES = {
    "ispom.notebook": "`run`, `stepper`, `read_run` and `register` are not in a release yet",
    "ispom.sensors": "how a kind of sensor takes part in `fused` was changed often",
}
"""Public modules of `import ispom` that may change with each release, and why."""
STABLE = "Stable: see [what is stable]({}stability.md)."
EXPERIMENTAL = "**Experimental**: it may change with each release ([what is stable]({}stability.md))."


def of_command(name: str, home: str) -> str:
    """Returns the sentence about a command, for a page from which the top of the site is at `home`."""
    return (EXPERIMENTAL if name in COMMANDS else STABLE).format(home)


def of_method(survey: bool, home: str) -> str:
    """Returns the sentence about a method of this package."""
    return (EXPERIMENTAL if survey else STABLE).format(home)


def of_modules(modules: tuple[str, ...], home: str) -> str:
    """Returns the sentence about a group of public modules: they are of one level."""
    (level,) = {name in MODULES for name in modules}
    return (EXPERIMENTAL if level else STABLE).format(home)


def of_name(home: str) -> str:
    """Returns the level of a public name that is defined in a module, as reStructuredText."""
    experimental = any(f"{home}.".startswith(f"{name}.") for name in MODULES)
    return "**Experimental.**" if experimental else "*Stable.*"


def pages() -> dict[str, str]:
    """Returns the table of all that is experimental."""
    rows = [("methods", METHODS, "each stands for a row of the paper's survey; figures are of few recordings")]
    rows += [("command", f"[`ispom {name}`](reference/command_line/{name}.md)", why) for name, why in COMMANDS.items()]
    rows += [("names of `import ispom`", f"those that are defined in `{name}`", why) for name, why in MODULES.items()]
    return {"_generated/experimental.md": table(("what", "which", "what may change, or why"), rows)}
