"""The modern integration of video and stereo. Read `estimator`, then its steps: `observe`, `localise`, `optimise` (with
`knots`, `problem`), `alignment`, `report`; `state` and `window` hold the values between them, `shutter` the rows."""
