"""The modern integration of video and stereo. Read `estimator`, then its steps: `observe`, `localise`, `optimise` (with
`knots`, `problem`), `alignment`, `report`; `state` and `window` hold the values between them, `shutter` the rows.

Constants are limits of published methods, or measured: `python -m tests.accuracy.constants` halves and doubles
each, and `tests/accuracy/constants.md` has the effect on real recordings.
"""
