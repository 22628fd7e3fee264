"""The page *Patient*: how unusual one shape is, and where."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QModelIndex, QObject, Qt, QTimer, Signal
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import (
    QComboBox,
    QFormLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QTableView,
    QWidget,
)

from homolog.arrays import FloatArray
from homolog.cohort import LEFT, RIGHT, SIDE_COLUMN
from homolog.comparison.choices import covariates_of, size_name
from homolog.errors import InputError
from homolog.progress import Tick
from homolog.statistics.design import names_reference, reference_first
from homolog_app.rendering.content import SubjectContents, ViewContents
from homolog_app.scenes.follow_up import (
    CHANGE,
    PatientTimes,
    change_regions,
    change_scene,
    change_text,
    with_file,
)
from homolog_app.scenes.patient import (
    EXPECTED,
    MEAN,
    WALL,
    ComparedFile,
    ComparedPatient,
    PatientDisplay,
    Z,
    about_texts,
    compared,
    finding_text,
    joint_scene,
    nearest_text,
    patient_scene,
    patient_slices,
)
from homolog_app.window.actions import Actions
from homolog_app.window.explore.controls import ColumnPicker, SubjectTable
from homolog_app.window.explore.page import ExplorePage, ModelCache
from homolog_app.window.explore.plot import Plot
from homolog_app.window.explore.printing import report_buttons
from homolog_app.window.explore.verdict_bar import may_use
from homolog_app.window.session import PAGE_OF_JOB
from homolog_app.window.theme import Theme, scaled
from homolog_app.window.widgets import (
    GRID,
    ActionButton,
    PercentEdit,
    Progress,
    choice,
    column,
    dress_table,
    enable_all,
    fill,
    having,
    held,
    label,
    link,
    named_rows,
    offer,
    prose,
    rule,
    say,
    set_primary,
    show_all,
    slider,
    tick,
)
from homolog_app.window.workspace import Workspace

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from homolog.patient import FollowUp, JointComparison, JointReference, PatientComparison, Reference
    from homolog.patient.findings import GroupRow
    from homolog_app.plots import PercentileRow
    from homolog_app.scenes.slices import SliceScene

__all__ = ["FollowUpPart", "PatientForm", "PatientPage", "region_table", "remark_texts"]


_HIGH = 72


class PercentileBars(Plot):
    """Controls as marks, their middle 90 % as a band, the patient as a diamond."""

    usual = (400, 200)

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "The patient among the controls", "")
        self._rows: Sequence[PercentileRow] = ()

    @property
    def is_empty(self) -> bool:
        """Whether there is no patient."""
        return not self._rows

    def show_rows(self, rows: "Sequence[PercentileRow]") -> None:
        """Show a patient's numbers, if any."""
        self._rows = rows
        self.setFixedHeight(scaled(_HIGH * len(rows)))
        self.setAccessibleDescription("; ".join(f"{name}: {text}" for name, text, *_ in rows))
        self.redraw()

    def draw(self, figure: "Figure") -> None:
        """Draw the lines."""
        from homolog_app.plots import draw_percentiles

        axes = list(figure.subplots(len(self._rows), 1, squeeze=False)[:, 0])
        draw_percentiles(axes, self._rows, self.theme.colours)


_ABOVE = ("Controls", "Adjust for", "Repeated scans of", "Time")  # names of the reference's fields
_HEADS = ("Region", "Area\n(mm²)", "Mean\n(mm)", "Wall\n(%)", "z")
_SIDES = {"not given": "", LEFT: LEFT, RIGHT: RIGHT}


class PatientForm(QFormLayout):
    """Fields of the patient's data that a reference needs.

    Attributes
    ----------
    fields : dict of str to QLineEdit
        Fields of the covariates, by name.
    side : QComboBox or None
        None if the controls' sides are not known.
    cut_off : QCheckBox
    """

    def __init__(self) -> None:
        super().__init__()
        self.setHorizontalSpacing(GRID)
        self.setLabelAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        self.fields: dict[str, QLineEdit] = {}
        self.side: QComboBox | None = None
        ends = "The segmentation ends at a plane: the missing part is not a difference"
        self.cut_off = tick("Cut off at a flat end", ends)

    @property
    def values(self) -> dict[str, str]:
        """Covariates and side as entered."""
        side = {} if self.side is None else {SIDE_COLUMN: self.side.currentData()}
        return {**side, **{name: field.text() for name, field in self.fields.items()}}

    def show_reference(self, known: "Reference | JointReference | None") -> None:
        """Ask for the covariates of a reference; empty without one."""
        reference = known if known is None else known.first
        while self.rowCount():
            self.removeRow(0)
        names = reference.coding.names if reference else ()
        self.fields = {name: having(QLineEdit(), accessibleName=name) for name in names}
        self.side = choice("Side", _SIDES) if reference and reference.provenance.side else None
        for name, field in self.fields.items():
            self.addRow(_named(name.capitalize()), field)
        if self.side is not None:
            self.addRow(_named("Side"), self.side)


