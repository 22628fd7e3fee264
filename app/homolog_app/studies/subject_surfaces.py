"""The subjects' surfaces of a result: all in memory, or of a large study those that are looked at."""

import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping, Sequence

from homolog.files.project import ProjectFolder
from homolog.files.records import ResultSubject
from homolog.files.results import read_surface
from homolog.progress import Tick, no_tick
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["SubjectSurfaces"]

_Surfaces = tuple[TriangleMesh, TriangleMesh]
_MOST_KEPT = 200
"""Subjects whose surfaces are kept in memory."""


class SubjectSurfaces(Mapping[str, _Surfaces]):
    """Groomed surfaces by subject, each with a light one of the same shape, in local coordinates.

    One that is not in memory is read from the project: InputError is raised if it is missing or damaged.

    Parameters
    ----------
    project : ProjectFolder
    subjects : sequence of ResultSubject
        Of its result.
    """

    def __init__(self, project: ProjectFolder, subjects: Sequence[ResultSubject]) -> None:
        self._project = project
        self._subjects = {subject.name: subject for subject in subjects}
        self._kept: OrderedDict[str, _Surfaces] = OrderedDict()
        self._lock = threading.Lock()

    def read_first(self, tick: Tick = no_tick) -> None:
        """Read all surfaces, if they are kept; they remain available then if the folder is lost."""
        if len(self) <= _MOST_KEPT:
            for number, name in enumerate(self):
                tick(number / len(self), f"surface of {name}")
                self[name]

    def __getitem__(self, name: str) -> _Surfaces:
        """Return the surface of a subject and a light one."""
        with self._lock:
            if name in self._kept:
                self._kept.move_to_end(name)
                return self._kept[name]
        surfaces = self._read(name)
        with self._lock:
            self._kept[name] = surfaces
            if len(self._kept) > _MOST_KEPT:
                self._kept.popitem(last=False)
        return surfaces

    def __iter__(self) -> Iterator[str]:
        """Iterate over the subjects' names."""
        return iter(self._subjects)

    def __len__(self) -> int:
        """Return the number of subjects."""
        return len(self._subjects)

    def __contains__(self, name: object) -> bool:
        """Return whether there is such a subject; reads nothing."""
        return name in self._subjects

    def _read(self, name: str) -> _Surfaces:
        from homolog.grooming.subject import COARSE_VERTICES
        from homolog.surfaces.simplify import simplified

        mesh = read_surface(self._project, self._subjects[name])
        return mesh, simplified(mesh, COARSE_VERTICES)
