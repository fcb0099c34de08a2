"""The influence of each part of a problem (tracks, keyframes, priors) on a pose: solves the problem without the
part."""
