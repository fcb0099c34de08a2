"""The shape of the project: imports go down only, no window in the library, and everything is in the package."""

from __future__ import annotations

import ast
import subprocess
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = (
    {"blas", "caches", "child", "errors", "geometry", "stop"},
    {"compiled_code", "kernel_list", "registry"},
    {"cameras"},
    {"kernels", "settings", "types"},
    {"estimator", "stopwatch", "persistent_list", "registry"},
    {"numerics", "plausibility"},
    {"solvers"},
    {"sensors"},
    {"io"},
    {"features", "sequences", "simulation", "reconstruction"},
    {"evaluation"},
    {"estimators"},
    {"methods"},
    {"ensemble"},
    {"warm_up"},
    {"calibration"},
    {"notebook"},
    {"testing"},
)
"""From the bottom up; those side by side do not import each other, with these exceptions."""
SIDEWAYS = {("sequences", "simulation")}
APP_LAYERS = (
    {"presentation"},
    {"engine"},
    {"views.rerun"},
    {"session"},
    {"views.web", "views.viser"},
    {"features"},
    {"cli"},
    {"__main__"},
)
"""The same for the app's folders. Features use what the views offer, and the views name no feature: they find them by
the doors of `session/registry.py`. Packages of one floor may import each other, but not in a circle."""
WINDOWS = {"viser", "rerun", "aiohttp", "tyro", "rich", "ispom_app", "app"}
TOP = {"pyproject.toml", "app", "ispom", "recordings", "tests", "README.md", "LICENSE", "CONTRIBUTING.md"}
TOP |= {"CHANGELOG.md", ".gitignore", ".ci", "examples", "setup.py", "package.json", "biome.json", "tsconfig.json"}
TOP |= {"docs", ".github", ".pre-commit-config.yaml", "CITATION.cff", "SECURITY.md", "CODE_OF_CONDUCT.md", "Dockerfile"}
TOP |= {".dockerignore", "compose.yaml"}
"""What the repository holds at its top, and nothing else."""

PUBLIC = ROOT / "ispom" / "__init__.py"
"""Names what is public, of all layers."""


def modules(folder: str) -> list[Path]:
    """Those of the product: a feature has its tests in its own folder."""
    return sorted(path for path in (ROOT / folder).rglob("*.py") if "tests" not in path.relative_to(ROOT).parts)


def room(parts: tuple[str, ...]) -> str:
    """The package of the app that a module below `app` belongs to: each view and each feature is one."""
    return ".".join(parts[:2]) if parts[0] in ("views", "features") else parts[0]


def imported(path: Path) -> Iterator[str]:
    """Full names of the modules that a file imports, at any depth of it; relative ones start with a dot."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def part(name: str) -> str:
    """`solvers` of `ispom.solvers.rigid`."""
    return name.split(".")[1]


def level(name: str) -> int:
    return next(i for i, layer in enumerate(LAYERS) if name in layer)


def test_every_part_has_a_layer() -> None:
    parts = {path.relative_to(ROOT / "ispom").parts[0].removesuffix(".py") for path in modules("ispom")}
    assert parts - {"__init__"} <= set().union(*LAYERS)


@pytest.mark.parametrize(
    "path", [path for path in modules("ispom") if path != PUBLIC], ids=lambda p: str(p.relative_to(ROOT))
)
def test_imports_go_down_only(path: Path) -> None:
    own = path.relative_to(ROOT / "ispom").parts[0].removesuffix(".py")
    for name in imported(path):
        if not name.startswith("ispom.") or part(name) == own:
            continue
        assert level(part(name)) < level(own) or (own, part(name)) in SIDEWAYS, f"{path} imports {name}"


def module_name(path: Path) -> str:
    """`ispom.solvers.rigid` of a file; of a package, without `__init__`."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def imported_modules(path: Path, names: set[str]) -> Iterator[str]:
    """Which modules of the library a file imports, in functions and for annotations, too."""
    package = module_name(path).split(".")[: None if path.name == "__init__.py" else -1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from names & {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1], *filter(None, [node.module])] if node.level else []
            whole = ".".join(base) if base else node.module or ""
            parts = {f"{whole}.{alias.name}" for alias in node.names}
            yield from names & (parts if parts <= names else {whole, *parts})


def test_no_import_goes_in_a_circle_in_the_library() -> None:
    paths = {module_name(path): path for path in modules("ispom") if path != PUBLIC}
    graph = {name: set(imported_modules(path, set(paths))) - {name} for name, path in paths.items()}
    tuple(TopologicalSorter(graph).static_order())  # CycleError names a circle


@pytest.mark.parametrize("path", modules("ispom"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_library_has_no_window(path: Path) -> None:
    assert not {name.split(".")[0] for name in imported(path)} & WINDOWS


@pytest.mark.parametrize("path", modules("ispom"), ids=lambda p: str(p.relative_to(ROOT)))
def test_only_simulated_images_use_the_simulation(path: Path) -> None:
    users = {*(ROOT / "ispom" / "simulation").rglob("*.py")}
    users |= {ROOT / "ispom" / "sequences" / "formats" / "simulated.py"}
    users |= {ROOT / "ispom" / "calibration" / "filmed" / "simulated.py"}
    assert path in users or not any(name.startswith("ispom.simulation") for name in imported(path))


@pytest.mark.parametrize("path", modules("app"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_app_imports_itself_relatively(path: Path) -> None:
    assert not {name.split(".")[0] for name in imported(path)} & {"ispom_app", "app", "evo", "tests"}


def app_parts(path: Path) -> Iterator[str]:
    """Which parts of the app a file of it imports."""
    package = path.relative_to(ROOT).parent.parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = (*package[: len(package) - node.level + 1], *filter(None, (node.module or "").split(".")))
            is_package = len(base) < (3 if base[1:2] in (("views",), ("features",)) else 2)
            names = [(*base, alias.name) for alias in node.names] if is_package else [base]
            yield from (room(parts[1:]) for parts in names)


@pytest.mark.parametrize("path", modules("app"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_apps_imports_go_down_only(path: Path) -> None:
    def floor(part: str) -> int:
        kind = "features" if part.startswith("features.") else part
        return next(i for i, layer in enumerate(APP_LAYERS) if kind in layer)

    own = room(path.relative_to(ROOT / "app").with_suffix("").parts)
    for part in app_parts(path) if path.name != "__init__.py" else ():
        assert part == own or floor(part) <= floor(own), f"{path} imports {part}"


def test_no_import_goes_in_a_circle_between_the_apps_packages() -> None:
    graph: dict[str, set[str]] = {}
    for path in modules("app"):
        own = room(path.relative_to(ROOT / "app").with_suffix("").parts)
        graph.setdefault(own, set()).update(set(app_parts(path)) - {own})
    tuple(TopologicalSorter(graph).static_order())  # CycleError names a circle


def test_the_top_level_is_as_agreed() -> None:
    try:
        listing = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    assert {name.split("/")[0] for name in listing.splitlines()} <= TOP
