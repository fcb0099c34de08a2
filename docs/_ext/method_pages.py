"""A page for each method of the registry, and the index of all checks."""

from __future__ import annotations

import ast
import inspect
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

import yaml
from markdown_text import as_cell, as_prose, table
from stability import of_method

from ispom.estimator import Method
from ispom.methods import BUILT_IN, SURVEY, method
from ispom.settings import Setting, settings
from ispom.types import Check

DOCS = Path(__file__).parents[1]
KINDS = {
    "requirement": "Requirement: if it fails, the step that it guards fails.",
    "trigger": "Trigger: any trigger that passes answers the question with yes. Not passing is no failure.",
    "finding": "Finding: a measurement with its limit. Neither outcome is a failure.",
    "warning": "Warning: if it fails, the result is doubtful, and the method goes on.",
}


def methods() -> tuple[Method, ...]:
    """All methods of this package; those of installed packages document themselves."""
    return tuple(map(method, (*BUILT_IN, *SURVEY)))


def page_name(method: str) -> str:
    """`monocular_paper` of `monocular.paper`."""
    return re.sub(r"\W", "_", method)


def pages() -> dict[str, str]:
    """Returns a page for each method, the table of the survey's methods, and the index of all checks."""
    found = {f"methods/{page_name(method.name)}.md": _method(method) for method in methods()}
    found["_generated/methods.md"] = _overview()
    found["reference/checks.md"] = _checks_index()
    return found


def _overview() -> str:
    rows = [
        (
            f"[`{m.name}`]({page_name(m.name)}.md)",
            ", ".join(sorted(m.sensors)),
            "metres" if m.unit == "metric" else "own unit",
            as_cell(m.survey or "this project's default" if not m.name.endswith(".paper") else "as published"),
            as_cell(_first_sentence(m)),
        )
        for m in methods()
    ]
    return table(("method", "sensors", "trajectory", "stands for", "in short"), rows)


def _home(method: Method) -> ModuleType:
    return import_module(method.config.__module__)


def _docstring(method: Method) -> str:
    return inspect.getdoc(_home(method)) or inspect.getdoc(method.config) or method.source


def _first_sentence(method: Method) -> str:
    first = _docstring(method).split("\n\n")[0].replace("\n", " ")
    return re.split(r"(?<=[.:])\s", first)[0].rstrip(":")


def _method(method: Method) -> str:
    source = "sim:ring6" if method.sensors == {"cameras"} else "sim:tiny"
    home = inspect.getsourcefile(_home(method)) or ""
    facts = [
        ("uses", ", ".join(f"`{kind}`" for kind in sorted(method.sensors))),
        ("trajectory", "metres" if method.unit == "metric" else "a unit of its own"),
        ("reference", as_cell(method.source)),
        ("code", f"`{home[home.rindex('ispom/') :]}`"),
    ]
    if method.optional:
        facts.append(("can do without", ", ".join(f"`{kind}`" for kind in sorted(method.optional))))
    if method.asks:
        links = ", ".join(f"[`{name}`]({page_name(name)}.md)" for name in method.asks.values())
        facts.append(("builds on", links))
    if method.survey:
        facts.append(("stands for", as_cell(method.survey)))
    text = [f"# `{method.name}`", of_method(bool(method.survey), "../"), table(("", ""), facts)]
    text += ["## How it works", as_prose(_docstring(method))]
    note = DOCS / "methods" / "notes" / f"{page_name(method.name)}.md"
    if note.is_file():
        text.append(note.read_text(encoding="utf-8").strip())
    text.append(
        f"## Run it\n\n```sh\nispom run {source} --methods {method.name} --out recordings/{page_name(method.name)}\n```"
    )
    if (DOCS / "methods" / "pictures" / f"{page_name(method.name)}.webp").is_file():
        picture = f"pictures/{page_name(method.name)}.webp"
        text.append(f"```{{image}} {picture}\n:alt: {method.name} in the page\n```")
    if method.stages:
        stages = [(f"`{name}`", as_cell(sentence)) for name, sentence in method.stages.items()]
        text += [
            "## Stages of a step",
            "`steps.csv` and the page state the time of each.",
            table(("stage", "what"), stages),
        ]
    text += ["## Settings", _settings_table(method)]
    if method.checks:
        text += ["## Checks", _checks_intro(method), *(_check(method, check) for check in _by_question(method))]
    return "\n\n".join(text)


