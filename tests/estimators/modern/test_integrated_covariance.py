"""How observations follow the correction of the lens."""

from __future__ import annotations

import numpy as np

from ispom.estimators.modern.integrated.covariance import by_lens
from ispom.estimators.modern.lens import corrected


def test_places_change_with_the_lens_as_finite_differences_say() -> None:
    seen, eps = np.random.default_rng(1).uniform(-0.5, 0.5, (20, 2)), 1e-6
    for i, found in enumerate(np.moveaxis(by_lens(seen), 2, 0)):
        difference = (corrected(seen, eps * np.eye(2)[i]) - seen) / eps
        np.testing.assert_allclose(found, difference, atol=1e-5)
