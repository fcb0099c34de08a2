"""Tables of what `ispom run` writes (columns, quantities, events, reasons for the end of a track), and of doubts."""

from __future__ import annotations

from types import ModuleType

from markdown_text import as_cell, as_prose, table


def pages() -> dict[str, str]:
    """Returns snippets that pages of the reference include."""
    from ispom_app.engine.history.quantities import CHANGES, EXPOSURE_QUANTITIES, POSE, STEP_QUANTITIES
    from ispom_app.engine.run_events.kinds import checks, frames, tracking
    from ispom_app.engine.run_folder.digests import DIGESTS
    from ispom_app.engine.run_folder.step_log import DECISION_COLUMNS, STEP_COLUMNS
    from ispom_app.session.actions import actions
    from ispom_app.session.registry import load_features

    from ispom.io.calibrations.dialects import modules
    from ispom.io.poses.dialects import modules as pose_modules
    from ispom.plausibility import DOUBTS
    from ispom.types import TrackStatus

    known = {
        q.key: as_cell(q.help + (f" [{q.unit}]" if q.unit else "")) + (" (0 or 1)" if q.kind == "flag" else "")
        for q in STEP_QUANTITIES
    }
    known |= {
        "exposure": "number of the frame, from 0",
        "time_ns": "time of the frame in nanoseconds",
        "method": "the method's name",
        "stages": "time of each stage, as `name=seconds;...`; `seconds` is their sum",
        "frame": "whose pose: `rig`, `left` or `video`",
    }
    known |= dict.fromkeys(POSE[:3], "position in the method's own world and unit, as given at that frame")
    known |= dict.fromkeys(POSE[3:], "orientation as a unit quaternion, as given at that frame")
    known |= dict.fromkeys(DIGESTS, "fingerprint of the arrays: equal bits give equal digests")
    steps = table(("column", "meaning"), [(f"`{name}`", known[name]) for name in STEP_COLUMNS])
    meaning = {
        "exposure": known["exposure"],
        "time_ns": known["time_ns"],
        "method": known["method"],
        "key": "stable name of the check; [all checks](checks.md) explains each",
        "about": "track, pair or keyframe that it is about, where a step has the check several times",
        "question": "what the check helps to answer",
        "kind": "`requirement`, `trigger`, `finding` or `warning`",
        "name": "what is compared, in words",
        "value": "measured value",
        "relation": "relation of value to threshold under which the check passes",
        "threshold": "limit",
        "unit": "unit of value and threshold",
        "passed": "1 or 0",
        "consequence": "what followed, where the name does not say it",
    }
    decisions = table(("column", "meaning"), [(f"`{name}`", meaning[name]) for name in DECISION_COLUMNS])
    kinds = [kind for module in (tracking, checks, frames) for kind in module.KINDS]
    events = table(("kind", "label", "meaning"), [(f"`{k.name}`", as_cell(k.label), as_cell(k.help)) for k in kinds])
    rows = [(f"`{q.name}`", as_cell(q.help)) for q in EXPOSURE_QUANTITIES]
    rows += [(f"`METHOD.{q.key}`", as_cell(q.help + (f" [{q.unit}]" if q.unit else ""))) for q in CHANGES]
    quantities = table(("name", "meaning"), rows)
    ends = [(f"`{s.name.lower()}`", as_cell(s.reason)) for s in TrackStatus if s.dropped]
    doubts = [(f"`{key}`", as_cell(text)) for key, text in DOUBTS.items()]
    load_features()
    keys = [(f"`{a.key.replace('Arrow', '')}`", as_cell(a.label), as_cell(a.hint)) for a in actions()]
    return {
        "_generated/calibrations.md": _dialects(list(modules().values())),
        "_generated/poses.md": _dialects(list(pose_modules().values())),
        "_generated/doubts.md": table(("key", "what a note points at"), doubts),
        "_generated/keys.md": table(("key", "action", "what it does"), keys),
        "_generated/steps_columns.md": steps,
        "_generated/decisions_columns.md": decisions,
        "_generated/event_kinds.md": events,
        "_generated/quantities.md": quantities,
        "_generated/track_ends.md": table(("reason", "meaning"), ends),
    }


def _dialects(modules: list[ModuleType]) -> str:
    """A row for each dialect of calibrations or poses, and its conventions, which are the docstring of its module."""
    rows = [
        (as_cell(each.title), as_cell(each.files), as_cell(each.looked_for))
        for each in (module.DIALECT for module in modules)
    ]
    parts = [table(("program", "usual file", "recognised by"), rows)]
    for module in modules:
        parts.append(f"## {module.DIALECT.title}\n\n{as_prose(module.__doc__ or '')}")
    return "\n\n".join(parts)
