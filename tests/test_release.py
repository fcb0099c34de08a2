"""What a release needs agrees with itself: version, citation, workflows, containers."""

from __future__ import annotations

import re
import tomllib
from importlib.metadata import metadata, version
from pathlib import Path
from typing import Any

import pytest
import tyro
import yaml
from ispom_app.features.page.options import App
from packaging.requirements import Requirement

from tests.accuracy.records import FOLDER, PAGE

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
FILES = [*sorted((ROOT / ".github").rglob("*.y*ml")), *(ROOT / n for n in (".pre-commit-config.yaml", "compose.yaml"))]

RECIPE = ".github/conda-forge/recipe.yaml"
CONDA = {"opencv-python-headless": "py-opencv", "open3d-cpu": "open3d", "rerun-notebook": "rerun-sdk"}
"""Packages of conda-forge that have what these have on PyPI."""
NOT_ON_CONDA = {"embreex"}
"""Open3D does its work there."""


def content(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text())


@pytest.mark.parametrize("path", [*FILES, ROOT / "CITATION.cff"], ids=lambda p: p.name)
def test_it_is_yaml(path: Path) -> None:
    assert isinstance(yaml.safe_load(path.read_text()), dict)


def test_the_version_is_in_one_place() -> None:
    """And where a file cannot read it from there, it is the same."""
    own = PROJECT["project"]["version"]
    assert version("ispom") == own == content("CITATION.cff")["version"]
    assert f"## {own}" in (ROOT / "CHANGELOG.md").read_text() or f"## [{own}]" in (ROOT / "CHANGELOG.md").read_text()
    others = [
        p for p in (*(ROOT / "ispom").rglob("*.py"), *(ROOT / "app").rglob("*.py")) if f'"{own}"' in p.read_text()
    ]
    assert not others


def test_the_recipe_for_conda_needs_what_the_package_needs() -> None:
    project, recipe = PROJECT["project"], content(RECIPE)
    assert recipe["context"]["version"] == project["version"]
    assert recipe["context"]["python_min"] == project["requires-python"].removeprefix(">=")
    expected = dict[str, set[str]]()
    for each in map(Requirement, project["dependencies"]):
        if each.name not in NOT_ON_CONDA:
            expected.setdefault(CONDA.get(each.name, each.name), set()).add(str(each.specifier))
    _, *listed = recipe["requirements"]["run"]  # Python is the first
    found = {each.name: {str(each.specifier)} for each in map(Requirement, listed)}
    assert found == expected
    (build,) = PROJECT["build-system"]["requires"]
    assert build in {each.replace(" ", "") for each in recipe["requirements"]["host"]}
    scripts = {f"{name} = {where}" for name, where in project["scripts"].items()}
    assert set(recipe["build"]["python"]["entry_points"]) == scripts
    assert recipe["about"]["summary"] == project["description"]
    assert recipe["about"]["license_file"] == project["license-files"]


def test_a_release_writes_its_checksum_into_the_recipe() -> None:
    steps = content(".github/workflows/release.yml")["jobs"]["build"]["steps"]
    (script,) = (step["run"] for step in steps if RECIPE in step.get("run", ""))
    pattern, text = re.search(r"s/(\^.*?)\.\*/", script), (ROOT / RECIPE).read_text()
    assert pattern is not None and len(re.findall(pattern[1] + '"0{64}"$', text, re.MULTILINE)) == 1


def test_a_release_needs_its_record_of_the_benchmark() -> None:
    steps = content(".github/workflows/release.yml")["jobs"]["build"]["steps"]
    (script,) = (step["run"] for step in steps if "GITHUB_REF_NAME" in step.get("run", ""))
    named = re.search(r'^test -f "(\S+)/\$version\.json"$', script, re.MULTILINE)
    assert named is not None and ROOT / named[1] == PAGE.parent / FOLDER


def test_the_paper_is_a_reference() -> None:
    (paper,) = content("CITATION.cff")["references"]
    assert paper["doi"] == "10.1007/s11432-012-4649-9" and paper["year"] == 2013
    assert paper["doi"] in (ROOT / "README.md").read_text()


def test_the_workflow_tests_what_the_package_says() -> None:
    tested = content(".github/workflows/ci.yml")["jobs"]["tests"]["strategy"]["matrix"]["python"]
    prefix = "Programming Language :: Python :: 3."
    named = [f"3.{c.removeprefix(prefix)}" for c in PROJECT["project"]["classifiers"] if c.startswith(prefix)]
    assert tested == named and PROJECT["project"]["requires-python"] == f">={tested[0]}"


def test_only_the_job_that_publishes_gets_a_token() -> None:
    release = content(".github/workflows/release.yml")
    assert release["permissions"] == {"contents": "read"}
    wanting = {name for name, job in release["jobs"].items() if job.get("permissions", {}).get("id-token") == "write"}
    assert wanting == {"publish"} and release["jobs"]["publish"]["environment"] == "pypi"
    writing = {name for name, job in release["jobs"].items() if job.get("permissions", {}).get("contents") == "write"}
    assert writing == {"site"}
    assert "password" not in (ROOT / ".github/workflows/release.yml").read_text().replace("no password", "")


def test_what_containers_start_is_understood() -> None:
    words = re.search(r"^CMD (\[.*\])$", (ROOT / "Dockerfile").read_text(), re.MULTILINE)
    assert words is not None
    composed = content("compose.yaml")["services"]["ispom"]["command"]
    host = "--allow-host=${ISPOM_HOST:?set ISPOM_HOST to the name under which the server is reached}"
    assert host in composed
    for command in (yaml.safe_load(words[1]), [word.replace(host, "--allow-host=a.example") for word in composed]):
        options = tyro.cli(App, args=command[1:])
        assert (
            command[0] == "app" and options.host == "0.0.0.0" and not options.browser and options.root == Path("/data")
        )


def test_extras_of_the_dockerfile_are_there() -> None:
    named = re.search(r"/src\[([a-z,]+)\]", (ROOT / "Dockerfile").read_text())
    assert named is not None and set(named[1].split(",")) <= set(PROJECT["project"]["optional-dependencies"])


def test_the_extra_of_all_has_all() -> None:
    extras = PROJECT["project"]["optional-dependencies"]
    (everything,) = extras["all"]
    named = re.fullmatch(r"ispom\[([a-z,]+)\]", everything)
    assert named is not None and set(named[1].split(",")) == extras.keys() - {"all", "test", "check", "docs"}


def test_the_wheel_says_what_it_is() -> None:
    found = metadata("ispom")
    assert found["Summary"] and found["License-Expression"] == "MIT"
