"""The notebooks of the examples run from their first cell to their last, install in Colab only, and are stored without
outputs."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.docs.test_pages import module

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
ALIKE = {"compare_two_settings"}
"""What it calls, another one calls as well: it is executed with the slow tests."""


@pytest.mark.timeout(900)  # a first run compiles the methods
@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.slow] if path.stem in ALIKE else []) for path in NOTEBOOKS],
    ids=lambda p: p.stem,
)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("MPLBACKEND", "agg")
    notebook = nbformat.read(path, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "clear the outputs before you commit"
    nbclient.NotebookClient(notebook, timeout=800, resources={"metadata": {"path": str(tmp_path)}}).execute()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_the_first_cell_installs_in_colab_only(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    transformer = pytest.importorskip("IPython.core.inputtransformer2")
    notebook = json.loads(path.read_text(encoding="utf-8"))
    first = next(cell for cell in notebook["cells"] if cell["cell_type"] == "code")
    assert notebook["cells"].index(first) == 1  # below the title
    code = transformer.TransformerManager().transform_cell("".join(first["source"]))
    calls = list[tuple[str, ...]]()

    class Shell:
        def run_line_magic(self, *words: str) -> None:
            calls.append(words)

    names: dict[str, Any] = {"get_ipython": Shell}
    monkeypatch.delitem(sys.modules, "google.colab", raising=False)
    exec(code, dict(names))
    assert calls == []
    monkeypatch.setitem(sys.modules, "google.colab", ModuleType("google.colab"))
    exec(code, dict(names))
    assert [name for name, _ in calls] == ["pip"] and calls[0][1].split()[-1].strip('"') == "ispom[plots]"


@pytest.mark.parametrize("end", ["", "/", ".git"])
def test_the_link_to_colab_leads_to_this_version_on_github(end: str) -> None:
    project = {"version": "1.2.3", "urls": {"Source": f"https://github.com/some.one/a-project{end}"}}
    colab, text = module(ROOT / "docs" / "_ext" / "colab.py"), NOTEBOOKS[0].read_text(encoding="utf-8")
    found = json.loads(colab.with_link(text, "a_b.ipynb", project))
    address = "https://colab.research.google.com/github/some.one/a-project/blob/v1.2.3/examples/a_b.ipynb"
    title, *rest = "".join(found["cells"][0]["source"]).split("\n")
    assert title.startswith("# ") and rest[:3] == ["", f"[Open in Colab]({address})", ""]
    assert found["cells"][1:] == json.loads(text)["cells"][1:]


@pytest.mark.parametrize("urls", [{}, {"Source": "https://example.org/a/b"}, {"Paper": "https://github.com/a/b"}])
def test_no_address_is_invented(urls: dict[str, str]) -> None:
    colab, text = module(ROOT / "docs" / "_ext" / "colab.py"), NOTEBOOKS[0].read_text(encoding="utf-8")
    assert colab.with_link(text, "a.ipynb", {"version": "1.0", "urls": urls}) == text


def test_there_are_some() -> None:
    assert len(NOTEBOOKS) >= 3