def _settings_table(method: Method) -> str:
    default = method.config()
    rows = [
        (
            f"`--{method.name}.{s.name.replace('_', '-')}`",
            f"`{getattr(default, s.name)}`",
            as_cell(_allowed(s)),
            as_cell(s.help),
        )
        for s in settings(method.config)
    ]
    return table(("setting", "default", "allowed", "meaning"), rows)


def _allowed(setting: Setting) -> str:
    if setting.range:
        return f"{setting.range.low:g} to {setting.range.high:g}"
    if get_origin(setting.type) is Literal:
        return ", ".join(f"`{name}`" for name in get_args(setting.type))
    return {bool: "yes or no", int: "an integer", float: "a number", str: "text"}.get(setting.type, "")


def _by_question(method: Method) -> list[Check]:
    """In the order of the method, those of one question together."""
    questions = list(dict.fromkeys(check.question for check in method.checks.values()))
    return sorted(method.checks.values(), key=lambda check: questions.index(check.question))


def _checks_intro(method: Method) -> str:
    first = next(iter(method.checks))
    return (
        f"Each check has a stable key, such as `{method.name}.{first}`. It is a name in conditions, a row in "
        "`decisions.csv` and a line in the tab Explain."
    )


def _check(method: Method, check: Check) -> str:
    name = f"{method.name}.{check.key}"
    unit = f" [{check.unit}]" if check.unit else ""
    rows = [
        ("measures", as_cell(check.name + unit)),
        ("kind", as_cell(KINDS[check.kind])),
        ("passes when", f"value {check.relation.replace('<', '&lt;').replace('>', '&gt;')} threshold"),
        ("threshold", as_cell(_threshold(method, check))),
    ]
    if check.question:
        rows.insert(0, ("answers", as_cell(check.question)))
    if check.passes:
        rows.append(("when it passes", as_cell(check.passes)))
    if check.fails:
        rows.append(("when it does not", as_cell(check.fails)))
    rows.append(("what to do", " ".join(advice(method.name, check).split())))
    return f"({anchor(name)})=\n### `{name}`\n\n" + table(("", ""), rows)


def anchor(name: str) -> str:
    """The label of a check's section."""
    return "check-" + re.sub(r"\W", "-", name)


@cache
def _advice() -> dict[str, Any]:
    return yaml.safe_load((DOCS / "methods" / "advice.yaml").read_text(encoding="utf-8"))


def advice(method: str, check: Check) -> str:
    """What to do when the check fails: of this method and key, else of the key, else of its topic or kind."""
    known = _advice()
    specific = known["checks"].get(f"{method}.{check.key}") or known["checks"].get(check.key)
    if specific or check.kind in ("finding", "trigger"):
        return specific or known["kinds"][check.kind]
    return known["topics"].get(check.topic) or known["kinds"][check.kind]


def _checks_index() -> str:
    rows = sorted(
        (check.key, method.name, check.kind, check.name) for method in methods() for check in method.checks.values()
    )
    cells = [
        (f"{{ref}}`{method}.{key} <{anchor(f'{method}.{key}')}>`", kind, as_cell(name))
        for key, method, kind, name in rows
    ]
    head = (
        "# All checks\n\nSorted by key. The link leads to meaning, threshold and what to do. Any of these names can "
        "stand in a [condition](conditions.md), also with `.passed`, `.margin` and `.threshold`.\n\n"
    )
    return head + table(("check", "kind", "measures"), cells)


