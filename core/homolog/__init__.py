"""Homolog: geometric correspondence for ensembles of nonregular shapes, headless core."""

__version__ = "0.2.0"
