"""Statistical shape analysis: corresponding points on ensembles of anatomical shapes.

::

    import homolog as hl

    result = hl.correspond("SEGMENTATIONS", n_particles=512)    # or meshes and label maps in memory
    model = hl.ShapeModel().fit(result.aligned)                 # mean_, components_, scores_
    larger = result.surface(model.instance([2.0]))              # +2 SD of the first mode, as a mesh
    form, shape = hl.compare_groups(result.aligned, groups)     # permutation tests, effects, maps

Names are loaded on first use, so that importing the package is fast. docs/api.md is their
reference. Lengths are millimetres.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from homolog.api.analyze import analyze
    from homolog.api.compare import compare, compare_groups, regress
    from homolog.api.correspond import Correspondence, correspond
    from homolog.api.geodesics import geodesic_distances
    from homolog.api.patient import compare_patient, make_reference
    from homolog.api.plan import plan
    from homolog.api.project import Project
    from homolog.api.report import report
    from homolog.cohort import Cohort, read_cohort
    from homolog.comparison.formula import FormulaAnswer
    from homolog.comparison.plan import Plan
    from homolog.comparison.project import StudyAnswer
    from homolog.errors import Cancelled, InputError, NumericalError
    from homolog.io.meshes import read_mesh, write_mesh
    from homolog.patient.compare import PatientComparison
    from homolog.patient.reference import Reference
    from homolog.statistics.comparison import Comparison
    from homolog.statistics.shape_model import ShapeModel
    from homolog.surfaces.mesh import TriangleMesh

__all__ = [
    "Cancelled",
    "Cohort",
    "Comparison",
    "Correspondence",
    "FormulaAnswer",
    "InputError",
    "NumericalError",
    "PatientComparison",
    "Plan",
    "Project",
    "Reference",
    "ShapeModel",
    "StudyAnswer",
    "TriangleMesh",
    "analyze",
    "compare",
    "compare_groups",
    "compare_patient",
    "correspond",
    "geodesic_distances",
    "make_reference",
    "plan",
    "read_cohort",
    "read_mesh",
    "regress",
    "report",
    "write_mesh",
]

__version__ = "0.3.0"

_HOMES = {
    "Cancelled": "errors",
    "Cohort": "cohort",
    "Comparison": "statistics.comparison",
    "Correspondence": "api.correspond",
    "FormulaAnswer": "comparison.formula",
    "InputError": "errors",
    "NumericalError": "errors",
    "PatientComparison": "patient.compare",
    "Plan": "comparison.plan",
    "Project": "api.project",
    "Reference": "patient.reference",
    "ShapeModel": "statistics.shape_model",
    "StudyAnswer": "comparison.project",
    "TriangleMesh": "surfaces.mesh",
    "analyze": "api.analyze",
    "compare": "api.compare",
    "compare_groups": "api.compare",
    "compare_patient": "api.patient",
    "correspond": "api.correspond",
    "geodesic_distances": "api.geodesics",
    "make_reference": "api.patient",
    "plan": "api.plan",
    "read_cohort": "cohort",
    "read_mesh": "io.meshes",
    "regress": "api.compare",
    "report": "api.report",
    "write_mesh": "io.meshes",
}


def __dir__() -> list[str]:
    """Return the public names, for completion."""
    return [*__all__, "__version__"]


if not TYPE_CHECKING:  # type checkers know the names from above, and that there are no others

    def __getattr__(name: str) -> object:
        """Load a public name on its first use."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
        globals()[name] = value
        return value
