"""What the features bring to a session, found by listing the folder `features`.

A feature is a folder. Of its modules these are imported here, if it has them: `state` with a `FeatureState`,
`commands` with commands and their handlers, and `service` with a `Service`. Nothing else is edited for a new one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from .commands import Command
from .service import Service

if TYPE_CHECKING:
    from .controller import Controller

FEATURES = __name__.split(".")[0] + ".features"
PARTS = ("state", "commands", "service")

C = TypeVar("C", bound=Command)
Handler = Callable[["Controller", C], None]
Closing = Callable[["Controller", C], str]
_HANDLERS: dict[type[Command], tuple[Handler[Any], Closing[Any] | None]] = {}


def handles(kind: type[C], closing: Closing[C] | None = None) -> Callable[[Handler[C]], Handler[C]]:
    """Registers the decorated function as what carries out commands of this kind, in the worker's thread.

    `closing` is for commands that may close the run: it returns what closes it, as the beginning of a sentence, or an
    empty text if this one does not. Where something would be lost, a person is asked first.
    """

    def register(handler: Handler[C]) -> Handler[C]:
        _HANDLERS[kind] = handler, closing
        return handler

    return register


def handler_of(command: C) -> Handler[C]:
    """KeyError for a command without a handler."""
    return _HANDLERS[type(command)][0]


def closing_of(command: C) -> Closing[C] | None:
    return _HANDLERS[type(command)][1]


def load_features() -> None:
    """Imports what the features bring to a session."""
    for part in PARTS:
        list(modules(part))


def services() -> list[type[Service]]:
    """The services of the features."""
    found = (value for module in modules("service") for value in vars(module).values())
    return list(dict.fromkeys(kind for kind in found if isinstance(kind, type) and kind in Service.__subclasses__()))


def modules(part: str) -> Iterator[ModuleType]:
    """The modules of this name in the folders of the features, in the order of the folders' names."""
    package = import_module(FEATURES)
    for folder in iter_modules(package.__path__):
        feature = import_module(f"{FEATURES}.{folder.name}")
        if folder.ispkg and any(module.name == part for module in iter_modules(feature.__path__)):
            yield import_module(f"{FEATURES}.{folder.name}.{part}")
