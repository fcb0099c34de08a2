"""ISPOM: image-only position and orientation of a moving platform (Li, Liu & Yuan, 2013). No GUI in here."""
