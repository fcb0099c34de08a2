"""Every control and column says what it is, with the unit where there is one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import ispom_app
import pytest
from ispom_app.engine.options import SourceOptions
from ispom_app.views.viser.controls import hint_of, label_of, unit_of
from ispom_app.views.viser.screen import Screen

from ispom.methods import registry
from ispom.settings import settings
from tests.app.gui import inputs_of
from tests.app.helpers import started, wait_for

APP = Path(ispom_app.__file__).parent
PANELS = sorted(p for p in (APP / "features").glob("*/templates/*.html") if (p.parents[1] / "panel.py").exists())
CONFIGS = {name: method.config for name, method in registry().items()} | {"source": SourceOptions}
RELATIVE = re.compile(
    r"\[[^\]]+\]|\bshare\b|\brelative\b|\bdeviations?\b|\bthis many\b|\bin video frames\b",
    re.IGNORECASE,
)
"""What the text of a setting says that is no whole number and has no unit in its name: its unit, or of what it is a
part or a multiple."""
NO_CONTROLS = {"GuiHtmlHandle", "GuiMarkdownHandle", "GuiProgressBarHandle", "GuiUplotHandle", "GuiImageHandle"}


def test_every_control_of_the_panels_has_a_hint(tmp_path: Path) -> None:
    session = started(tmp_path)
    wait_for(lambda: session.state.ended, "the end")
    screen = Screen(session)
    screen.show_tabs(screen.tabs)
    screen.paint()
    handles: list[Any] = inputs_of(screen.server)
    controls = [handle for handle in handles if type(handle).__name__ not in NO_CONTROLS]
    assert len(controls) > 80
    silent = [(type(c).__name__, getattr(c, "label", "")) for c in controls if not getattr(c, "hint", None)]
    assert not silent
    screen.server.stop()
    session.close(5)


@pytest.mark.parametrize("name", CONFIGS)
def test_every_setting_has_a_hint_with_its_unit(name: str) -> None:
    for setting in settings(CONFIGS[name]):
        hint, unit = hint_of(setting), unit_of(setting.name)
        assert len(hint) > 10, setting.name
        if unit:
            assert f"[{unit}]" in label_of(setting.name) and unit in hint, setting.name
        elif "float" in str(setting.type):
            assert RELATIVE.search(setting.help), f"{setting.name}: name its unit, or say of what it is a share"


@pytest.mark.parametrize("path", PANELS, ids=lambda path: path.name)
def test_every_column_has_a_hint(path: Path) -> None:
    for row in re.findall(r'<tr style="opacity:.85">(.*?)</tr>', path.read_text(), re.S):
        cells = re.findall(r"<td[^>]*>", row)
        assert cells and all(" title=" in cell for cell in cells), row
    tables = path.read_text().count("<table")
    assert path.read_text().count('<tr style="opacity:.85">') == tables, "each table says what its columns are"


def test_every_button_of_the_page_itself_has_a_hint() -> None:
    page = (APP / "views" / "web" / "static" / "index.html").read_text()
    elements = re.findall(r"<(?:button|a|progress)\b[^>]*>|<[^>]*tabindex=[^>]*>", page)
    assert len(elements) > 10
    assert not [element for element in elements if " title=" not in element]
