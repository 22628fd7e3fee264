"""Guards against known faults of what we build on."""

import os
import subprocess
import sys

import pytest

_PROBE = """
import sys
from PySide6.QtWidgets import QApplication, QLabel
application = QApplication([])
label = QLabel()
label.setText("warm")
before = sys.getrefcount(None)
for number in range(1000):
    label.setText(str(number))
print(before - sys.getrefcount(None))
"""


@pytest.mark.window
def test_calls_into_qt_do_not_use_up_the_references_to_none():
    """PySide6 6.12.0 on Python 3.11 loses one with every call, and the process dies after some 38000."""
    done = subprocess.run(
        [sys.executable, "-c", _PROBE],
        env=os.environ | {"QT_QPA_PLATFORM": "offscreen"},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    assert int(done.stdout) < 100
