"""Details of a frame: tracks, points, keyframes and residuals, as pure functions of the history."""
