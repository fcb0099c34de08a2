from __future__ import annotations

from ispom_app.session.actions import Action, offer
from ispom_app.session.commands import PageCommand
from ispom_app.session.controller import Controller

from .service import Counter
from .state import Greetings


class Greet(PageCommand, frozen=True):
    times: int = 1

    def execute(self, session: Controller) -> None:
        session.service(Counter).handled += 1
        session.store.put(Greetings(session.state[Greetings].count + self.times))


offer(Action(900, "greet", "g", "Greet", "Greets once.", Greet()))
