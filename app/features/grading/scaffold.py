"""`ispom new-method`: the skeleton of a package, from templates."""

from __future__ import annotations

import keyword
import re
import sys
from importlib.resources import files
from importlib.util import find_spec
from string import Template

from ispom.errors import InputError, printable
from ispom.io.files import exists, expanded
from ispom.io.whole import write_whole
from ispom.methods import names

from .options import NewMethod

FILES = {
    "method.py.txt": "{name}.py",
    "test_method.py.txt": "tests/test_{name}.py",
    "pyproject.toml.txt": "pyproject.toml",
    "README.md.txt": "README.md",
}
"""Templates, and what they become."""
MOST_LETTERS = 40


def new_method(options: NewMethod) -> int:
    """Writes the package. Raises InputError where the name is taken, or the folder is there already."""
    name = options.name
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name, re.ASCII) or len(name) > MOST_LETTERS or keyword.iskeyword(name):
        raise InputError(f"{name[:60]!r} is no name of a package: give small letters, digits and _, such as my_vo")
    if name in names() or find_spec(name) is not None:
        raise InputError(f"{name} is the name of another method or module: give another name")
    folder = expanded(options.out) / name
    if exists(folder):
        raise InputError(f"{folder} is there already: give another name, or another --out")
    words = {"name": name, "title": name.replace("_", " ").capitalize(), "config": _class_of(name)}
    templates = files(__name__.rpartition(".")[0]).joinpath("templates")
    contents = {
        target.format(name=name): Template(templates.joinpath(source).read_text(encoding="utf-8")).substitute(words)
        for source, target in FILES.items()
    }
    try:
        (folder / "tests").mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{folder} cannot be made ({error.strerror}): give another --out") from None
    for path, content in contents.items():
        write_whole(folder / path, content)
    lines = [f"{folder}: {', '.join(contents)}", f"Next: cd {folder}; pip install -e '.[test]'; pytest; ispom grade ."]
    sys.stdout.write("\n".join(map(printable, lines)) + "\n")
    return 0


def _class_of(name: str) -> str:
    """Returns MyVoConfig for my_vo."""
    return "".join(part.capitalize() for part in name.split("_")) + "Config"
