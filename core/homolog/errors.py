"""What can go wrong, by who can mend it."""

__all__ = ["Cancelled", "HomologError", "InputError", "NumericalError", "words_for"]


class HomologError(Exception):
    """Base of every error that Homolog raises on purpose."""


class InputError(HomologError, ValueError):
    """The user can repair it: the message names the subject or file, what is wrong and the remedy.

    Also a `ValueError`, which libraries catch by custom.
    """


class NumericalError(HomologError, ArithmeticError):
    """A computation failed: the message names the subject and the step. Also an `ArithmeticError`."""


class Cancelled(HomologError):
    """The user cancelled: raised by a callback to stop the work, never shown as an error."""


def words_for(error: BaseException) -> str | None:
    """Return what to tell the user of an error, or None if it is a defect of the program.

    What the system says of a file that it names, such as that it may not be read, the user can mend too.
    """
    if isinstance(error, InputError | NumericalError):
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; see who may read or write it, or choose another place"
    return None
