"""Geodesic distances on triangle meshes: between all vertices in range, and between any two points."""

from homolog.geodesics.accuracy import Accuracy, measure_accuracy
from homolog.geodesics.field import distances_from
from homolog.geodesics.plan import TablePlan, plan_tables
from homolog.geodesics.solve import GeodesicSolver, check_room, each_table, solve_tables
from homolog.geodesics.table import GeodesicTable

__all__ = [
    "Accuracy",
    "GeodesicSolver",
    "GeodesicTable",
    "TablePlan",
    "check_room",
    "distances_from",
    "each_table",
    "measure_accuracy",
    "plan_tables",
    "solve_tables",
]
