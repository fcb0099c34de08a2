"""The services of the features, in the order of their places."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

from .service import Service

S = TypeVar("S", bound=Service)


class Services:
    """One of each kind. Iterating gives them in order."""

    def __init__(self) -> None:
        self._by_kind: dict[type[Service], Service] = {}

    def __iter__(self) -> Iterator[Service]:
        return iter(self._by_kind.values())

    def add(self, *services: Service) -> None:
        self._by_kind |= {type(service): service for service in sorted(services, key=lambda each: each.place)}

    def of(self, kind: type[S]) -> S:
        return self._by_kind[kind]  # type: ignore[return-value]

    @property
    def kept_branches(self) -> frozenset[int]:
        """Numbers of the branches that a service keeps elsewhere, for example in a recording."""
        return frozenset().union(*(service.kept_branches for service in self))
