"""The app with lessons: `python -m tests.app.page.serve_lessons FOLDER [own]`; `own` is one on stand-ins."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.engine.options import SourceOptions
from ispom_app.features.lessons.library import Library
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.views.web.server import Serving, serve

from ispom.ensemble import build
from ispom.sequences import open_sequence
from ispom.types import Sequence
from tests.app import helpers
from tests.app.session.learning.lessons import LESSON


def opener(source: str, _: SourceOptions | None = None) -> Sequence:
    return helpers.opener(source) if source.startswith("double:") else open_sequence(source)


if __name__ == "__main__":
    folder, own = Path(sys.argv[1]), sys.argv[2:] == ["own"]
    library = Library(LESSON if own else None, folder / "lessons.json")
    source, builder = ("double:40", helpers.build) if own else ("sim:tiny", build)
    methods = ("stereo.paper",)
    sys.exit(
        serve(
            lambda live: Session(
                SessionSetup(
                    opener, source, folder, builder=builder, methods=methods, extras=(library,), autoplay=False
                ),
                live,
            ),
            Serving(port=0, base="/ispom/", open_browser=False, mode="learn"),
        )
    )
