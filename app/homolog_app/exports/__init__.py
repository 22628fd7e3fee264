"""A project's result as plots, meshes and tables for papers and other programs; no Qt.

`settings` is quick to import; the other modules import statistics, VTK and matplotlib.
"""
