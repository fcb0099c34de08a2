"""`import ispom` gives what plug-ins and notebooks need, and the examples use nothing else."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import ispom

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ispom.__all__)
def test_every_public_name_is_there_and_documented(name: str) -> None:
    found = getattr(ispom, name)
    assert name in dir(ispom)
    assert getattr(found, "__doc__", None), f"{name} has no docstring"


def test_what_type_checkers_see_is_what_there_is() -> None:
    tree = ast.parse((ROOT / "ispom" / "__init__.py").read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen.keys() == set(ispom.__all__)
    for name, (module, own) in seen.items():
        assert ispom._HOME_OF[name] == module and name == own


def test_other_names_are_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nothing_of_this_name"):
        _ = ispom.nothing_of_this_name


def test_importing_it_loads_nothing_else() -> None:
    code = "import sys, ispom; print([name for name in sys.modules if name.startswith(('ispom.', 'numpy', 'cv2'))])"
    assert subprocess.check_output([sys.executable, "-c", code], text=True).strip() == "[]"


def test_the_example_of_the_docstring_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = ispom.open_sequence("sim:tiny", max_exposures=12)
    ensemble = ispom.build(ispom.Config(), ("stereo",), sequence.rig)
    state = ensemble.start()
    for i in range(len(sequence)):
        state, _ = ensemble.step(state, sequence[i])
    found = ensemble.finish(state)["stereo"]
    assert isinstance(found, ispom.Trajectory) and np.isfinite(found.translations).all()


@pytest.mark.parametrize("path", sorted((ROOT / "examples").rglob("*.py")), ids=lambda p: p.name)
def test_examples_import_nothing_below_it(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert not (node.module or "").startswith("ispom."), ast.unparse(node)
        if isinstance(node, ast.Import):
            assert not any(alias.name.startswith("ispom.") for alias in node.names)


def test_no_public_name_is_that_of_a_module() -> None:
    """Importing `ispom.errors` would put the module where the public name `errors` was."""
    assert [name for name in ispom.__all__ if find_spec(f"ispom.{name}") is not None] == []
