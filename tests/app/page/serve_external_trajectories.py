"""The app with both integrations as stand-ins, and another program's trajectory beside them:
`python -m tests.app.page.serve_external_trajectories FOLDER PORT`."""

from __future__ import annotations

import sys
from pathlib import Path

from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.views.web.server import Serving, serve

from tests.app import helpers
from tests.app.run.external_trajectories.made import elsewhere, read, written

METHODS = ("monocular", "stereo", "integrated", "integrated.paper")
SOURCE = "double:40"

if __name__ == "__main__":
    folder, port = Path(sys.argv[1]), int(sys.argv[2])
    path = written(folder / "orb.tum", elsewhere(helpers.opener(SOURCE), unit_m=0.95))
    sys.exit(
        serve(
            lambda live: Session(
                SessionSetup(
                    helpers.opener,
                    SOURCE,
                    folder,
                    builder=helpers.build,
                    methods=METHODS,
                    trajectory_options=(read(path),),
                ),
                live,
            ),
            Serving(port=port, base="/ispom/", open_browser=False),
        )
    )
