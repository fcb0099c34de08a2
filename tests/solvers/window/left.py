"""A window after its first pose and some points have left it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ispom.solvers.window.adjustment import Window
from ispom.solvers.window.prior import Prior


def without_oldest(whole: Window, gone: NDArray[np.bool_], prior: Prior) -> Window:
    """Without the first pose and the points `gone` (M,), all that it saw among them; `prior` stands for these."""
    kept = ~gone[whole.owners]
    return replace(
        whole,
        rotations=whole.rotations[1:],
        translations=whole.translations[1:],
        points=whole.points[~gone],
        cameras=whole.cameras[kept] - 1,
        owners=(np.cumsum(~gone) - 1)[whole.owners[kept]],
        seen=whole.seen[kept],
        factors=whole.factors[kept] if len(whole.factors) else whole.factors,
        prior=prior,
    )
