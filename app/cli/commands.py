"""The commands of `ispom`: a table. Packages add some by the entry point `ispom.commands`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import tyro

from ispom.registry import Registry, named

from ..engine.options import ReadsRuns, with_flags
from ..engine.playback import Builder

APP = __name__.partition(".")[0]


@dataclass(frozen=True)
class Command:
    """One command. Both parts are named as MODULE:NAME, from a dot on within the app, and imported when they are
    needed: help texts wait for no viewer and no ray caster. A package may give them themselves."""

    name: str
    options: str | type
    """A frozen dataclass, whose docstrings are the help."""
    function: str | Callable[..., int]
    """Takes the options and what is below, and returns the exit code."""
    needs: tuple[Literal["words", "builder"], ...] = ()
    """What it gets besides the options, in this order: the words after its name, what makes the estimators."""

    writes: str | type | None = None
    """The type of the JSON that it writes, a `msgspec.Struct`; `ispom schema` prints its schema."""
    listed: bool = True
    """Whether the list of all commands has it: not where an option of the others does the same."""

    def options_class(self) -> Any:
        """Returns the class of its options."""
        return self.options if isinstance(self.options, type) else named(self.options, APP)

    def written(self) -> type | None:
        """Returns the type of what it writes as JSON; None where it writes none, or its own way."""
        return named(self.writes, APP) if isinstance(self.writes, str) else self.writes

    def read(self, words: Sequence[str]) -> Any:
        """Returns its options from the words after its name. Raises SystemExit for help, and after a mistake."""
        options = with_flags(self.options_class(), words)
        return tyro.cli(options, prog=f"ispom {self.name}", args=words)

    def execute(self, options: Any, words: Sequence[str], builder: Builder) -> int:
        """Carries the command out, and returns the exit code. Runs that it reads and that were killed are finished
        first; InputError where they are not."""
        if isinstance(options, ReadsRuns) and (unfinished := options.unfinished()):
            from ..features.recording.finishing import finish_first

            finish_first(unfinished, options.repair)
        given = {"words": words, "builder": builder}
        function = named(self.function, APP) if isinstance(self.function, str) else self.function
        return function(options, *(given[need] for need in self.needs))


B = ("builder",)
"""For those that make estimators."""
COMMANDS = Registry(
    "ispom.commands",
    Command,
    "command",
    (
        Command("demo", ".features.page.options:Demo", ".features.page.command:open_page", B),
        Command("app", ".features.page.options:App", ".features.page.command:open_page", B),
        Command("learn", ".features.page.options:Learn", ".features.page.command:open_page", B),
        Command("run", ".features.headless.options:Run", ".features.headless.command:run", B),
        Command(
            "experiment", ".features.experiments.options:Experiment", ".features.experiments.command:experiment", B
        ),
        Command(
            "triage",
            ".features.triage.options:Triage",
            ".features.triage.command:triage",
            B,
            writes=".features.triage.written:TriageFile",
        ),
        Command(
            "shrink",
            ".features.shrink.options:Shrink",
            ".features.shrink.command:shrink",
            B,
            writes=".features.shrink.expected:Expected",
        ),
        Command("fork", ".features.headless.options:Fork", ".features.headless.fork:fork", ("words", "builder")),
        Command("diff", ".features.diff.options:Diff", ".features.diff.command:diff"),
        Command("gate", ".features.gate.options:Gate", ".features.gate.command:gate", B),
        Command("mcp", ".features.agents.options:Mcp", ".features.agents.command:serve", B),
        Command("sources", ".features.sources.description:Sources", ".features.sources.description:sources"),
        Command("calibrate", ".features.calibration.options:Calibrate", ".features.calibration.command:calibrate"),
        Command("blame", ".features.blame.options:Blame", ".features.blame.command:blame", B),
        Command(
            "budget",
            ".features.budget.options:Budget",
            ".features.budget.command:budget",
            B,
            writes=".features.budget.written:BudgetFile",
        ),
        Command(
            "loops",
            ".features.loops.options:Loops",
            ".features.loops.command:loops",
            B,
            writes=".features.loops.candidate:Court",
        ),
        Command(
            "evaluate",
            ".features.evaluation.options:Evaluate",
            ".features.evaluation.command:evaluate",
            writes=".features.evaluation.written:EvaluateFile",
        ),
        Command(
            "judge",
            ".features.judge.options:Judge",
            ".features.judge.command:judge",
            writes=".features.judge.written:JudgeFile",
        ),
        Command(
            "undecided",
            ".features.undecided.options:Undecided",
            ".features.undecided.command:undecided",
            writes=".features.undecided.written:UndecidedFile",
        ),
        Command("export", ".features.export.options:Export", ".features.export.export:export"),
        Command("report", ".features.report.options:Report", ".features.report.command:report"),
        Command(
            "passport",
            ".features.passport.options:Passport",
            ".features.passport.command:passport",
            B,
            writes=".features.passport.written:Passport",
        ),
        Command("publish", ".features.publish.options:Publish", ".features.publish.command:publish", B),
        Command("map", ".features.mapping.options:Map", ".features.mapping.command:make_map"),
        Command("perturb", ".features.sensitivity.options:Perturb", ".features.sensitivity.perturb:perturb", B),
        Command(
            "doctor",
            ".features.doctor.options:Doctor",
            ".features.doctor.command:doctor",
            B,
            writes=".features.doctor.written:DoctorFile",
        ),
        Command(
            "repair",
            ".features.recording.options:Repair",
            ".features.recording.repair_command:repair",
            listed=False,
        ),
        Command("new-method", ".features.grading.options:NewMethod", ".features.grading.scaffold:new_method"),
        Command("grade", ".features.grading.options:Grade", ".features.grading.command:grade"),
        Command("schema", ".cli.schema:Schema", ".cli.schema:schema"),
    ),
)
"""In the order of the help."""
MOVED = {"target": "ispom calibrate target"}
"""Commands of earlier versions, and what does the same now."""
