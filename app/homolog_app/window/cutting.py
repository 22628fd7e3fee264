"""Cutting in the views of *Groom*: a plane with a handle, and a brush; the table holds what they cut away."""

from collections.abc import Sequence

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, QTimer, Slot
from PySide6.QtGui import QMouseEvent

from homolog.arrays import FloatArray
from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.geometry import inverse_matrices, transform_points
from homolog.io.constraints import parse_cuts, text_of
from homolog.surfaces.clipping import Ball, Cut, Plane
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.scenes.subjects import readable_cuts, whole_surface
from homolog_app.window.cut_box import BACK, BRUSH, PLANE, CutBox
from homolog_app.window.scene import PlaneHandle, Scene
from homolog_app.window.session import Session

__all__ = ["CutTool"]

_FOLLOW_MS = 60
_AXES = ("long", "middle", "short")


class CutTool(QObject):
    """Applies the tools of a `CutBox` in the views, as edits of the study.

    Parameters
    ----------
    session : Session
    box : CutBox
    scene : Scene
    """

    def __init__(self, session: Session, box: CutBox, scene: Scene) -> None:
        super().__init__(scene)
        self._session, self._box, self._scene = session, box, scene
        self.handle = PlaneHandle(scene.plot, self._follow_handle, drawn=True)
        self._pending: tuple[str, str, str] | None = None
        self._timer = QTimer(self, singleShot=True, interval=_FOLLOW_MS)
        self._timer.timeout.connect(self._apply)
        self._stroke, self._is_painting, self._is_applying = 0, False, False
        self.handle.ended(self._end)
        scene.watch_by(self)
        scene.closing.connect(self.handle.close)
        box.tool_changed.connect(self._take_up)
        box.plane_wanted.connect(self._place_again)
        box.keep.entered.connect(self._keep_length)
        session.study_changed.connect(self._offer)
        self._offer()
        for signal in (session.study_changed, session.groomed_changed, session.selection_changed):
            signal.connect(self._arm)
        session.step_changed.connect(self._leave)
        scene.page_changed.connect(self._arm)

    @property
    def _subject(self) -> Subject | None:
        chosen = self._session.selection[:1]
        return next((item for item in self._session.study.included if item.name in chosen), None)

    @property
    def _structure(self) -> str:
        """The structure whose plane is placed, as the files have it; empty for a single one."""
        return self._box.structure.currentData() or ""

    @Slot()
    def _offer(self) -> None:
        structures = self._session.cut_structures
        if [self._box.structure.itemData(row) for row in range(self._box.structure.count())] != [
            *structures.values()
        ]:
            self._box.offer(structures)

    def _planes(self, subject: Subject) -> list[Plane]:
        return [cut for cut in readable_cuts(subject, self._structure) if isinstance(cut, Plane)]

    def _parts(self, name: str) -> dict[str, TriangleMesh]:
        """Return the whole surface of each structure, as the files have it."""
        whole = whole_surface(name, self._session.surveys, self._session.groomed)
        keys = list(self._session.cut_structures.values())
        if whole is None or len(whole.parts) != len(keys):
            return {}
        return dict(zip(keys, whole.parts, strict=True))

    def _whole(self, name: str) -> TriangleMesh | None:
        return self._parts(name).get(self._structure)

    @Slot()
    def _leave(self) -> None:
        if self._session.step != "groom" and self._box.tool:
            self._box.drop()
            self._arm()

    @Slot()
    def _arm(self) -> None:
        """Show the handle at the plane of the selected subject, if it has one."""
        if self._is_applying:
            return
        subject = self._subject
        cell = self._scene.grid.cell_of(subject.name) if subject is not None else None
        if self._box.tool != PLANE or subject is None or cell is None or cell.content is None:
            self.handle.hide()
            self._scene.plot.update()
            return
        plane = next(iter(self._planes(subject)), None)
        if plane is None or cell.bounds is None:
            self.handle.hide()
        else:
            there = plane.placed(cell.content.alignment)
            self.handle.show(cell.renderer, cell.bounds, there.direction, there.point)
        self._scene.plot.update()

    @Slot()
    def _take_up(self) -> None:
        """Begin with a tool; the selected subject gets a plane if it has none."""
        subject = self._subject
        planes = self._planes(subject) if subject else []
        if self._box.tool and subject is not None:
            self._scene.show_name(subject.name)
        if self._box.tool == PLANE and subject is not None and not planes:
            self._place(subject)
        self._arm()

    @Slot()
    def _place_again(self) -> None:
        if (subject := self._subject) is not None:
            self._place(subject)

    def _place(self, subject: Subject) -> None:
        """Put the plane of a subject where the box says: through its middle, or its first landmarks."""
        from homolog.run.planes import marked, plane_across, plane_through

        whole, axis = self._whole(subject.name), self._box.place.currentData()
        if whole is None:
            return
        try:
            if axis == "landmarks":
                plane = plane_through(marked(subject), whole)
            else:
                plane = plane_across(whole, _AXES.index(axis))
        except InputError as error:
            self._session.noticed.emit(str(error))
            return
        self._edit(subject, self._with_plane(subject, plane))

    @Slot(float)
    def _keep_length(self, length: float) -> None:
        """Put the plane where a length of the long axis is kept."""
        from homolog.run.planes import plane_along

        subject = self._subject
        whole = self._whole(subject.name) if subject is not None else None
        if subject is None or whole is None:
            return
        old = next(iter(self._planes(subject)), None)
        try:
            plane = plane_along(whole, length, None if old is None else old.direction)
        except InputError as error:
            self._session.noticed.emit(f"{subject.name}: {error}")
            return
        self._edit(subject, self._with_plane(subject, plane))

    def _with_plane(self, subject: Subject, plane: Plane) -> list[Cut]:
        """Return the cuts of a subject with another first plane."""
        cuts: list[Cut] = list(readable_cuts(subject, self._structure))
        place = next((at for at, cut in enumerate(cuts) if isinstance(cut, Plane)), None)
        return [plane, *cuts] if place is None else [*cuts[:place], plane, *cuts[place + 1 :]]

    def _edit(self, subject: Subject, cuts: Sequence[Cut]) -> None:
        self._stroke += 1
        self._session.set_cuts(subject.name, text_of(cuts), self._structure)
        self._arm()

    def _follow_handle(self, normal: FloatArray, origin: FloatArray) -> None:
        subject = self._subject
        cell = self._scene.grid.cell_of(subject.name) if subject is not None else None
        if subject is None or cell is None or cell.content is None:
            return
        back = inverse_matrices(cell.content.alignment[None])[0]
        plane = Plane.of(origin, normal).placed(back)
        self._queue(subject.name, text_of(self._with_plane(subject, plane)), self._structure)

    def _queue(self, name: str, text: str, structure: str) -> None:
        if self._pending is not None and (self._pending[0], self._pending[2]) != (name, structure):
            self._apply()
        self._pending = name, text, structure
        if not self._timer.isActive():
            self._timer.start()

    @Slot()
    def _apply(self) -> None:
        """Apply what has been dragged or painted since the last time; one drag is one step of undo."""
        if self._pending is not None:
            (name, text, structure), self._pending = self._pending, None
            self._is_applying = True  # the handle is where it was dragged
            self._session.set_cuts(name, text, structure, f"cut {name} {self._stroke}")
            self._is_applying = False

    def _end(self) -> None:
        self._apply()
        self._stroke += 1

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Paint while the left button is down, instead of turning the view."""
        if self._box.tool not in (BRUSH, BACK) or not isinstance(event, QMouseEvent):
            return False
        kind = event.type()
        if kind == QEvent.Type.MouseButtonPress and event.button() == Qt.MouseButton.LeftButton:
            self._is_painting = self._dab(event.position())
            return self._is_painting
        if kind == QEvent.Type.MouseMove and self._is_painting:
            self._dab(event.position())
            return True
        if kind == QEvent.Type.MouseButtonRelease and self._is_painting:
            self._is_painting = False
            self._end()
            return True
        return False

    def _dab(self, at: QPointF) -> bool:
        """Paint at a position of the views; return whether there is a subject."""
        pick = self._scene.picker.surface_at(at)
        subject = next(
            (item for item in self._session.study.included if pick and item.name == pick.name), None
        )
        cell = self._scene.grid.cell_of(subject.name) if subject is not None else None
        parts = self._parts(subject.name) if subject is not None else {}
        if pick is None or subject is None or not parts or cell is None or cell.content is None:
            return False
        self._session.select([subject.name])
        centre = transform_points(inverse_matrices(cell.content.alignment[None])[0], pick.place[None])[0]
        structure = min(
            parts, key=lambda own: float(np.linalg.norm(parts[own].vertices - centre, axis=1).min())
        )
        radius = 0.01 * self._box.radius.value() * float(np.ptp(parts[structure].vertices, axis=0).max())
        waiting = self._pending
        is_same = waiting is not None and (waiting[0], waiting[2]) == (subject.name, structure)
        text = waiting[1] if waiting is not None and is_same else None
        cuts = list(readable_cuts(subject, structure) if text is None else parse_cuts(text, subject.name))
        ball = Ball(centre, radius, keeps=self._box.tool == BACK)
        before = [cut for cut in cuts[-1:] if isinstance(cut, Ball) and cut.keeps == ball.keeps]
        step = [float(np.linalg.norm(cut.centre - centre)) for cut in before if self._is_painting]
        if not step or step[0] >= 0.5 * radius:
            self._queue(subject.name, text_of([*cuts, ball]), structure)
        return True
