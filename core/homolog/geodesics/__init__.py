"""Geodesic distances on triangle meshes: all pairs up to a reach, and between any points."""

from homolog.geodesics.solve import Element, local_distances, solve_table, solve_tables
from homolog.geodesics.table import GeodesicTable

__all__ = ["Element", "GeodesicTable", "local_distances", "solve_table", "solve_tables"]
