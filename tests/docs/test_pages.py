"""README and documentation: command lines that the program takes, links that lead somewhere, pages that are fresh."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from ispom.estimator import Method
from ispom.io.calibrations.dialects import modules
from ispom.io.poses.dialects import modules as pose_modules
from ispom.methods import BUILT_IN, SURVEY, method
from ispom.settings import settings
from tests.docs.commands import command_lines, pages

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def module(path: Path) -> ModuleType:
    """A file that is in no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec and spec.loader
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


@pytest.fixture(scope="module")
def generated() -> dict[str, str]:
    """The pages that follow from the code, by path below docs."""
    return module(DOCS / "_ext" / "generated.py").pages()


def test_the_program_takes_every_command_line() -> None:
    lines = [line for page in pages() for line in command_lines(page.read_text(encoding="utf-8"))]
    lines = [list(words) for words in dict.fromkeys(map(tuple, lines))]
    assert len(lines) > 60, "the blocks of commands are not found any more"
    command = [sys.executable, "-m", "tests.docs.commands"]
    parsed = subprocess.run(command, input=json.dumps(lines), capture_output=True, text=True, cwd=ROOT, check=False)
    assert parsed.returncode == 0 and not parsed.stdout, parsed.stdout + parsed.stderr


@pytest.mark.parametrize("page", pages(), ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path, generated: dict[str, str]) -> None:
    home = home_of(page)
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", text)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (home / name).resolve() if name else page
        made = generated.get(path.relative_to(DOCS).as_posix()) if path.is_relative_to(DOCS) else None
        assert made or path.exists(), f"{page.name} links to {target}, which is not there"
        if anchor and path.suffix == ".md":
            heads = re.findall(r"^#+ (.*)$", made or path.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {slug(head) for head in heads}, f"{page.name} links to {target}, which is no heading"


def home_of(page: Path) -> Path:
    """The folder from which its links count: notes are parts of the methods' pages."""
    return page.parent.parent if page.parent.name == "notes" else page.parent


def slug(heading: str) -> str:
    """As MyST names a heading's anchor."""
    kept = re.sub(r"[^\w\s-]", lambda m: "-" if m[0] == "." else "", heading.lower().replace("`", ""))
    return re.sub(r"\s+", "-", kept.strip())


def test_every_picture_is_there() -> None:
    for page in pages():
        text = page.read_text(encoding="utf-8")
        for name in (*re.findall(r"!\[.*?\]\((.*?)\)", text), *re.findall(r"^```\{image\} (\S+)", text, re.MULTILINE)):
            assert (home_of(page) / name).is_file(), f"{page} shows {name}, which is missing"


def test_the_figures_are_those_of_the_script() -> None:
    figures = module(DOCS / "concepts" / "figures.py")
    for name, draw in figures.FIGURES.items():
        path = DOCS / "concepts" / f"{name}.svg"
        assert path.read_text(encoding="utf-8") == draw(), f"run python docs/concepts/figures.py: {path.name} is old"


@pytest.mark.parametrize("method", [method(name) for name in (*BUILT_IN, *SURVEY)], ids=lambda m: m.name)
def test_every_method_has_a_page(method: Method, generated: dict[str, str]) -> None:
    page = generated[f"methods/{re.sub(r'[^a-z0-9]', '_', method.name)}.md"]
    for setting in settings(method.config):
        assert f"--{method.name}.{setting.name.replace('_', '-')}`" in page
    for key in method.checks:
        assert f"### `{method.name}.{key}`" in page
        assert f"{method.name}.{key} <" in generated["reference/checks.md"]
    assert page.count("| what to do |") == len(method.checks)


def test_the_default_methods_say_what_to_do_about_each_check() -> None:
    import yaml

    known = yaml.safe_load((DOCS / "methods" / "advice.yaml").read_text(encoding="utf-8"))
    for name in BUILT_IN:
        for check in method(name).checks.values():
            if check.kind in ("requirement", "warning"):
                assert check.key in known["checks"] or check.topic in known["topics"], f"{name}.{check.key}"
    existing = {check.key for name in (*BUILT_IN, *SURVEY) for check in method(name).checks.values()}
    assert set(known["checks"]) <= existing, "advice about a check that is gone"


def test_every_command_has_a_page(generated: dict[str, str]) -> None:
    from ispom_app.cli.commands import COMMANDS

    for name in COMMANDS.names():
        assert f"reference/command_line/{name}.md" in generated, name


QUESTIONS = {
    "which method for my cameras": "docs/methods/index.md",
    "why is it lost": "docs/troubleshooting.md",
    "columns of steps.csv": "docs/reference/run_folder.md#steps-csv",
    "how does it compare with evo": "docs/comparison.md",
    "how do I cite it": "docs/citing.md",
}
"""Questions of readers, and where each is answered."""


def targets_of(page: Path, generated: dict[str, str]) -> set[str]:
    """The pages below the top folder that a page links to, or that its tables of contents name."""
    name = page.relative_to(DOCS).as_posix() if page.is_relative_to(DOCS) else ""
    text = generated.get(name) or page.read_text(encoding="utf-8")
    found = set(re.findall(r"\]\(([^)\s:]+\.md(?:#[\w-]+)?)\)", text))
    for lines in re.findall(r"^```\{toctree\}\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        found |= {f"{line}.md" for line in lines.split("\n") if line and not line.startswith((":", "*"))}
    folder = home_of(page)
    return {(folder / target).resolve().relative_to(ROOT).as_posix() for target in found}


@pytest.mark.parametrize("start", ["README.md", "docs/index.md"])
@pytest.mark.parametrize("target", QUESTIONS.values(), ids=QUESTIONS.keys())
def test_two_clicks_lead_to_the_answer(start: str, target: str, generated: dict[str, str]) -> None:
    first = targets_of(ROOT / start, generated)
    second = {there for page in first for there in targets_of(ROOT / page.partition("#")[0], generated)}
    reached = first | second
    if start == "README.md":
        target = target.partition("#")[0]
    assert target in reached


def test_the_columns_of_steps_are_under_their_heading(generated: dict[str, str]) -> None:
    text = (DOCS / "reference" / "run_folder.md").read_text(encoding="utf-8")
    assert "```{include} ../_generated/steps_columns.md" in text.partition("\n## steps.csv\n")[2].partition("\n## ")[0]
    assert "`inliers`" in generated["_generated/steps_columns.md"]


def test_words_are_defined_on_the_first_page_before_they_are_used() -> None:
    text = (DOCS / "start" / "demo.md").read_text(encoding="utf-8")
    for word in ("check", "branch", "segment", "unit"):
        assert re.search(rf"\b{word}", text).start() == text.index(f"| {word} |") + 2, word  # type: ignore[union-attr]


def test_long_commands_stay_in_their_frame() -> None:
    rules = (DOCS / "_static" / "custom.css").read_text(encoding="utf-8")
    for language in ("sh", "python", "yaml", "json"):
        assert re.search(rf"\.highlight-{language} pre[^}}]*pre-wrap", rules), language


def test_what_is_printed_stays_in_its_frame() -> None:
    """A frame of the site has room for 90 characters in a window of 1280 pixels."""
    for page in sorted(DOCS.rglob("*.md")):
        for block in re.findall(r"^```text\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL):
            assert max(map(len, block.splitlines())) <= 90, page


def test_the_page_of_figures_has_all_that_are_held_failures_too(generated: dict[str, str]) -> None:
    from tests.accuracy.test_figures import STILL

    held = json.loads((ROOT / "tests" / "accuracy" / "figures.json").read_text(encoding="utf-8"))
    page = generated["evaluation/figures.md"]
    failures = sum(figures["located"] == 0 for methods in held.values() for figures in methods.values())
    assert page.count("**none** of") == failures > 0
    for recording, methods in held.items():
        part = page.partition(f"\n## {recording}\n")[2].partition("\n## ")[0]
        assert re.findall(r"^\| `([\w.]+)` \|", part, re.MULTILINE) == list(methods), recording
    assert all(name in page for name in ("ORB-SLAM3", "SVO", "COLMAP"))
    assert set(module(DOCS / "_ext" / "figures_page.py").STILL) == STILL


def test_the_other_programs_are_compared() -> None:
    text = (DOCS / "comparison.md").read_text(encoding="utf-8")
    rows = [line.split(" | ") for line in text.split("\n") if line.startswith("| [")]
    assert [re.findall(r"\[(.+?)\]", cells[0])[0] for cells in rows] == [
        "evo",
        "Rerun",
        "pySLAM",
        "COLMAP's viewer",
        "OpenVINS",
        "Foxglove",
    ]
    assert all(len(cells) == 4 and all(len(cell) > 15 for cell in cells) for cells in rows)


def test_what_is_experimental_is_said_once_and_exists(generated: dict[str, str]) -> None:
    from ispom_app.cli.commands import COMMANDS

    import ispom

    stability = module(DOCS / "_ext" / "stability.py")
    assert set(stability.COMMANDS) <= set(COMMANDS.names())
    homes = set(ispom._HOME_OF.values())
    for name in stability.MODULES:
        assert any(home == name or home.startswith(f"{name}.") for home in homes), name
    for name in COMMANDS.names():
        page = generated[f"reference/command_line/{name}.md"]
        assert ("**Experimental**" in page) == (name in stability.COMMANDS)
    for name in (*BUILT_IN, *SURVEY):
        page = generated[f"methods/{re.sub(r'[^a-z0-9]', '_', name)}.md"]
        assert ("**Experimental**" in page) == (name in SURVEY)
    api = generated["reference/python_api.md"]
    assert api.count("stability.md") == len(re.findall(r"^## ", api, re.MULTILINE))
    blocks = {
        block.split("\n")[0]: block for block in re.split(r"^\.\. auto\w+:: ispom\.", api, flags=re.MULTILINE)[1:]
    }
    assert blocks.keys() == ispom._HOME_OF.keys() == set(ispom.__all__)
    for name, home in ispom._HOME_OF.items():
        experimental = any(f"{home}.".startswith(f"{each}.") for each in stability.MODULES)
        levels = re.findall(r"^   (\*\*Experimental\.\*\*|\*Stable\.\*)$", blocks[name], re.MULTILINE)
        assert levels == ["**Experimental.**" if experimental else "*Stable.*"], name


def test_sentences_are_short() -> None:
    language = module(DOCS / "language.py")
    for page in language.pages():
        text = page.read_text(encoding="utf-8")
        if not text.startswith("<!-- generated"):
            mean = language.mean_words(text)
            assert mean <= language.LONGEST_MEAN, f"{page.relative_to(ROOT)}: {mean:.1f} words per sentence"


def test_sentences_are_told_apart() -> None:
    language = module(DOCS / "language.py")
    text = "# Head\n\nOne two three. Four five\nsix `seven`.\n\n- eight nine ten\n\n| a b | c |\n\n```\nno prose\n```\n"
    assert language.sentences(text) == ["One two three.", "Four five six `seven`.", "eight nine ten"]


@pytest.mark.slow
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        str(DOCS),
        str(tmp_path / "site"),
    ]
    built = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert built.returncode == 0, built.stderr
    for page in ("index.html", "methods/monocular.html", "reference/python_api.html", "howto/run.html"):
        assert (tmp_path / "site" / page).is_file()


@pytest.mark.parametrize("page", pages(), ids=lambda p: str(p.relative_to(ROOT)))
def test_files_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for name in re.findall(r"`((?:ispom|app|tests|examples|docs)/[\w./-]*)`", text):
        assert "NAME" in name or name.startswith("docs/_build") or (ROOT / name).exists(), f"{page.name}: {name}"
    for name in re.findall(r"python -m (tests[\w.]*)", text):
        path = ROOT.joinpath(*name.split("."))
        assert path.is_dir() or path.with_suffix(".py").is_file(), f"{page.name}: python -m {name}"


def test_every_fault_motion_and_place_is_listed() -> None:
    from ispom.simulation.motions import MOTIONS
    from ispom.simulation.scenario.scenario import FAULTS
    from ispom.simulation.source import PLACES

    text = (DOCS / "reference" / "scenarios.md").read_text(encoding="utf-8")
    for name in (*FAULTS, *MOTIONS, *PLACES):
        assert name in text, f"docs/reference/scenarios.md does not list {name}"


def test_every_file_of_a_run_is_listed() -> None:
    from ispom_app.engine.run_folder import run_folder as names

    text = (DOCS / "reference" / "run_folder.md").read_text(encoding="utf-8")
    files = (names.RUN, names.RIG, names.TRUTH, names.METRICS, names.CORRECTED_RIG, names.NOTES, names.LANDMARKS)
    for name in (*files, names.STEPS, names.DECISIONS, names.RECORDING, names.EVENTS, names.THUMBNAIL, names.MARKER):
        assert f"`{name}`" in text, f"docs/reference/run_folder.md does not list {name}"


def test_every_dialect_has_its_row_and_its_conventions(generated: dict[str, str]) -> None:
    as_cell = module(DOCS / "_ext" / "markdown_text.py").as_cell
    for page, known in (("calibrations", modules()), ("poses", pose_modules())):
        text = generated[f"_generated/{page}.md"]
        for name, found in known.items():
            assert text.count(f"\n## {found.DIALECT.title}\n") == 1, name
            assert f"| {as_cell(found.DIALECT.title)} | {as_cell(found.DIALECT.files)} |" in text, name
