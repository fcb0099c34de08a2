"""What is undecided, on the time axis."""

from __future__ import annotations

from io import BytesIO

from matplotlib.figure import Figure

from ispom.evaluation.undecided.stretches import Answer
from ispom.evaluation.undecided.weakest import DECIDED_PX

from .options import CREATOR
from .text import WORDS


def svg(name: str, answers: list[Answer]) -> bytes:
    """Returns the picture: how far the weakest combination may be off in each stretch, and which numbers take part."""
    figure = Figure(figsize=(10, 5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    start_ns = answers[0].first_ns
    named = list(dict.fromkeys(part.name for a in answers if a.decided for part in a.decided.weakest))
    for each in answers:
        first, last = ((t - start_ns) * 1e-9 for t in (each.first_ns, each.last_ns))
        if each.decided is None:
            above.axvspan(first, last, color="0.85")
            continue
        above.plot([first, last], [each.decided.weakest_px] * 2, color="tab:blue", linewidth=3)
        for part in each.decided.weakest:
            share = abs(part.px) / each.decided.weakest_px
            below.barh(named.index(part.name), last - first, left=first, alpha=share, color="tab:blue")
    above.axhline(DECIDED_PX, color="tab:red", linewidth=1)
    above.set(yscale="log", ylabel="weakest combination [px]", title=name)
    below.set(xlabel="time [s]", yticks=range(len(named)), yticklabels=[WORDS[each][0] for each in named])
    below.invert_yaxis()
    out = BytesIO()
    figure.savefig(out, format="svg", metadata={"Creator": CREATOR, "Date": None})
    return out.getvalue()
