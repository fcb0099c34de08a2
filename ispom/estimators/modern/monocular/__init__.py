"""The modern monocular method. Read `estimator`, then its steps.

Without a map: `track`, `initialise` (with `first_map`). With a map: `track`, `localise` (with `align`,
`untriangulated`, and `shutter` for a rolling one), `recover` (with `match_keyframes`), `keyframe` (with `window`),
`verify_map`. In the end: `conclude`. `state`, `tracks`, `map` and `covariance` hold the values between them.

Constants are limits of published methods, or measured: `python -m tests.accuracy.constants` halves and doubles
each, and `tests/accuracy/constants.md` has the effect on real recordings.
"""
