"""What moved a pose, and by how much: tracks, keyframes, priors and sensors left out of what was solved for it."""
