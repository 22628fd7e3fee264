"""Between session and scene: visible subjects, contents of the open page, pictures."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QPoint, Qt, Signal, Slot
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QApplication, QMainWindow

from homolog.arrays import FloatArray
from homolog_app.rendering.camera import Layer
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.rendering.grid import VIEWS
from homolog_app.scenes.loaded_result import LoadedResult
from homolog_app.scenes.states import ColouredView, Snapshot, SubjectsView
from homolog_app.scenes.structures import POSES, SHAPES
from homolog_app.scenes.subjects import Groomed, subject_contents
from homolog_app.window.actions import Actions
from homolog_app.window.cohort_panel import CohortPanel
from homolog_app.window.commands import LAYOUTS
from homolog_app.window.explore.panel import ExplorePanel
from homolog_app.window.run_particles import EnergyCurves, RunParticles
from homolog_app.window.scans import ScanController
from homolog_app.window.scene import Pick
from homolog_app.window.stage import RangeDialog, view_menu
from homolog_app.window.study_files import KEPT, ViewRecord
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from homolog_app.window.explore.page import ExplorePage
    from homolog_app.window.stage import Stage

__all__ = ["Views"]


class Views(QObject):
    """Drives the stage: subjects and particles of a run, or the contents of the open page of *Explore*."""

    layout_changed = Signal()
    slices_wanted = Signal(object)
    picture_wanted = Signal(object, object, object)

    def __init__(
        self,
        window: QMainWindow,
        workspace: Workspace,
        commands: Actions,
        stage: "Stage",
        explore: ExplorePanel,
        table: CohortPanel,
        curves: EnergyCurves,
    ) -> None:
        super().__init__(window)
        self._window, self._commands, self.stage = window, commands, stage
        self._bar = stage.scene.bar
        self._session, self._work = workspace.session, workspace.work
        self._shown: list[object] = []
        self.subjects = SubjectContents()
        self.run = RunParticles(workspace, commands["run.play"], stage, curves)
        self._explore = explore
        self._result: LoadedResult | None = None
        for name in ("link", "grid4"):
            commands[f"view.{name}"].setChecked(True)
        stage.bar.opacity_changed.connect(lambda value: stage.scene.change(opacity=value))
        stage.layers.changed.connect(self._change_layer)
        stage.scene.display_changed.connect(self._show_display)
        self._show_display()
        stage.clip.changed.connect(self._cut)
        self._bar.clicked.connect(lambda: commands["view.range"].trigger())
        self.run.moved.connect(self._show_run)
        self.run.began.connect(self._uncover_run)
        stage.scene.page_changed.connect(self._update_page)
        stage.scene.page_changed.connect(self._show_layers)
        session = self._session
        for signal in (
            session.study_changed,
            session.surveys_changed,
            session.groomed_changed,
            session.result_changed,
        ):
            signal.connect(self.refresh)
        session.step_changed.connect(self._offer_modes)
        for signal in (session.page_changed, session.step_changed):
            signal.connect(stage.scene.leave_close_up)
            signal.connect(self._display)
        for page in self._explore.pages:
            page.shown_changed.connect(partial(self._display_page, page))
            page.place_wanted.connect(stage.scene.go_to)
            page.place_wanted.connect(self._point_slices)
            page.turn_wanted.connect(partial(self._face, page))
        session.job_changed.connect(self._offer_modes)
        self.scans = ScanController(window, workspace, explore, table, stage, commands["view.slice"])
        stage.slices.beside.toggled.connect(self._switch_slices)
        stage.scene.picker.picked.connect(self._hand_over_pick)
        stage.scene.picker.menu_wanted.connect(self._open_menu, Qt.ConnectionType.QueuedConnection)
        self._session.selection_changed.connect(self._follow_selection)
        self._own_particles, self._balls, self._generation = False, False, 0
        self._last_layout: tuple[int, tuple[int, ...], bool, int] = (0, (), False, 0)
        self.refresh()

    def handlers(self) -> dict[str, Callable[[], object]]:
        """Return the handlers of the views' commands."""
        commands, scene = self._commands, self.stage.scene
        return {
            **{f"view.grid{count}": partial(self.choose_layout, count) for count in LAYOUTS},
            **{f"view.{view}": partial(scene.look, view) for view in VIEWS},
            **{f"view.{name}": partial(self._switch, name) for name in ("raw", "groomed", "particles")},
            "view.previous": lambda: self.turn_page(-1),
            "view.next": lambda: self.turn_page(1),
            "view.link": lambda: scene.set_linked(commands["view.link"].isChecked()),
            "view.reset": scene.fit,
            "view.slice": self._switch_slices,
            "view.clip": self._begin_cut,
            "view.letters": lambda: scene.change(letters=commands["view.letters"].isChecked()),
            "view.scale_bar": lambda: scene.change(scale_bar=commands["view.scale_bar"].isChecked()),
            "view.range": self.choose_range,
            "view.from_middle": self._turn_colours,
            "view.screenshot": self.save_picture,
            "view.copy": self.copy_picture,
            "run.play": self.play_or_stop,
        }

    @property
    def shows_model(self) -> bool:
        """Whether the views show shapes of the model."""
        return self._page is not None and self._page.layouts is not None

    @property
    def is_coloured(self) -> bool:
        """Whether the ends of the colour scale can be set."""
        page = self._page
        return page is not None and isinstance(page.chosen, ColouredView) and self._bar.scale is not None

    def _turn_colours(self) -> None:
        """Count displacements as positive away from the centre of the shape, or out of the tissue."""
        self._explore.fitted.from_middle = self._commands["view.from_middle"].isChecked()
        self._display()

    def choose_range(self) -> None:
        """Ask for the ends of the colour scale, with immediate effect."""
        page, scale = self._page, self._bar.scale
        if page is not None and scale is not None:
            dialog = RangeDialog(self._window, scale, page.set_colour_range, lambda: self._bar.scale)
            self._session.page_changed.connect(dialog.reject)
            dialog.show()

    @property
    def layouts(self) -> tuple[int, ...]:
        """Numbers of views that can be chosen now."""
        page = self._page
        if self.hides_views:
            return ()
        return LAYOUTS if page is None else page.layouts or LAYOUTS

    @property
    def snapshot(self) -> Snapshot | None:
        """The state of the views, from which a picture can be drawn again; None if the project lacks data."""
        if self._session.job.run is not None or self._session.missing:
            return None
        page = self._page
        if page is not None and (self._session.result is None or not page.can_be_drawn_again):
            return None  # a preliminary model and a patient are in no file of the project
        view = (page.chosen if page is not None else None) or SubjectsView(moment=self.run.moment)
        return Snapshot(
            view=view,
            canvas=self.stage.scene.canvas,
            title=self._session.title,
            beside=self._explore.fitted.beside if self.shows_model else None,
            aspect=self._session.aspect if self._session.aspect in (SHAPES, POSES) else "",
        )

    def copy_picture(self) -> None:
        """Copy a picture of the views to the clipboard."""
        slices = self.stage.slices
        picture = slices.picture() if self.shows_slices else self.stage.scene.picture()
        QApplication.clipboard().setImage(picture)

    def save_picture(self) -> None:
        """Ask for options, and save a picture of the current views or slices."""
        if self.shows_slices:
            self.slices_wanted.emit(self.stage.slices.picture())
            return
        scene = self.stage.scene
        self.picture_wanted.emit(scene.shown_now, scene.canvas, self.snapshot)

    @property
    def shows_slices(self) -> bool:
        """Whether slices of a file are shown."""
        return self._commands["view.slice"].isChecked()

    @property
    def hides_views(self) -> bool:
        """Whether slices replace the views, rather than being next to them."""
        return self.shows_slices and not self.stage.slices.beside.isChecked()

    @property
    def pages(self) -> tuple[int, int]:
        """The open page, from 0, and the number of pages; with slices, one per subject."""
        grid = self.stage.scene.grid
        if self.shows_slices:
            return self.scans.index, len(self._session.study.included)
        return grid.page, grid.pages

    def turn_page(self, step: int) -> None:
        """Show other subjects."""
        if self.shows_slices:
            self._session.select([self._session.study.included[self.scans.index + step].name])
            self._update_page()
        else:
            self.stage.scene.turn_page(step)

    def show_only(self, name: str) -> None:
        """Show one subject alone."""
        self._commands["view.grid1"].trigger()
        self.stage.scene.show_name(name)

    @Slot(str, QPoint)
    def _open_menu(self, name: str, at: QPoint) -> None:
        """Open the menu of a view, after VTK has received the end of the click."""
        menu = view_menu(self._window, self._commands)
        if name in {member.name for member in self._session.study.included}:
            first = menu.actions()[0]
            select = QAction(f"Select {name.replace('&', '&&')}", menu)
            select.triggered.connect(lambda: self._session.select([name]))
            only = QAction("Show only this subject", menu, enabled=not self.shows_model)
            only.triggered.connect(lambda: self.show_only(name))
            menu.insertActions(first, [select, only])
            menu.insertSeparator(first)
        menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        menu.popup(at)

    def noted(self, view: ViewRecord) -> ViewRecord:
        """Return a record with the current state of the views."""
        return view.of_canvas(self.stage.scene.canvas)

    def restore_view(self, view: ViewRecord) -> None:
        """Restore camera direction, opacity, letters and scale bar of a record."""
        same = {name: getattr(view, name) for name in KEPT}
        self.stage.scene.change(**same)
        if view.camera is not None:
            self.stage.scene.set_camera(view.camera)

    def choose_layout(self, count: int) -> None:
        """Set the number of subjects per page, or of shapes of the model."""
        page = self._page
        if page is not None and page.layouts is not None:
            page.choose_layout(count)
        else:
            self.stage.scene.set_layout(count)
            self.layout_changed.emit()

    @Slot()
    def refresh(self) -> None:
        """Update the views from the session."""
        session, stage = self._session, self.stage
        if session.generation != self._generation:
            self._generation = session.generation
            stage.scene.begin_anew()
        key: list[object] = [*session.study.included, session.part]
        for subject in session.study.included:
            groomed, survey = session.groomed.get(subject.name), session.surveys.get(subject.name)
            key += [groomed, survey.surface if survey else None]
        if len(key) != len(self._shown) or any(a is not b for a, b in zip(key, self._shown, strict=True)):
            new_result, former = session.part is not self._result, self._result
            self._result = session.part
            had_smooth = any(isinstance(content, Groomed | LoadedResult) for content in self._shown)
            smooth = bool(session.groomed or session.part)
            if smooth is not had_smooth:  # show one surface, and not the input behind it
                stage.scene.change(raw=not smooth)
            self._shown = key
            self.subjects = subject_contents(
                session.study.included,
                session.surveys,
                session.groomed,
                session.part,
                session.study.settings,
            )
            if new_result:
                self.run.set_result()
            self._display()
            same_run = former and session.part and former.record is session.part.record
            if new_result and session.part is not None and not same_run:
                stage.scene.fit()  # a close-up stays when particles are optimized again, or that is undone
        if not session.study.members:
            stage.show_hint(
                "No subjects yet", "Drop segmentations or surfaces here, or add files with Ctrl+Shift+N."
            )
        elif not session.study.included:
            stage.show_hint("No subject is included", "Tick the subjects to study in the table at the right.")
        elif self.shows_slices:
            self._show_slices()
            stage.show_slices()
        else:
            stage.show_views()

    @property
    def _page(self) -> "ExplorePage | None":
        """The page of *Explore* that defines the contents."""
        has_shapes = self._session.result is not None or self._explore.fitted.preliminary is not None
        return self._explore.page if self._session.step == "explore" and has_shapes else None

    def _offer_modes(self) -> None:
        """Offer the modes of a run that has not finished."""
        session = self._session
        early = session.job.run is not None and session.preliminary is not None
        self.stage.footer.ready.setVisible(early and session.step != "explore")

    def _face(self, page: "ExplorePage", name: str, place: FloatArray, normal: FloatArray) -> None:
        if page is self._page:  # the answer may come when another one is open
            self.stage.scene.face(name, place, normal)

    def _display_page(self, page: "ExplorePage") -> None:
        if page is self._page:
            self._display()

    @Slot()
    def _display(self) -> None:
        """Show the subjects, or the contents of the open page of *Explore*."""
        page = self._page
        shown = page.shown(self.subjects) if page is not None else ViewContents(self.subjects)
        if shown.particles is None:
            tints = self.run.tints if shown.tints is None else shown.tints
            shown = replace(shown, particles=self.run.particles, tints=tints)
        own = shown.particles is not self.run.particles
        if own is not self._own_particles:
            self._own_particles = own
            self._swap_balls()
        self.stage.footer.show_parts(run=not own, pages=not shown.columns)
        self.stage.scene.display(shown)
        self._show_layers()
        self._explore.fitted.draw_ms = self.stage.scene.plot.draw_ms
        if self.shows_slices:
            self._show_slices()
        self._update_layout()

    def _update_layout(self) -> None:
        """Check the button of the current number of views; disable those that the page lacks."""
        page = self._page
        offered = page.layouts if page is not None else None
        count = offered[0] if offered else self.stage.scene.grid.display.layout
        state = (count, self.layouts, self.is_coloured, len(self._session.study.included))
        if state != self._last_layout:
            self._last_layout = state
            self._commands[f"view.grid{count}"].setChecked(True)
            self._update_page()

    def _swap_balls(self) -> None:
        """Store separately whether particles are shown on subjects and on shapes of the model."""
        self._balls, seen = self.stage.scene.grid.display.particles, self._balls
        self.stage.scene.change(particles=seen)

    @Slot(object)
    def _hand_over_pick(self, pick: Pick) -> None:
        """Pass a click to the open page of *Explore*."""
        if self._page is not None:
            self._page.handle_pick(pick)
        self._point_slices(pick.name, pick.place)

    @Slot(str, object, object)
    def _point_slices(self, name: str, place: FloatArray, _: object = None) -> None:
        """Move the crosshair of the slices to a point that was clicked or is shown in a close-up."""
        shown = next((content for content in self.stage.scene.shown if content.name == name), None)
        if shown is not None:
            patient = self._page.sliced() if self._page is not None else None
            self.scans.point(patient.name if patient else name, shown, place)

    def play_or_stop(self) -> None:
        """Play the run from its first frame, or the animation of the open page of *Explore*, or pause."""
        if self._page is None or not self._page.play_or_stop():
            self.run.play_or_stop()

    def rest(self, minimized: bool) -> None:
        """Stop playing while the views are hidden."""
        if minimized:
            self.run.stop()
            self._explore.page.stop()

    def close(self) -> None:
        """Stop the timers and release the graphics."""
        self.run.close()
        self._explore.page.stop()
        self.stage.slices.close_slices()
        self.stage.scene.close_scene()

    @Slot(bool)
    def _show_run(self, live: bool) -> None:
        if not self._own_particles:
            self.stage.scene.show_particles(self.run.particles, self.run.tints, live=live)

    @Slot()
    def _uncover_run(self) -> None:
        """Show the particles of a run that begins, whatever was shown before."""
        slices = self._commands["view.slice"]
        if slices.isChecked():
            slices.setChecked(False)
            self._switch_slices()
        self.stage.scene.change(particles=True, clip=None)

    @Slot()
    def _follow_selection(self) -> None:
        if self._session.selection:
            self.stage.scene.show_name(self._session.selection[0])
        if self.shows_slices:
            self._show_slices()
            self._update_page()

    def _switch(self, name: str) -> None:
        """Show or hide surfaces or particles; leave slices if necessary."""
        command, slices = self._commands[f"view.{name}"], self._commands["view.slice"]
        if self.hides_views:
            command.setChecked(True)
            slices.setChecked(False)
            self._switch_slices()
        self.stage.scene.change(**{name: command.isChecked()})

    @Slot()
    def _show_display(self) -> None:
        """Let buttons and sliders follow what is displayed."""
        display = self.stage.scene.grid.display
        for name in ("raw", "groomed", "particles", "letters", "scale_bar"):
            self._commands[f"view.{name}"].setChecked(getattr(display, name))
        self.stage.bar.opacity.setValue(round(100.0 * display.opacity))
        self._commands["view.clip"].setChecked(display.clip is not None)
        self.stage.clip.setVisible(display.clip is not None and not self.hides_views)
        self._show_layers()

    def _show_layers(self) -> None:
        """Let the bar of the structures follow what is shown."""
        grid = self.stage.scene.grid
        names = () if self.hides_views else grid.structures
        self.stage.layers.show_layers(names, grid.display, coloured=grid.is_coloured)

    @Slot(object)
    def _change_layer(self, layer: Layer) -> None:
        scene = self.stage.scene
        scene.change(layers=scene.grid.display.with_layer(layer))

    def _begin_cut(self) -> None:
        """Cut the shapes open on the side of the viewer, or leave them whole."""
        if self._commands["view.clip"].isChecked():
            self.stage.clip.face()
        else:
            self._cut()

    @Slot()
    def _cut(self) -> None:
        """Cut the shapes open by the plane of the strip, or leave them whole."""
        cut = self._commands["view.clip"].isChecked()
        self.stage.scene.change(clip=self.stage.clip.clip if cut else None)
        self.stage.clip.setVisible(cut and not self.hides_views)

    def _switch_slices(self) -> None:
        self._cut()
        for control in (self.stage.bar.opacity, self.stage.bar.percent):
            control.setEnabled(not self.hides_views)
        self.refresh()
        self._update_page()

    def _show_slices(self) -> None:
        self.scans.show(self._page.sliced() if self._page is not None else None)

    @Slot()
    def _update_page(self) -> None:
        grid, total = self.stage.scene.grid, len(self._session.study.included)
        if self.shows_slices:
            self.stage.footer.show_page(self.scans.index + 1, self.scans.index + 1, total)
        else:
            first = grid.page * grid.display.layout
            total = total if grid.pages > 1 or not grid.columns else 0
            self.stage.footer.show_page(first + 1, min(first + grid.display.layout, total), total)
        self.layout_changed.emit()
