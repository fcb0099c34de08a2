"""The interior of a camera from the tracks of corners in its own images, without a target."""
