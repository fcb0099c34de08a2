"""The exceptions that a user's input may cause: what, where, and what to do, in one sentence."""


class InputError(Exception):
    """Something that the user gave cannot be used. The message is one sentence that names the place and the cure."""


class UnreadableImage(InputError):
    """One image of a recording is missing or damaged; those around it may be whole."""
