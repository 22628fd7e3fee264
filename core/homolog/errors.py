"""Exceptions, grouped by who can fix the cause."""

__all__ = [
    "Cancelled",
    "HomologError",
    "InUseError",
    "InputError",
    "NumericalError",
    "WorkerDiedError",
    "user_message",
]


class HomologError(Exception):
    """Base of all errors that Homolog raises deliberately."""


class InputError(HomologError, ValueError):
    """The user can fix the cause: the message names the subject or file, the fault and the remedy.

    It is also a `ValueError`, which libraries commonly catch.
    """


class InUseError(InputError):
    """Another program has the project open."""


class NumericalError(HomologError, ArithmeticError):
    """A computation failed: the message names the subject and the step. Also an `ArithmeticError`."""


class WorkerDiedError(NumericalError):
    """A worker process died; its subjects can be started again."""


class Cancelled(HomologError):
    """The user cancelled: raised by a callback to stop the work, never shown as an error."""


def user_message(error: BaseException) -> str | None:
    """Return the message for the user, or None if the error is a defect of the program.

    The user can fix system errors that name a file, such as missing permissions, and missing packages.
    """
    if isinstance(error, InputError | NumericalError):
        return str(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}; check its permissions, or choose another location"
    if isinstance(error, ModuleNotFoundError) and error.name:
        package = error.name.partition(".")[0]
        if not package.startswith("homolog"):
            return f"the Python package {package} is not installed; install it with: pip install {package}"
    return None