def _named(text: str) -> QLabel:
    """Return a label as wide as those of the reference above, so that the fields are aligned."""
    name = label(text)
    name.setMinimumWidth(max(map(name.fontMetrics().horizontalAdvance, _ABOVE)))
    return name


def region_table(owner: QObject) -> tuple[QTableView, SubjectTable]:
    """Return a table of a patient's regions beyond the limit, and its model."""
    table, rows = QTableView(), SubjectTable(_HEADS, owner)
    dress_table(table, "Regions beyond the limit", 120)
    table.setModel(rows)
    table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
    return table, rows


class FollowUpPart(QWidget):
    """Further groups and times of the patient, with the results in sentences.

    Attributes
    ----------
    times : Times or None
        Times of the patient; None without a patient.
    groups : tuple of GroupRow
        How typical the patient is of each group; empty while there is one reference only.
    """

    changed = Signal()

    def __init__(self, workspace: Workspace, actions: Actions) -> None:
        super().__init__()
        self.workspace = workspace
        self.times: PatientTimes | None = None
        self.groups: tuple[GroupRow, ...] = ()
        self._patient: tuple[ComparedPatient, Reference, Callable[[], Mapping[str, str]]] | None = None
        self._others: dict[str, Reference] = {}
        self.typical, self.caution, self.change = prose(), label("", "FieldHelp", wrap=True), prose()
        groups, later, repeat = (
            ActionButton(text, actions[name])
            for text, name in (
                ("Compare with groups…", "patient.groups"),
                ("Add later time…", "patient.later"),
                ("Add repeat…", "patient.repeat"),
            )
        )
        further = (label("Further groups", "SectionTitle"), groups, self.typical, self.caution)
        follow_up = (label("Follow-up", "SectionTitle"), [(later, 1), (repeat, 1)], self.change)
        column(*further, *follow_up, on=self)
        self._show()

    def set_patient(
        self,
        compared: "ComparedPatient | None",
        reference: "Reference | None",
        values: Callable[[], Mapping[str, str]],
    ) -> None:
        """Set another patient, or none; `values` returns the entered covariates."""
        self._patient = (compared, reference, values) if compared and reference else None
        self.times = PatientTimes((compared.comparison,)) if compared else None
        self.groups = ()
        self._show()

    def add_time(self, path: Path, *, repeats: bool) -> None:
        """Compare a file of a later time, or another segmentation of the first one."""
        if self._patient is None or self.times is None:
            raise InputError(f"{path}: there is no patient yet; choose the file of the first time first")
        _, reference, values = self._patient
        work = partial(with_file, self.times, reference, path, dict(values()), repeats)
        self.workspace.work.compute("follow-up", work, "comparing the times", self._receive_times)

    def compare_groups(self, paths: list[Path]) -> None:
        """Read references of further groups and show how typical the patient is of each."""
        from homolog.patient import Reference

        if self._patient is None:
            raise InputError("there is no patient yet; choose a patient's file first")
        self._others |= {str(path): Reference.load(path) for path in paths}
        compared, reference, values = self._patient
        work = partial(_typical, compared, reference, tuple(self._others.values()), dict(values()))
        self.workspace.work.compute("typical", work, "comparing with groups", self._receive_groups)

    def _receive_times(self, times: PatientTimes) -> None:
        self.times = times
        self._show()
        self.changed.emit()

    def _receive_groups(self, groups: "tuple[GroupRow, ...]") -> None:
        self.groups = groups
        self._show()

    def _show(self) -> None:
        from homolog.patient.findings import GROUP_CAUTION, group_sentence

        say(self.typical, "\n".join(group_sentence(row) for row in self.groups))
        say(self.caution, GROUP_CAUTION if self.groups else "")
        say(self.change, change_text(self.times) if self.times else "")


