"""What can go wrong, by who can mend it."""

__all__ = ["Cancelled", "HomologError", "InputError", "NumericalError"]


class HomologError(Exception):
    """Base of every error that Homolog raises on purpose."""


class InputError(HomologError):
    """The user can mend it: the message names the subject or file, what is wrong and the remedy."""


class NumericalError(HomologError):
    """A computation failed: the message names the subject and the step."""


class Cancelled(HomologError):
    """The user cancelled; raised by a tick, never shown as an error."""
