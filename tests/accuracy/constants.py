"""`python -m tests.accuracy.constants [DATA]`: what each numeric constant of the modern methods does to their figures.

Each constant is halved and doubled by itself, and the methods run on recordings of a few seconds. The table in
`constants.md` says by how much the error and the located frames change; a constant that changes nothing anywhere is a
candidate for removal. Constants that compiled code uses are part of that code and stay as they are: they are listed.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import multiprocessing
import os
import sys
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import ispom

from .figures import TWO_RATE, Figures, measure, recordings

FILE = Path(__file__).with_name("constants.md")
PACKAGES = ("estimators/modern", "solvers")
FACTORS = (0.5, 2.0)
RUNS = {
    ("kitti/sequences/06", "monocular"): ("monocular",),
    ("hard/fr3_office_1hz", "monocular"): ("monocular",),
    ("kitti/sequences/06", "stereo"): ("stereo",),
    (TWO_RATE, "integrated"): ("stereo", "integrated"),
    ("hard/fox_portrait", "monocular"): ("loops",),
}
"""Recording and method: the packages of `estimators/modern` whose constants are varied in this run. Constants of the
other modules take part in all but the last one."""
TIMEOUT_S = 120.0


@dataclass(frozen=True)
class Constant:
    """A number that a module gives a name in capitals."""

    module: str
    name: str
    value: float
    meaning: str
    """The first sentence of the string below it."""
    compiled: bool
    """Whether compiled code uses it."""

    @property
    def values(self) -> tuple[float, ...]:
        """Half and twice the value; whole numbers stay whole, and at least 1."""
        if isinstance(self.value, int):
            return max(1, self.value // 2), 2 * self.value
        return tuple(factor * self.value for factor in FACTORS)


def constants() -> list[Constant]:
    """All of them, by module and in the order of the source."""
    root, found = Path(ispom.__file__).parent, list[Constant]()
    for path in sorted(p for package in PACKAGES for p in (root / package).rglob("*.py")):
        module = ".".join(("ispom", *path.relative_to(root).with_suffix("").parts))
        tree = ast.parse(path.read_text())
        used = {n.id for f in ast.walk(tree) if _is_compiled(f) for n in ast.walk(f) if isinstance(n, ast.Name)}
        for statement, after in zip(tree.body, [*tree.body[1:], None], strict=False):
            for name, value in _numbers(statement):
                found.append(Constant(module, name, value, _first_sentence(after), name in used))
    return found


def _is_compiled(node: ast.AST) -> bool:
    """Whether a node is a function that numba compiles: decorated by `kernel` or `part`."""
    if not isinstance(node, ast.FunctionDef):
        return False
    calls = [d.func if isinstance(d, ast.Call) else d for d in node.decorator_list]
    return any(isinstance(c, ast.Name) and c.id in ("kernel", "part") for c in calls)


def _numbers(statement: ast.stmt) -> Iterator[tuple[str, float]]:
    """Names in capitals, and the numbers that they are set to."""
    if not isinstance(statement, ast.Assign) or len(statement.targets) != 1:
        return
    target, value = statement.targets[0], statement.value
    names, values = ([target], [value])
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and len(target.elts) == len(value.elts):
        names, values = target.elts, value.elts
    for name, number in zip(names, values, strict=True):
        if isinstance(name, ast.Name) and name.id.isupper():
            with contextlib.suppress(ValueError):
                found = ast.literal_eval(number)
                if type(found) in (int, float):
                    yield name.id, found


def _first_sentence(after: ast.stmt | None) -> str:
    if not (
        isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
    ):
        return ""
    return " ".join(after.value.value.split()).split(". ")[0].rstrip(".")


def replaced(constant: Constant, value: float) -> None:
    """Gives a constant another value in all modules that have it; default values of functions stay."""
    home = importlib.import_module(constant.module)
    old = getattr(home, constant.name)
    for module in [
        m for name, m in sys.modules.items() if name.startswith("ispom.") and isinstance(m, types.ModuleType)
    ]:
        if module is home or (getattr(module, constant.name, None) is old and _imports(module, constant)):
            setattr(module, constant.name, value)


def _imports(module: types.ModuleType, constant: Constant) -> bool:
    """Whether a module takes the constant from its home."""
    source = module.__file__
    if source is None or not source.endswith(".py"):
        return False
    tree = ast.parse(Path(source).read_text())
    taken = [n for n in tree.body if isinstance(n, ast.ImportFrom) and n.module == constant.module]
    return any(alias.name == constant.name for n in taken for alias in n.names)


def _in_child(constant: Constant | None, value: float, name: str, source: str, method: str, pipe) -> None:
    """Runs in a forked process, in which everything is imported."""
    if constant is not None:
        replaced(constant, value)
    try:
        pipe.send(measure(name, source, method))
    except Exception as fault:  # a value that makes no sense may end in any way
        pipe.send(f"{type(fault).__name__}: {fault}")


def figures_with(constant: Constant | None, value: float, name: str, source: str, method: str) -> Figures | str:
    """The figures of a method with another value; a sentence where it ends in an error or takes too long."""
    here, there = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(
        target=_in_child, args=(constant, value, name, source, method, there)
    )
    process.start()
    there.close()
    try:
        return here.recv() if here.poll(TIMEOUT_S) else f"more than {TIMEOUT_S:.0f} s"
    except EOFError:
        return "the process died"
    finally:
        process.kill()
        process.join()


def change(before: Figures | str, now: Figures | str) -> str:
    """What another value changes: the error in percent, and located frames; "=" for nothing."""
    if isinstance(before, str) or isinstance(now, str):
        return now if isinstance(now, str) else before if isinstance(before, str) else ""
    parts = []
    if before.error is not None and now.error is not None and before.error != now.error:
        parts.append(f"{100 * (now.error / before.error - 1):+.0f} %")
    if before.located != now.located:
        parts.append(f"{now.located - before.located:+d} frames")
    if before.segments != now.segments:
        parts.append(f"{now.segments} segments")
    return ", ".join(parts) or "="


def _takes_part(constant: Constant, packages: tuple[str, ...]) -> bool:
    owner = constant.module.removeprefix("ispom.estimators.modern.").split(".")[0]
    own = {p for packages in RUNS.values() for p in packages}
    return owner in packages if owner in own else packages != ("loops",)


def table(data: Path) -> Iterator[list[str]]:
    """Rows: module, constant, value, meaning, then for each run the change at half and at twice the value."""
    sources = recordings(data)
    before = dict[tuple[str, str], Figures | str]()
    for name, method in RUNS:
        measure(name, sources[name], method)  # compiles and imports what is still missing
        before[name, method] = figures_with(None, 0.0, name, sources[name], method)
    for constant in constants():
        row = [constant.module.removeprefix("ispom."), constant.name, f"{constant.value:g}", constant.meaning]
        if constant.compiled:
            yield [*row, *["compiled"] * len(RUNS)]
            continue
        cells = []
        for (name, method), packages in RUNS.items():
            if not _takes_part(constant, packages):
                cells.append("")
                continue
            half, twice = (
                change(before[name, method], figures_with(constant, value, name, sources[name], method))
                for value in constant.values
            )
            cells.append("=" if half == twice == "=" else f"{half} / {twice}")
        yield [*row, *cells]


def main(data: Path) -> None:
    """Writes the table as far as it came: each row costs ten seconds."""
    heads = ["module", "constant", "value", "meaning", *(f"{method} on {name}" for name, method in RUNS)]
    with FILE.open("w") as out:
        out.write(
            "# What each constant does\n\nMade by `python -m tests.accuracy.constants [DATA]`: change of the error, of "
            "located frames and of segments with half / twice the value (whole numbers stay whole). `=`: no figure "
            "changes; `compiled`: part of compiled code, not varied; empty: not run, the method does not use "
            "the module.\n\n"
        )
        out.write(f"| {' | '.join(heads)} |\n|{' --- |' * len(heads)}\n")
        for row in table(data):
            out.write(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |\n")
            out.flush()


if __name__ == "__main__":
    os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data"))
