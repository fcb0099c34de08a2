"""What can be looked at closely: tracks, points, keyframes and residuals, as pure functions of what history keeps."""
