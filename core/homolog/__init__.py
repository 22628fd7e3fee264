"""Homolog: geometric correspondence for ensembles of nonregular shapes, headless core."""

__version__ = "0.1.0"
