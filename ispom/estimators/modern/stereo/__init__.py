"""The stereo method. Its steps, one file each, in the order of `estimator.py`:

`predict`, `track` (left image), `localise` (match the right image, estimate the pose), `recover`, `other_motion`,
`keyframe`, `map` (with `window`, or `rolling_window`), `report`, `loop`. `pair` and `state` hold the data.

Constants have their reason in their docstring. `tests/accuracy/constants.md` states the effect of half and twice the
value on the error (`python -m tests.accuracy.constants` measures it again).
"""