def remark_texts(comparisons: "Mapping[str, PatientComparison]") -> tuple[str, str]:
    """Return the notes of grooming and the cautions of structures, one sentence per line."""
    texts: tuple[list[str], list[str]] = [], []
    for name, own in comparisons.items():
        for text in own.remarks:
            line = f"{name}: {text}" if name and len(comparisons) > 1 else text
            texts[text in own.cautions].append(f"{line[:1].upper()}{line[1:]}")
    return "\n".join(texts[0]), "\n".join(texts[1])


def _rows(
    alone: "tuple[PatientComparison, Reference] | None",
    whole: "tuple[JointComparison, JointReference] | None",
) -> "list[PercentileRow]":
    """Return the numbers of one structure, or how several lie to each other."""
    if alone is None and whole is None:
        return []
    from homolog_app.plots import percentile_rows, pose_percentile_rows

    if alone is not None:
        return percentile_rows(*alone)
    return [] if whole is None else pose_percentile_rows(*whole)


def _typical(
    compared: "ComparedPatient",
    reference: "Reference",
    others: "tuple[Reference, ...]",
    values: Mapping[str, str],
    tick: Tick,
) -> "tuple[GroupRow, ...]":
    from homolog.patient import compare_patient
    from homolog.patient.findings import group_rows

    compare = partial(compare_patient, subject=compared.subject, covariates=values, tick=tick)
    return tuple(group_rows(compared.comparison, reference, others, compare))


_EVERYONE = "All subjects"
_MAPS = {
    "Difference from the expected shape": EXPECTED,
    "… in standard deviations": Z,
    "Thickness of the wall": WALL,
    "Difference from the mean": MEAN,
    "Change since the first time": CHANGE,
}
_VIEWS = {"Map on the patient": 1, "Mean, patient, expected, map": 4}
_PATHS = {"Straight from the mean": False, "Mode by mode from the mean": True}
_STEPS = 400
_RESEARCH = "For research use only; not for diagnosis."


