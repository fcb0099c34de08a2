"""The app on the stand-in sequence, as a process of its own: `python -m tests.app.page.serve_double FOLDER PORT`."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.page.server import Serving, serve
from ispom_app.session.session import Session

from tests.app.helpers import build, opener

if __name__ == "__main__":
    folder, port = Path(sys.argv[1]), int(sys.argv[2])
    sys.exit(
        serve(
            lambda live: Session(opener, "double:40", folder, live=live, builder=build),
            Serving(port=port, base="/ispom/", open_browser=False),
        )
    )
