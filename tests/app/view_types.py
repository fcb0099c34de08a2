"""The types of the view values for the page's scripts: `python -m tests.app.view_types` writes them.

TypeScript's types, made from the JSON schema of the values.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_type_hints

import msgspec
from ispom_app.views.web.view_values import views

FILE = Path(__file__).parents[2] / "app" / "views" / "web" / "static" / "views.d.ts"
HEAD = (
    "// Written by `python -m tests.app.view_types` from the view values of the features (app/features/NAME/view.py).\n"
)
PLAIN = {"string": "string", "number": "number", "integer": "number", "boolean": "boolean", "null": "null"}


def text() -> str:
    """What the file holds."""
    kinds = [get_type_hints(view.of)["return"] for view in views()]
    _, components = msgspec.json.schema_components(kinds, ref_template="{name}")
    return HEAD + "".join(_interface(name, schema) for name, schema in sorted(components.items()))


def _interface(name: str, schema: dict[str, Any]) -> str:
    if "properties" not in schema:
        return f"\nexport type {name} = {_type(schema)};\n"
    comment = f"/** {' '.join(schema['description'].split())} */\n" if "description" in schema else ""
    lines = "".join(f"  {key}: {_type(value)};\n" for key, value in schema["properties"].items())
    return f"\n{comment}export interface {name} {{\n{lines}}}\n"


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        return schema["$ref"]
    if "anyOf" in schema:
        return " | ".join(_type(each) for each in schema["anyOf"])
    if "enum" in schema:
        return " | ".join(f'"{value}"' for value in schema["enum"])
    kind = schema["type"]
    if kind == "array" and "prefixItems" in schema:
        return f"[{', '.join(_type(each) for each in schema['prefixItems'])}]"
    if kind == "array":
        return f"({_type(schema['items'])})[]" if "anyOf" in schema["items"] else f"{_type(schema['items'])}[]"
    if kind == "object":
        return f"Record<string, {_type(schema['additionalProperties'])}>"
    return PLAIN[kind]


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
