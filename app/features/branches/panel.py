"""Branches: the run and its forks, what differs in their settings, and how each method does in them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import viser

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.methods import in_order

from ...engine.external_trajectories.placed import ExternalTrajectory
from ...presentation import colours
from ...presentation.texts import ALIGNED, ALIGNMENTS, MILLISECOND, PROVISIONAL, Unit, length, length_unit
from ...session.branches.branches import NAME_LENGTH, Branch
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.external_paths import ExternalPaths
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from .commands import DeleteBranch, HideBranch, RenameBranch, ShowBranch

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

NO_BRANCH: tuple[str, ...] = ("-",)
SHOW, DELETE = "Show", "Delete"
COMMANDS = {SHOW: ShowBranch, DELETE: DeleteBranch}
HINT = "Show: this branch in all views. Delete: removes it. The mode Compare shows where two differ."


class BranchesPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._branches, self._shown = session, (), -1
        self._text = gui.add_html(_text(session.state, self._has_truth))
        self._choice = gui.add_dropdown("branch", NO_BRANCH, hint="The branch for the controls below.")
        self._choice.on_update(lambda _: self._fill())
        self._buttons = gui.add_button_group("", tuple(COMMANDS), hint=HINT)
        self._buttons.on_click(self._clicked)
        self._drawn = gui.add_checkbox("drawn", True, hint="Draw its trajectories while another branch is shown.")
        self._drawn.on_update(self._drawn_changed)
        self._name = gui.add_text("name", "", hint=f"Up to {NAME_LENGTH} characters.")
        self._rename = gui.add_button("Rename", icon=viser.Icon.PENCIL, hint="Gives the branch the name above.")
        self._rename.on_click(lambda _: self._post(lambda branch: RenameBranch(branch.number, self._name.value)))

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
            self._session.post(HideBranch(branch.number, not self._drawn.value))

    def _fill(self) -> None:
        """The controls, with what the chosen branch has."""
        if (branch := self._chosen) is not None:
            self._name.value, self._drawn.value = branch.name, not branch.hidden

    def show(self, state: State) -> None:
        if (text := _text(state, self._has_truth)) != self._text.content:
            self._text.content = text
        labels, chosen, moved = _labels(state), self._chosen, state[Branches].shown != self._shown
        self._branches, self._shown = state[Branches].all, state[Branches].shown
        if moved or labels != tuple(self._choice.options):
            selected = next((b for b in state[Branches].all if chosen is not None and b.number == chosen.number), None)
            if moved or selected is None:
                selected = _counterpart(state)
            self._choice.options = labels
            self._choice.value = _label(selected) if selected is not None else "-"
            self._fill()
        for control in (self._choice, self._buttons, self._drawn, self._name, self._rename):
            control.visible = len(state[Branches].all) > 1

    def _has_truth(self, branch: Branch) -> bool:
        run = self._session.service(BranchService).run_of(branch.number)
        return run is not None and run.opened.truth is not None


def _counterpart(state: State) -> Branch | None:
    """What the branch that is shown is most likely to be compared with: its parent, or else the newest other one."""
    shown = next((b for b in state[Branches].all if b.number == state[Branches].shown), None)
    others = [b for b in state[Branches].all if b is not shown]
    parent = [b for b in others if shown is not None and b.number == shown.parent]
    return next(iter(parent or others[::-1]), shown)


def _labels(state: State) -> tuple[str, ...]:
    return tuple(map(_label, state[Branches].all)) or NO_BRANCH


def _label(branch: Branch) -> str:
    return f"{branch.number}: {branch.name}"


def _text(state: State, has_truth: Callable[[Branch], bool]) -> str:
    """The branches and how each method does in them, as HTML. All lengths of the tables share one unit."""
    errors = [error for b in state[Branches].all for error in b.measured.errors.values()]
    unit = length_unit(e.ate_m for e in (*errors, *state[ExternalPaths].errors.values()))
    branches = [_entry(branch, state, unit, has_truth(branch)) for branch in state[Branches].all]
    others = [_other(external, state, unit) for external in state[ExternalPaths].all]
    return render("branches.html", branches=branches, others=others)


def _other(external: ExternalTrajectory, state: State, unit: Unit) -> dict[str, Any]:
    """The trajectory of another program, over the frames that the branch shown has computed."""
    placed = external.of_truth
    known = {"name": external.name, "colour": external.colour, "file": external.option.file.path.name}
    if placed is None:
        return known | {"ate": "no truth", "missing": "", "alignment": "aligned to the first method's poses"}
    error = state[ExternalPaths].errors.get(external.name)
    ate = "" if error is None else _ate(error, unit)
    return known | {"ate": ate, "missing": placed.missing(state.computed), "alignment": placed.alignment}


def _entry(branch: Branch, state: State, unit: Unit, has_truth: bool) -> dict[str, Any]:
    names = {b.number: b.name for b in state[Branches].all}
    origin = f"{branch.computed} of {state.total} frames"
    if branch.parent is not None:
        changes = "; ".join(branch.changes) or "nothing changed"
        origin = f"{names.get(branch.parent, 'a deleted branch')}, from frame {branch.at} on: {changes}. {origin}"
    rows = [_row(name, branch, unit, has_truth) for name in in_order(branch.tally.methods)]
    known = {
        "name": branch.name,
        "colour": branch.colour,
        "hidden": branch.hidden,
        "held": branch.history_usage.sentence,
    }
    return known | {"shown": branch.number == state[Branches].shown, "origin": origin, "methods": rows}


def _row(method: str, branch: Branch, unit: Unit, has_truth: bool) -> dict[str, Any]:
    tally, error = branch.tally.methods[method], branch.measured.errors.get(method)
    seconds = branch.measured.seconds.get(method)
    ate, hint = "" if has_truth else "no truth", ""
    if error is not None:
        ate, hint = _ate(error, unit), f"over {len(error.estimate)} poses, aligned by {ALIGNMENTS[error.alignment]}"
    elif has_truth and tally.provisional:
        ate, hint = PROVISIONAL, "no fit yet: the poses wait for the first stereo pairs"
    return {
        "label": colours.label(method),
        "ate": ate,
        "ate_hint": hint,
        "lost": tally.lost,
        "ms": "" if seconds is None else MILLISECOND.of(seconds),
    }


def _ate(error: TrajectoryError, unit: Unit) -> str:
    return f"{length(error.ate_m, unit)} {ALIGNED[error.alignment]}"


PANELS = (Panel("Branches", 400, BranchesPanel),)
