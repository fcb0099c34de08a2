"""The app with the real stereo estimator on sim:tiny: `python -m tests.app.page.serve_tiny FOLDER PORT`."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.views.web.server import Serving, serve

from ispom.sequences import open_sequence
from ispom.types import Sequence


def opener(source: str, _: object = None) -> Sequence:
    return open_sequence(source)


if __name__ == "__main__":
    folder, port = Path(sys.argv[1]), int(sys.argv[2])
    sys.exit(
        serve(
            lambda live: Session(SessionSetup(opener, "sim:tiny", folder, methods=("stereo",)), live),
            Serving(port=port, base="/ispom/", open_browser=False),
        )
    )
