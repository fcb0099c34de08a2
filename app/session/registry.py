"""What the features bring to a session, found by listing the folder `features`.

A feature is a folder. Of its modules these are imported here, if it has them: `state` with a `FeatureState`,
`commands` with commands, `service` with a `Service`, and `page_message` with the messages between it and a page. A new
feature needs no other change.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

from .branches.service import BranchService
from .service import Service

FEATURES = __name__.split(".")[0] + ".features"
PARTS = ("state", "commands", "service", "page_message")


def load_features() -> None:
    """Imports these modules of all features."""
    for part in PARTS:
        list(modules(part))


def services() -> list[type[Service]]:
    """Returns the service of the branches, and those of the features."""
    found = (value for module in modules("service") for value in vars(module).values())
    own = (kind for kind in found if isinstance(kind, type) and kind in Service.__subclasses__())
    return list(dict.fromkeys((BranchService, *own)))


def modules(part: str) -> Iterator[ModuleType]:
    """The modules of this name in the folders of the features, in the order of the folders' names."""
    package = import_module(FEATURES)
    for folder in iter_modules(package.__path__):
        feature = import_module(f"{FEATURES}.{folder.name}")
        if folder.ispkg and any(module.name == part for module in iter_modules(feature.__path__)):
            yield import_module(f"{FEATURES}.{folder.name}.{part}")
