"""The command: opens poses and recording, judges, prints, and gives the exit code."""

from __future__ import annotations

import sys

from ispom.errors import printable
from ispom.evaluation.judge.tracks import main_camera, main_frames
from ispom.io.whole import write_whole
from ispom.stop import check_stop

from ...engine.outputs import claim_folder, json_of
from ...engine.signals import terminable
from ..headless.console import progress
from .options import Judge
from .page import opening, worst_frame, write_page
from .question import Question, require_images
from .text import lines
from .written import written

EXIT_CODES = {"agrees": 0, "contradicted": 1, "cannot tell": 3}
"""Exit codes by verdict; 2 is for a mistake of the user."""


def judge(options: Judge) -> int:
    """Returns the exit code of the verdict. Raises InputError for what is wrong with the poses or the recording."""
    question = Question.of_files(options.poses, options.frame, options.times)
    sequence = options.opened(options.recording)
    require_images(sequence, options.recording)
    places = main_frames(sequence)
    with terminable(), progress(len(places)) as advance:

        def read() -> None:
            check_stop()
            advance()

        found = question.answer(sequence, options.recording, read)
    place = int(places[worst_frame(found.of)])
    command = opening(options, "rig" if question.of_rig else main_camera(sequence), place)
    content = json_of(written(found))
    if options.out is not None:
        claim_folder(options.out, "judge")
        write_whole(options.out / "judge.json", content)
    text = content if options.json else "\n".join(lines(found)) + "\n"
    if options.page is not None:
        write_page(options.page, found, command)
    if found.of.verdict == "contradicted" and not options.json:
        text += f"See it: {printable(command)}\n"
    sys.stdout.write(text)
    return EXIT_CODES[found.of.verdict]
