"""What a command writes as JSON, held against the schema that `ispom schema` prints."""

from __future__ import annotations

import json

from ispom_app.cli.commands import COMMANDS
from ispom_app.engine.outputs import schema_of
from jsonschema import Draft202012Validator

from ispom.types import Trajectory


def breaks_schema(command: str, text: str) -> list[str]:
    """Returns what is not as the schema of the command says; empty where all is."""
    kind = COMMANDS.get(command).written()
    assert kind is not None, f"{command} has no schema"
    checked = Draft202012Validator(json.loads(schema_of(kind)))
    return [f"{fault.json_path}: {fault.message}" for fault in checked.iter_errors(json.loads(text))]


def kitti_text(trajectory: Trajectory) -> str:
    """As KITTI writes it: the first three rows of each pose on a line."""
    return "".join(f"{' '.join(map(repr, p.matrix[:3].ravel().tolist()))}\n" for _, p in trajectory.items())