class PatientPage(ExplorePage):
    """A reference, a patient's file, and their comparison."""

    title = "Patient"
    hint = f"One shape against the controls: how unusual, and where. {_RESEARCH}"

    def __init__(self, workspace: Workspace, actions: Actions, fitted: ModelCache) -> None:
        super().__init__(workspace, actions, fitted)
        self.reference: Reference | JointReference | None = None
        self.comparison: PatientComparison | JointComparison | None = None
        self._parts: Mapping[str, ComparedPatient] = {}
        self.places: list[tuple[FloatArray, FloatArray]] = []
        self.group, self._default = choice("Controls"), ""
        self.adjust = ColumnPicker("Columns to adjust for", "", lambda names: ", ".join(names) or "Nothing")
        same = "Controls with the same value are scans of one person"
        self.person = choice("Column of the person", tip=same)
        self.time = choice("Column of the time", tip="Column that tells the times of a person apart")
        self.make = ActionButton("Make reference", actions["patient.reference"], "primary")
        self.open = ActionButton("Open…", actions["patient.open_reference"])
        self.keep = ActionButton("Save…", actions["patient.keep_reference"])
        self.about, self.cautions = label("", "FieldHelp", wrap=True), label("", wrap=True)
        self.form = PatientForm()
        self.file = ActionButton("Choose a patient's file…", actions["patient.open"], "primary")
        self.finding, self.notes, self.remarks = prose(), prose("FieldHelp"), prose("Problem")
        self.map = choice("Map", _MAPS)
        self.views: QComboBox = choice("Views", _VIEWS)
        self.structure = choice("Structure")
        self.structures = held(named_rows((("Structure", self.structure),)))
        self.way = slider("From the mean to the patient", 0, _STEPS, value=_STEPS)
        self.percent = PercentEdit("Percent of the way from the mean to the patient", self.way)
        self.path = choice("From the mean to the patient", _PATHS)
        self.overlaid, self.only_beyond = tick("Transparent over the mean"), tick("Only beyond the limit")
        self.nearest = label("", "FieldHelp", wrap=True)
        named = "Needed to name the nearest controls; these are data of individual subjects"
        self.single = tick("Save with names and scores of controls", named)
        self.bars = PercentileBars(workspace.theme)
        self.regions, self.table = region_table(self)
        self.further = FollowUpPart(workspace, actions)
        self.save = report_buttons(actions)
        self.progress = Progress(actions["run.cancel"])
        self._lay_out()
        self._connect()
        self._show_groups()
        self._show_reference()

    def _lay_out(self) -> None:
        ends = (label("mean", "FieldHelp"), (self.way, 1), label("patient", "FieldHelp"))
        self.answer = held(
            *(self.finding, self.notes, self.remarks),
            self.structures,
            named_rows((("Map", self.map), ("Views", self.views), ("Morph", self.path))),
            [*ends, self.percent, label("%", "Unit")],
            *(self.overlaid, self.only_beyond, rule(), self.bars, self.nearest, self.regions, self.further),
        )
        fill(
            self.body,
            label("Reference", "SectionTitle"),
            named_rows(zip(_ABOVE, (self.group, self.adjust, self.person, self.time), strict=True)),
            [(self.make, 2), (self.open, 1), (self.keep, 1)],
            *(self.single, self.about, self.cautions),
            label("Patient", "SectionTitle"),
            *(self.form, self.form.cut_off, self.file),
            label("Or drop a segmentation or a surface here.", "FieldHelp", wrap=True),
            self.answer,
            ...,
        )
        fill(self.footer, self.progress, self.save)

    def _connect(self) -> None:
        self.workspace.session.study_changed.connect(self._show_groups)
        self.regions.clicked.connect(self._go_to)
        self.structure.activated.connect(self._show_structure)
        link(self._show_map, *(box.activated for box in (self.map, self.views, self.path)))
        self.further.changed.connect(self._show_change)
        link(self.shown_changed, self.way.valueChanged, self.only_beyond.toggled, self.overlaid.toggled)

    def show_state(self) -> None:
        """Show the progress of the page's jobs."""
        job = self.workspace.session.job
        self.progress.show_status(job.status if PAGE_OF_JOB.get(job.kind) == self.title else None)
        self.base.setVisible(not (self.progress.isHidden() and self.save.isHidden()))

    @property
    def layouts(self) -> tuple[int, ...] | None:
        """Numbers of views: 1 or 4 once there is a patient."""
        if (change := self._change) is not None:
            return (1 if len(change.changes) == 1 else 4,)
        return None if self.comparison is None else (self.views.currentData(), *_VIEWS.values())

    @property
    def can_be_drawn_again(self) -> bool:
        """False: a patient's file is not part of the project."""
        return self.comparison is None

    def shown(self, subjects: SubjectContents) -> ViewContents:
        """Return the patient, or the subjects until there is one."""
        if self.comparison is None or self.reference is None:
            return ViewContents(subjects)
        if self._change is not None:
            return change_scene(self._change, self.only_beyond.isChecked())
        look = PatientDisplay(
            self.map.currentData(),
            self.views.currentData(),
            self.way.value() / _STEPS,
            self.path.currentData(),
            self.overlaid.isChecked(),
            self.only_beyond.isChecked(),
        )
        if self._alone is not None:
            return patient_scene(*self._alone, look)
        whole = self._whole
        assert whole is not None, "of several structures"
        return joint_scene(*whole, look)

    @property
    def _alone(self) -> "tuple[PatientComparison, Reference] | None":
        """The comparison and the reference of the structure that is shown; None if several or none are."""
        if self.comparison is None or self.reference is None:
            return None
        from homolog.patient.findings import pairs_of

        return pairs_of(self.comparison, self.reference).get(self.structure.currentData() or "")

    @property
    def _whole(self) -> "tuple[JointComparison, JointReference] | None":
        """The comparison of several structures, if they are."""
        comparison, reference = self.comparison, self.reference
        if comparison is None:
            return None
        from homolog.patient import JointComparison, JointReference

        if isinstance(comparison, JointComparison) and isinstance(reference, JointReference):
            return comparison, reference
        return None

    @property
    def _compared(self) -> ComparedPatient | None:
        """The structure whose voxels are shown in slices: the chosen one, or the first."""
        chosen = self._parts.get(self.structure.currentData() or "")
        return chosen or next(iter(self._parts.values()), None)

    def sliced(self) -> "SliceScene | None":
        """Return the patient's scan or voxels, with the map as a contour."""
        from homolog.patient.findings import pairs_of

        compared = self._compared
        if compared is None or self.comparison is None or self.reference is None:
            return None
        pairs = pairs_of(self.comparison, self.reference).values()
        return patient_slices(compared, next(own for seen, own in pairs if seen is compared.comparison))

    @property
    def _change(self) -> "FollowUp | None":
        """The follow-up whose maps are shown."""
        times = self.further.times
        return times.follow_up if times is not None and self.map.currentData() == CHANGE else None

    def set_scan(self, name: str, path: Path) -> bool:
        """Take the patient's scan."""
        if self.comparison is None or name != self.comparison.name:
            return False
        self._parts = {key: replace(part, image=path) for key, part in self._parts.items()}
        self.shown_changed.emit()
        return True

    def drop_files(self, paths: Sequence[Path]) -> None:
        """Compare a dropped file, or open a reference."""
        (first, *others), noticed = paths, self.workspace.session.noticed
        if others:
            noticed.emit("Drop one file: the patient's segmentation or surface")
        elif first.suffix == ".npz":
            self.open_reference(first)
        elif self.reference is None:
            noticed.emit("Make a reference or open one first, then drop the patient's file")
        else:
            self.compare(first)

    def make_reference(self) -> None:
        """Freeze the model of the chosen group of the open project, fitting each control as a patient."""
        if not may_use(self.window(), self.workspace.session):
            return
        project = self.workspace.shown_project
        group = None if self.group.currentIndex() <= 0 else self.group.currentText()
        columns, person, time = self.adjust.chosen, self.person.currentData(), self.time.currentData()
        loaded, study = self.workspace.session.part, self.workspace.session.study
        result = None if loaded is None else loaded.result.with_table_of(study.whole.subjects)
        parts = {
            name: part.result.with_table_of(study.whole.subjects)
            for name, part in (loaded.parts if loaded is not None else {}).items()
        }

        def make(tick: Tick) -> "Reference | JointReference":
            from homolog.patient import make_reference

            return make_reference(
                project,
                group=group,
                adjust=columns,
                pairs=person or None,
                time=time or "time",
                names=True,
                result=result,
                parts=parts,
                tick=tick,
            )

        self.workspace.work.compute("reference", make, "fitting controls one by one", self.set_reference)

    def open_reference(self, path: Path) -> None:
        """Read a reference; raises InputError if the file is not a reference."""
        from homolog.patient import read_reference

        self.set_reference(read_reference(path))
        self.workspace.session.page_changed.emit()

    def save_reference(self, path: Path) -> None:
        """Write the reference; raises InputError if it can't be written."""
        if self.reference is not None:
            (self.reference if self.single.isChecked() else self.reference.anonymous()).save(path)

    def set_reference(self, reference: "Reference | JointReference") -> None:
        """Set the reference of further comparisons."""
        self.reference = reference
        self._receive(None)
        self._show_reference()

    def compare(self, path: Path) -> None:
        """Compare a patient's file with the reference.

        Raises
        ------
        InputError
            If there is no reference yet.
        """
        reference = self.reference
        if reference is None:
            raise InputError(f"{path}: there is no reference to compare it with; make or open one first")
        self.workspace.work.compute(
            "patient",
            partial(compared, reference, path, self.form.values, self.form.cut_off.isChecked()),
            "comparing the patient",
            self._receive,
        )

    def write(self, folder: Path) -> None:
        """Write the report, tables and surfaces to a new or empty folder."""
        whole, alone = self._whole, self._alone
        if whole is None and alone is None:
            raise InputError("there is no patient yet; choose a patient's file first")
        times, groups = self.further.times, self.further.groups
        follow_up = times.follow_up if times is not None else None

        def write(tick: Tick) -> None:
            from homolog.io.atomic import replace_folder
            from homolog_app.report.patient import write_joint_patient, write_patient, write_times

            with replace_folder(folder) as part:
                if whole is not None:
                    write_joint_patient(part, *whole, tick)
                elif follow_up is not None and alone is not None:
                    write_times(part, follow_up, alone[1], tick, groups)
                elif alone is not None:
                    write_patient(part, *alone, tick, groups)

        message, noticed = f"Report written to {folder}", self.workspace.session.noticed
        self.workspace.work.compute("report", write, "writing the report", lambda _: noticed.emit(message))

    def _receive(self, file: ComparedFile | None) -> None:
        self._parts = file.parts if file else {}
        self.comparison = file.comparison if file else None
        self.finding.setText(finding_text(self.comparison, self.reference))
        several = {name: name for name in self._parts if name}
        offer(self.structure, {"All structures": ""} | several if several else {})
        self.structures.setVisible(bool(several))
        self._show_structure()
        if self.comparison is not None and self.reference is not None:
            QTimer.singleShot(0, self, self._open_on_finding)

    def _open_on_finding(self) -> None:
        """Show the sentence, and turn the patient to the first region beyond the limit."""
        self.reveal(self.finding, at_top=True)
        if self.comparison is not None and self.places:
            self.turn_wanted.emit(self.comparison.name, *self.places[0])

    def _show_structure(self) -> None:
        """Show what the chosen structure, or all, tell."""
        alone, whole = self._alone, self._whole
        chosen = {"": alone[0]} if alone else dict(whole[0].structures) if whole else {}
        for line, text in zip((self.notes, self.remarks), remark_texts(chosen), strict=True):
            say(line, text)
        self.bars.show_rows(_rows(alone, whole))
        say(self.nearest, nearest_text(*(alone or (None, None))))
        single = self._compared if whole is None else None
        self.further.set_patient(single, alone[1] if alone else None, lambda: self.form.values)
        self.further.setVisible(whole is None)
        show_all(self.comparison is not None and self.reference is not None, self.answer, self.save)
        self.show_state()
        self._show_change()

    def _show_change(self) -> None:
        """Offer the map of changes if there are some, and choose it."""
        times, index = self.further.times, self.map.findData(CHANGE)
        has_change = times is not None and times.follow_up is not None
        model = self.map.model()
        assert isinstance(model, QStandardItemModel)
        model.item(index).setEnabled(has_change)
        if has_change != (self.map.currentIndex() == index):
            self.map.setCurrentIndex(index if has_change else 0)
        self._show_map()

    def _show_map(self) -> None:
        change = self._change
        morphs = (self.views, self.path, self.way, self.percent, self.overlaid)
        enable_all(self.comparison is not None and change is None, *morphs)
        rows: list[tuple[str | float, ...]] = []
        self.places = []
        if change is not None:
            for item in change_regions(change):
                rows.append((item.time, item.region.area, item.region.mean, "", item.region.z))
                self.places.append((item.place, item.seen_from))
        chosen = self.structure.currentData() or ""
        for name, part in self._parts.items() if change is None else ():
            if chosen not in (name, ""):
                continue
            self.places += part.places
            for number, region in enumerate(part.comparison.regions, start=1):
                place = f"{name} {number} {part.comparison.place(region)}".strip()
                rows.append((place, region.area, region.mean, 100.0 * region.thicker, region.z))
        self.table.show_rows(rows)
        self.regions.setVisible(bool(rows))
        self.shown_changed.emit()

    def _show_groups(self) -> None:
        """Offer the groups of the cohort as controls; a group with such a name comes first."""
        study = self.workspace.session.study
        groups = reference_first(filter(None, study.groups))
        default = next(filter(names_reference, groups), _EVERYONE)
        chosen = default if self.group.currentText() == self._default else self.group.currentText()
        self._default = default
        offer(self.group, dict.fromkeys((_EVERYONE, *groups)))
        self.group.setCurrentText(chosen if self.group.findText(chosen) >= 0 else default)
        size = size_name(study.cohort)
        usable = covariates_of(study.cohort, "group").items()
        self.adjust.offer({name: why for name, why in usable if name in study.columns and name != size})
        for box in (self.person, self.time):
            offer(box, {"None": ""} | {name: name for name in study.columns})

    def _show_reference(self) -> None:
        text, cautions = about_texts(self.reference)
        self.about.setText(text)
        say(self.cautions, cautions)
        set_primary(self.make, self.reference is None)
        self.form.show_reference(self.reference)
        self._receive(None)

    def _go_to(self, row: QModelIndex) -> None:
        """Look at a region."""
        if self.comparison is not None:
            self.place_wanted.emit(self.comparison.name, *self.places[row.row()])
