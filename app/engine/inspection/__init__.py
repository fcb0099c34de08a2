"""What can be looked at closely: tracks, points, key frames and residuals, as pure functions of what history keeps."""