# Thresholds: a check is used as `CHECK.of(value, threshold)`; the second argument says where the threshold comes from.


@cache
def _uses() -> list[tuple[ModuleType, str, ast.expr]]:
    """All calls `CHECK.of(value, threshold, ...)` of the estimators: module, the check's expression, threshold."""
    root = Path(inspect.getsourcefile(import_module("ispom.estimators")) or "").parent
    found = []
    for path in sorted(root.rglob("*.py")):
        name = "ispom.estimators." + ".".join(path.relative_to(root).with_suffix("").parts)
        if path.name == "__init__.py":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            assigned = list(_assigned(function))
            once = Counter(name for name, _ in assigned)
            values = {name: value for name, value in assigned if once[name] == 1}
            for node in ast.walk(function):
                called = node.func if isinstance(node, ast.Call) else None
                arguments = node.args if isinstance(node, ast.Call) else []
                if isinstance(called, ast.Attribute) and called.attr == "of" and len(arguments) > 1:
                    value = values.get(ast.unparse(arguments[1]), arguments[1])
                    cases = [value.body, value.orelse] if isinstance(value, ast.IfExp) else [value]
                    found += [(import_module(name), ast.unparse(called.value), case) for case in cases]
    return found


def _assigned(function: ast.FunctionDef) -> Iterator[tuple[str, ast.expr]]:
    """The names that a function assigns a value to, also several at once."""
    for node in ast.walk(function):
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            continue
        target = node.targets[0]
        if isinstance(target, ast.Name):
            yield target.id, node.value
        elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            yield from zip(map(ast.unparse, target.elts), node.value.elts, strict=False)


def _resolve(module: ModuleType, expression: str) -> Any:
    value: Any = module
    for part in expression.split("."):
        value = getattr(value, part, None)
    return value


def _threshold(method: Method, check: Check) -> str:
    """A setting with its default, a constant with its value, or that it is computed at each frame."""
    package = _home(method).__name__.rsplit(".", 1)[0]
    uses = [(m, t) for m, name, t in _uses() if re.fullmatch(r"[\w.]+", name) and _resolve(m, name) is check]
    own = [
        use
        for use in uses
        if use[0].__name__ in (_home(method).__name__, package) or use[0].__name__.startswith(package)
    ]
    known = {s.name for s in settings(method.config)}
    said: dict[str, None] = {}
    for module, threshold in own or uses:
        said.setdefault(_said(method, module, threshold, known))
    computed = not said or "" in said
    return " or ".join([*filter(None, said), *["computed at each frame; `decisions.csv` has it"][: int(computed)]])


def _said(method: Method, module: ModuleType, threshold: ast.expr, known: set[str]) -> str:
    text = ast.unparse(threshold)
    parts = text.split(".")
    if re.fullmatch(r"[\w.]+", text) and (named := [part for part in parts if part in known]):
        flag = f"`--{method.name}.{named[-1].replace('_', '-')}`"
        return f"setting {flag} (default {getattr(method.config(), named[-1])})"
    if isinstance(threshold, ast.Constant) and isinstance(threshold.value, int | float):
        return f"{threshold.value:g}"
    value = _number(module, threshold)
    return "" if value is None else f"{value:g} (`{parts[-1]}`)" if re.fullmatch(r"[\w.]+", text) else f"{value:g}"


def _number(module: ModuleType, expression: ast.expr) -> float | None:
    """The value of a constant of a module, or of a product of such."""
    if isinstance(expression, ast.BinOp) and isinstance(expression.op, ast.Mult):
        factors = [_number(module, side) for side in (expression.left, expression.right)]
        return None if None in factors else factors[0] * factors[1]  # type: ignore[operator]
    if isinstance(expression, ast.Constant):
        return expression.value if isinstance(expression.value, int | float) else None
    text = ast.unparse(expression)
    value = _resolve(module, text) if re.fullmatch(r"[\w.]+", text) else None
    return value if isinstance(value, int | float) else None
