"""Takes out of texts what says where and by whom a run was computed: paths of folders become the names at their end."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

_PART = r"[^\s\\/\"'<>|:;,()&]+"
_PATH = re.compile(rf"(?<![\w/\\.:])(?:~|[A-Za-z]:)?(?:[\\/]{_PART})+[\\/]({_PART})?")
"""An absolute path of at least two parts. What comes after a scheme (http://) or within a word (m/s) is none."""
VERBATIM = frozenset({"hidden", "eye", "curves", "layout", "paths"})
"""Keys of a message whose values name entities of Rerun, which look like paths."""


class Plain:
    """Rewrites texts and messages. `places` are folders that are cut off wherever they stand, spaces and all."""

    def __init__(self, places: Iterable[Path] = ()) -> None:
        absolute = {str(path) for place in places for path in (place.absolute(), place.resolve())}
        self._places = sorted((each for each in absolute if len(each) > 1), key=len, reverse=True)

    def text(self, text: str) -> str:
        """The text with names in place of absolute paths."""
        for place in self._places:
            text = text.replace(f"{place}/", "").replace(f"{place}\\", "").replace(place, Path(place).name)
        return _PATH.sub(lambda found: found[1] or "…", text)

    def message(self, value: Any, key: str = "") -> Any:
        """The value of a message, all of its texts rewritten."""
        if key in VERBATIM:
            return value
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, dict):
            return {name: self.message(each, str(name)) for name, each in value.items()}
        if isinstance(value, list | tuple):
            return [self.message(each) for each in value]
        return value
