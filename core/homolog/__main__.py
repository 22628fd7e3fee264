"""The program as a module: ``python -m homolog``, the same as ``homolog``."""

import sys
from importlib import import_module
from importlib.util import find_spec

if __name__ == "__main__":
    if find_spec("homolog_app") is None:  # the library is installed alone
        sys.exit("homolog: only the library is installed; the program comes with: pip install homolog")
    import_module("homolog_app.__main__").start()
