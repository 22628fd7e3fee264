"""Conversion of errors of pydicom and highdicom into messages with remedies."""

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from pathlib import Path

from homolog.errors import InputError

__all__ = ["dicom_faults"]


@contextmanager
def dicom_faults(path: Path, kind: str) -> Iterator[None]:
    """Convert any exception into an InputError, and suppress other output.

    Both packages print file names and header values, which may identify a patient, to the standard error.

    Parameters
    ----------
    path : Path
    kind : str
        Expected kind of file, such as ``"DICOM SEG"``.
    """
    with redirect_stderr(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except (InputError, ModuleNotFoundError):
            raise
        except Exception as error:  # they raise many kinds of errors on bad files
            raise InputError(
                f"{path}: can't be read as {kind}; export it again ({_reason(error)})"
            ) from error


def _reason(error: Exception) -> str:
    if isinstance(error, AttributeError) and error.name:
        return f"it lacks {error.name}"
    return str(error).splitlines()[0] if str(error) else "it is damaged"
