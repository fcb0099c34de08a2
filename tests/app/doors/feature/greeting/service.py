from __future__ import annotations

from ispom_app.session.controller import Controller
from ispom_app.session.service import Service


class Counter(Service):
    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self.handled = 0
