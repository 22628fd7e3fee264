"""The program as a module: ``python -m homolog``, the same as ``homolog``."""

from importlib import import_module

if __name__ == "__main__":
    import_module("homolog_app.__main__").start()
