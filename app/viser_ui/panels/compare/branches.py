"""Branches: the run and its forks beside each other, what differs, and how they compare."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import viser

from ispom.methods import in_order

from .... import colours
from ....run.beside.placed import Beside
from ....run.model.tally import MethodTally
from ....session import commands as do
from ....session.branching.branches import NAME_LENGTH, Branch
from ....session.state import State
from ...markup import render

if TYPE_CHECKING:
    from ....session.session import Session

AlignedAte = Callable[[Branch, str], float | None]
"""Of a branch and a method: ATE [m] after a similarity alignment."""
NO_BRANCH: tuple[str, ...] = ("-",)
SHOW, COMPARE, DELETE = "Show", "Compare", "Delete"
COMMANDS = {SHOW: do.ShowBranch, COMPARE: do.CompareBranch, DELETE: do.DeleteBranch}
HINT = (
    "Show: this branch in all views. Compare: the first differences between the branch that is shown and this one. "
    "Delete: forgets it."
)


class BranchesPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._branches, self._shown = session, (), -1
        self._ates: dict[tuple[int, int, str], float | None] = {}
        """By branch, exposures and method: of those without a metric unit."""
        self._text = gui.add_html(_text(session.state, self._ate_m))
        self._choice = gui.add_dropdown("branch", NO_BRANCH, hint="The branch that the controls below are about.")
        self._choice.on_update(lambda _: self._fill())
        self._buttons = gui.add_button_group("", tuple(COMMANDS), hint=HINT)
        self._buttons.on_click(self._clicked)
        self._drawn = gui.add_checkbox("drawn", True, hint="Draw its trajectories while another branch is shown.")
        self._drawn.on_update(self._drawn_changed)
        self._name = gui.add_text("name", "", hint=f"Up to {NAME_LENGTH} characters.")
        self._rename = gui.add_button("Rename", icon=viser.Icon.PENCIL, hint="Gives the branch the name above.")
        self._rename.on_click(lambda _: self._post(lambda branch: do.RenameBranch(branch.number, self._name.value)))

    @property
    def _chosen(self) -> Branch | None:
        return next((b for b in self._branches if _label(b) == self._choice.value), None)

    def _post(self, command: Any) -> None:
        if (branch := self._chosen) is not None:
            self._session.post(command(branch))

    def _clicked(self, _: object) -> None:
        command = COMMANDS[self._buttons.value]
        self._post(lambda branch: command(branch.number))

    def _drawn_changed(self, _: object) -> None:
        branch = self._chosen
        if branch is not None and branch.hidden == self._drawn.value:
            self._session.post(do.HideBranch(branch.number, not self._drawn.value))

    def _fill(self) -> None:
        """The controls, with what the chosen branch has."""
        if (branch := self._chosen) is not None:
            self._name.value, self._drawn.value = branch.name, not branch.hidden

    def show(self, state: State) -> None:
        if (text := _text(state, self._ate_m)) != self._text.content:
            self._text.content = text
        labels, chosen, moved = _labels(state), self._chosen, state.branch != self._shown
        self._branches, self._shown = state.branches, state.branch
        if moved or labels != tuple(self._choice.options):
            kept = next((b for b in state.branches if chosen is not None and b.number == chosen.number), None)
            if moved or kept is None:
                kept = _counterpart(state)
            self._choice.options = labels
            self._choice.value = _label(kept) if kept is not None else "-"
            self._fill()
        for control in (self._choice, self._buttons, self._drawn, self._name, self._rename):
            control.visible = len(state.branches) > 1

    def _ate_m(self, branch: Branch, method: str) -> float | None:
        """After a similarity alignment, computed once for as many exposures."""
        run, key = self._session.branch(branch.number), (branch.number, branch.computed, method)
        if run is None:
            return None
        if key not in self._ates:
            self._ates = {k: v for k, v in self._ates.items() if k[0] != branch.number or k[1] == branch.computed}
            self._ates[key] = run.aligned_ate_m(method)
        return self._ates[key]


def _counterpart(state: State) -> Branch | None:
    """What the branch that is shown is most likely to be compared with: its parent, or else the newest other one."""
    shown = next((b for b in state.branches if b.number == state.branch), None)
    others = [b for b in state.branches if b is not shown]
    parent = [b for b in others if shown is not None and b.number == shown.parent]
    return next(iter(parent or others[::-1]), shown)


def _labels(state: State) -> tuple[str, ...]:
    return tuple(map(_label, state.branches)) or NO_BRANCH


def _label(branch: Branch) -> str:
    return f"{branch.number}: {branch.name}"


def _text(state: State, ate_m: AlignedAte) -> str:
    """The branches and how each method does in them, as HTML."""
    branches = [_entry(branch, state, ate_m) for branch in state.branches]
    return render("branches.html", branches=branches, others=[_other(beside, state) for beside in state.beside])


def _other(beside: Beside, state: State) -> dict[str, Any]:
    """The trajectory of another program, over the exposures that the branch shown has computed."""
    placed = beside.of_truth
    known = {"name": beside.name, "colour": beside.colour, "file": beside.given.file.path.name}
    if placed is None:
        return known | {"rmse": "no truth", "missing": "", "alignment": "aligned to the first method's poses"}
    rmse_m, missing = placed.rmse_m(state.computed), placed.missing(state.computed)
    rmse = "" if rmse_m is None else f"{rmse_m:.3f} m"
    return known | {"rmse": rmse, "missing": missing, "alignment": placed.alignment}


def _entry(branch: Branch, state: State, ate_m: AlignedAte) -> dict[str, Any]:
    names = {b.number: b.name for b in state.branches}
    origin = f"{branch.computed} of {state.total} exposures"
    if branch.parent is not None:
        changes = "; ".join(branch.changes) or "nothing changed"
        origin = f"{names.get(branch.parent, 'a deleted branch')}, from exposure {branch.at} on: {changes}. {origin}"
    shown = branch.number == state.branch
    settled = not (shown and state.playing)  # while it is computed, the trajectory is another one at each exposure
    rows = []
    for name in in_order(branch.tally.methods):
        tally = branch.tally.methods[name]
        aligned_m = ate_m(branch, name) if tally.rmse_m is None and settled else None
        rows.append(_row(name, tally, aligned_m))
    known = {"name": branch.name, "colour": branch.colour, "hidden": branch.hidden, "held": branch.held.sentence}
    return known | {"shown": shown, "origin": origin, "methods": rows}


def _row(method: str, tally: MethodTally, aligned_m: float | None) -> dict[str, Any]:
    aligned = "n/a" if aligned_m is None else f"{aligned_m:.4f} m (sim3)"
    return {
        "label": colours.label(method),
        "rmse": aligned if tally.rmse_m is None else f"{tally.rmse_m:.3f} m",
        "lost": tally.lost,
        "ms": "" if tally.ms is None else f"{tally.ms:.1f}",
    }
