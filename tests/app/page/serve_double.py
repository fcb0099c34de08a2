"""The app on the stand-in sequence, as a process of its own: `python -m tests.app.page.serve_double FOLDER PORT`."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.page.server import serve

from tests.app.helpers import build, opener

if __name__ == "__main__":
    folder, port = Path(sys.argv[1]), int(sys.argv[2])
    sys.exit(serve(opener, "double:40", port=port, open_browser=False, recordings_dir=folder, builder=build))
