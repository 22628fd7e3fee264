"""Writing the report of a project: numbers and figures for the template of its texts, and the files."""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from homolog.comparison.answer import Answer
from homolog.comparison.ask import ask
from homolog.comparison.findings import CONTROLS, Finding, cautions, findings
from homolog.comparison.places import SurfaceCarrier, directions_of
from homolog.comparison.pose import PoseSample
from homolog.comparison.sample import Sample
from homolog.comparison.sample_rows import voxel_text
from homolog.comparison.seeds import read_spread, spread_text
from homolog.comparison.stored import folder_of, stored_answers, stored_poses
from homolog.comparison.tables import store
from homolog.errors import InputError, NumericalError
from homolog.inspection import Suspect, inspect
from homolog.inspection.verdict import Word, read_verdict
from homolog.io.atomic import atomic_write, write_text
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord
from homolog.io.report_details import read_details
from homolog.io.results import Result, read_result, read_surface
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.run.landmarks import project_landmark_errors
from homolog.statistics.cautions import cautions_of
from homolog.statistics.design import reference_first
from homolog.statistics.procrustes import Alignment
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh
from homolog.threads import cores
from homolog_app.pictures import write_picture
from homolog_app.rendering.camera import Clip
from homolog_app.report import NOTICE, rows
from homolog_app.report.figures import ReportFigure, map_limits, model_figures, quality_rows, study_figures
from homolog_app.report.model_section import (
    CorrespondenceRow,
    correspondence_rows,
    landmark_text,
    settings_rows,
    write_correspondence,
)
from homolog_app.report.page import Page
from homolog_app.report.sheets import write_page
from homolog_app.report.texts import template_text

__all__ = ["write_report"]

_TEMPLATE = "report_text.jinja"
_TABLES = ("quality.csv", "correspondence.csv", "measures.csv", "settings.csv")
"""Files next to the page."""


@dataclass(frozen=True, slots=True, eq=False)
class _Study:
    """An answer with its number in the report, and what is said of it."""

    number: int
    answer: Answer
    findings: list[Finding]
    is_primary: bool
    spread: str

    @property
    def title(self) -> str:
        return self.answer.question.title


def write_report(project: ProjectFolder, tick: Tick = no_tick, clip: Clip | None = None) -> Path:
    """Answer all questions of a project again and write its report.

    Questions that can't be answered any more are left out and named.

    Parameters
    ----------
    project : ProjectFolder
        Project with a result and the questions that ``homolog analyze`` stored.
    tick : Tick
        Progress and cancellation.
    clip : Clip, optional
        The plane that cuts the shapes of the figures open.

    Returns
    -------
    Path
        The page; the PDF ``report.pdf`` and the folder ``figures`` are next to it.

    Raises
    ------
    InputError
        If there is no result, or the folder can't be written to.
    """
    tick(0.0, "reading the result")
    result = read_result(project)
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result yet")
    folder, details = project.folder / "report", read_details(project)
    carrier = SurfaceCarrier.of(result, directions_of(details))
    studies, lost = _answered(project, result, record, carrier, part_of(tick, 0.0, 0.5))
    answers = [study.answer for study in studies]
    model = ShapeModel().fit(result.world, names=result.names)
    drawn = list(model_figures(project, result, model, carrier, part_of(tick, 0.5, 0.55), clip))
    tick(0.55, "surfaces of the subjects")
    meshes = _surfaces(project, record)
    correspondence = correspondence_rows(meshes, result, carrier)
    maps, others = list[ReportFigure](), list[ReportFigure]()
    for index, (answer, limit) in enumerate(zip(answers, map_limits(answers, carrier), strict=True)):
        part = part_of(tick, 0.6 + 0.3 * index / len(answers), 0.6 + 0.3 * (index + 1) / len(answers))
        store(project, answer, result, carrier)
        for figure in study_figures(answer, carrier, limit, part, clip):
            (others if figure.small else maps).append(figure)
    tick(0.9, "writing the report")
    of = f": {details.structure}" if details.structure else ""
    page = Page(f"Shape analysis of {project.folder.resolve().name}{of}", f"{NOTICE} {_made(record)}")
    figures = {
        "first_map": maps[:1],
        "maps": [*others, *maps[1:]],
        "model": [figure for figure in drawn if figure.small],
        "modes": [figure for figure in drawn if not figure.small],
    }
    measures = rows.measures_of(meshes, hollow=carrier.is_hollow)
    verdict = read_verdict(project, result.world, part_of(tick, 0.9, 0.95))
    context = {
        **_of_model(project, record, result, model, meshes, correspondence, drawn),
        **_of_studies(studies),
        "poses": _poses(project, result, record),
        "controls": CONTROLS,
        "details": details,
        "record": record,
        "lost": lost,
        "verdict": ("" if verdict.word is Word.SOUND else "! ") + verdict.line,
        "directions": carrier.directions,
        "hollow": carrier.is_hollow,
    }
    text = _text(context, record.versions.get("homolog", ""))
    tables = _tables(answers, result, carrier, measures)
    tables["verdict"] = {
        "columns": ("measure", "value"),
        "rows": verdict.rows,
        "summary": "What the verdict on the model follows from",
    }
    page.write(text, figures, tables)
    _write_tables(folder, record, result, model, answers, measures, correspondence)
    _add_files(page, project, answers, [*drawn, *others, *maps])
    for figure in [*drawn, *others, *maps]:
        for suffix in ("svg", "pdf"):
            with atomic_write(folder / "figures" / f"{figure.name}.{suffix}") as part_file:
                write_picture(figure.figure, part_file)
    write_text(folder / "report.html", page.html)
    write_page(folder / "report.pdf", page)
    return folder / "report.html"


def _answered(
    project: ProjectFolder, result: Result, record: ResultRecord, carrier: SurfaceCarrier, tick: Tick
) -> tuple[list[_Study], list[str]]:
    """Return the answers to all questions, the primary one first, and what can't be answered."""
    kept, lost = stored_answers(project)
    sample, studies = Sample.of(result), list[_Study]()
    for index, stored in enumerate(kept):
        part = part_of(tick, index / len(kept), (index + 1) / len(kept))
        try:
            answer = ask(sample, stored.question, part)
        except InputError as error:  # such as a value that a subject added later lacks
            lost.append(f"{stored.question.title}: {error}")
            continue
        try:
            spread = spread_text(read_spread(folder_of(project, stored.question), record.fingerprint, answer))
        except InputError as error:
            spread = [str(error)]
        sentences = findings(answer, carrier)
        studies.append(_Study(len(studies) + 1, answer, sentences, stored.is_primary, " ".join(spread)))
    return studies, lost


def _poses(project: ProjectFolder, result: Result, record: ResultRecord) -> list[tuple[str, Sequence[str]]]:
    """Return the questions about poses, and what their answers say."""
    answered: list[tuple[str, Sequence[str]]] = []
    for stored in stored_poses(project):
        question = stored.question
        try:
            poses = PoseSample.of(result, question.pose, record.settings.optimize.align_by)
            answer = ask(poses.sample, question)
        except InputError as error:
            answered.append((question.title, [f"! Left out: {error}"]))
        else:
            poses.store(project, answer)
            notes = [f"! {caution}" for caution in cautions(answer)]
            answered.append((question.title, [*poses.sentences(answer), *notes]))
    return answered


def _text(context: Mapping[str, object], version: str) -> str:
    """Return the report's texts, with numbers in place of citations, and the references at the end."""
    with (files("homolog_resources") / "references.csv").open(encoding="utf-8") as stream:
        known = {row["key"]: row["text"].format(version) for row in csv.DictReader(stream)}
    cited: list[str] = []

    def number(citation: re.Match[str]) -> str:
        keys = citation[1].split(", ")
        if not set(keys) <= set(known):
            return citation[0]
        cited.extend(key for key in keys if key not in cited)
        return f"[{', '.join(str(cited.index(key) + 1) for key in keys)}]"

    pattern = re.compile(r"\[([a-z]+(?:, [a-z]+)*)\]")
    pattern.sub(number, template_text(_TEMPLATE, {**context, "references": ()}))
    references = [f"{place}. {known[key]}" for place, key in enumerate(cited, start=1)]
    return pattern.sub(number, template_text(_TEMPLATE, {**context, "references": references}))


def _of_model(
    project: ProjectFolder,
    record: ResultRecord,
    result: Result,
    model: ShapeModel,
    meshes: Sequence[TriangleMesh],
    correspondence: Sequence[CorrespondenceRow],
    drawn: Sequence[ReportFigure],
) -> dict[str, object]:
    """Return what the template says of the shape model."""
    groups = list(result.groups)
    order = [*reference_first(filter(None, groups)), *([None] if None in groups else [])]
    counts = ", ".join(f"{groups.count(group)} {group or 'no group'}" for group in order)
    area = result.mean_surface.area
    quality = [row for row in quality_rows(result, model) if row[2] is not None]
    has_modes = any(figure.name == "modes" for figure in drawn)
    voxels = [sorted(subject.voxel) for subject in record.subjects if subject.voxel]
    return {
        "names": result.names,
        "groups": f" ({counts})" if any(groups) else "",
        "area": area,
        "apart": (area / record.particles) ** 0.5,
        "procrustes": record.settings.placing.procrustes.value,
        "modes": min(3, len(model.explained_variance_)) if has_modes else 0,
        "share": 100.0 * float(model.explained_variance_ratio_[:3].sum()),
        "quality": quality[min(2, len(quality) - 1)] if quality else None,
        "correspondence": correspondence,
        "suspects": _suspects(result, meshes),
        "landmarks": _landmarks(project),
        "voxels": voxel_text(voxels) if voxels else "",
        "spacing": _range([subject.spacing for subject in record.subjects if subject.spacing], ".3g"),
        "vertices": _range([subject.vertices for subject in record.subjects if subject.vertices], "d"),
    }


def _range(values: Sequence[float], form: str) -> str:
    """Return the least and the largest value as text; empty without values."""
    return (
        " to ".join(dict.fromkeys(format(end, form) for end in (min(values), max(values)))) if values else ""
    )


def _of_studies(studies: Sequence[_Study]) -> dict[str, object]:
    """Return what the template says of the questions and how they were answered."""
    answers = [study.answer for study in studies]
    requested = [answer.question for answer in answers]
    stops = [study.number for study in studies if not study.findings[0].is_significant]
    left = [f"{name} ({why})" for answer in answers[:1] for name, why in answer.left_out.items()]
    by_alignment: dict[Alignment, list[str]] = {}
    for study in studies:
        by_alignment.setdefault(study.answer.question.alignment, []).append(str(study.number))
    counts = sorted({comparison.test.permutations for answer in answers for comparison in answer.comparisons})
    return {
        "studies": studies,
        "sequence_end": stops[0] if stops else len(studies),
        "cautions": list(_cautions(studies)),
        "left_out": left,
        "alignments": {way.value: numbers for way, numbers in by_alignment.items()},
        "chosen_modes": any(question.modes is not None for question in requested),
        "permutations": " to ".join(map(str, dict.fromkeys((counts[0], counts[-1])))) if counts else "",
        "has_pairs": any(answer.pairwise for answer in answers),
        "has_covariates": any(question.covariates for question in requested),
        "has_slopes": any(question.kind == "regression" for question in requested),
        "has_formulas": any(question.kind == "formula" for question in requested),
        "is_paired": any(question.kind == "pairs" for question in requested),
        "complete_cases": any(question.complete_cases for question in requested),
        "similar": any(question.alignment is Alignment.SHAPE for question in requested),
    }


def _cautions(studies: Sequence[_Study]) -> Iterator[str]:
    """Yield the cautions of all questions, each once with the questions that it is about."""
    numbers: dict[str, list[int]] = {}
    for study in studies:
        own = [
            item
            for comparison in study.answer.comparisons
            for item in cautions_of(comparison, study.answer.names)
        ]
        for text in dict.fromkeys([*own, *study.answer.notes]):
            numbers.setdefault(text, []).append(study.number)
    for text, of in numbers.items():
        which = f"Question {', '.join(map(str, of))}: " if len(studies) > 1 else ""
        yield f"{which}{text}"


def _tables(
    answers: Sequence[Answer], result: Result, carrier: SurfaceCarrier, measures: Sequence[rows.Measure]
) -> dict[str, Mapping[str, object]]:
    """Return the report's tables by the names in its template: arguments of `Page.table`."""
    if not answers:
        return {}
    grouped = [answer for answer in answers if answer.question.kind == "groups"][:1]
    columns, sample = rows.sample(answers, result)
    return {
        "main": {
            "columns": rows.MAIN,
            "rows": list(rows.main(answers)),
            "caption": "Size, shape and place",
        },
        "sample": {"columns": columns, "rows": sample, "caption": "Subjects"},
        "measures": {
            "columns": rows.measure_columns(grouped[0]) if grouped else [],
            "rows": list(rows.measure_rows(grouped[0], measures)) if grouped else [],
            "caption": "Surfaces at their own size; p of Welch's t-test, not corrected",
        },
        "covariates": {
            "columns": rows.COVARIATES,
            "rows": list(rows.covariates(answers)),
            "caption": "Covariates, each adjusted for what is tested and for the others; p not corrected",
        },
        "anova": {
            "columns": rows.ANOVA,
            "rows": list(rows.anova(answers)),
            "caption": "Analysis of variance of all coordinates, by formula",
        },
        "apart": {
            "columns": rows.DIFFERENCES,
            "rows": list(rows.apart(answers)),
            "caption": "Differences of means and slopes; p by Holm within a kind of difference",
        },
        "regions": {
            "columns": rows.REGIONS,
            "rows": list(rows.regions(answers, carrier)),
            "caption": "Largest significant regions (all: regions.csv)",
        },
        "details": {
            "columns": rows.DETAILS,
            "rows": list(rows.details(answers)),
            "summary": "Details of all tests",
        },
    }


def _write_tables(
    folder: Path,
    record: ResultRecord,
    result: Result,
    model: ShapeModel,
    answers: Sequence[Answer],
    measures: Sequence[rows.Measure],
    correspondence: Sequence[CorrespondenceRow],
) -> None:
    """Write the tables next to the page."""
    heads = ["modes", "compactness", "generalization_mm", "specificity_mm"]
    write_table(folder / "quality.csv", heads, quality_rows(result, model))
    write_table(folder / "settings.csv", ["part", "setting", "value"], settings_rows(record, answers))
    if correspondence:
        write_correspondence(folder, correspondence)
    if measures:
        columns = zip(result.names, *(item.values.tolist() for item in measures), strict=True)
        write_table(folder / "measures.csv", ["name", *(item.column for item in measures)], columns)


def _surfaces(project: ProjectFolder, record: ResultRecord) -> list[TriangleMesh]:
    """Return the subjects' surfaces in the coordinates of their files; none if one is missing."""
    meshes = []
    for subject in record.subjects:
        try:
            meshes.append(read_surface(project, subject))
            check_mesh(meshes[-1], subject.name, may_open=True)
        except InputError:
            return []
    return meshes


def _suspects(result: Result, meshes: Sequence[TriangleMesh]) -> Sequence[Suspect] | None:
    """Return the suspects of ``homolog check``; None without three surfaces with neighbouring particles."""
    if len(meshes) < 3:
        return None
    try:
        return inspect(result.local, meshes, result.alignments, names=result.names, workers=cores()).suspects
    except InputError:
        return None


def _landmarks(project: ProjectFolder) -> str:
    """Return a sentence on landmarks, if the project's subjects have any."""
    try:
        errors = project_landmark_errors(project)
    except (InputError, NumericalError) as error:
        return f"Landmarks can't be compared. {error} "
    return "" if errors is None else f"{landmark_text(errors)}. "


def _made(record: ResultRecord) -> str:
    finished = record.finished.replace("T", " ").replace("+00:00", " UTC")
    return f"Made with Homolog {record.versions.get('homolog', '')} from the result of {finished}."


def _add_files(
    page: Page, project: ProjectFolder, answers: Sequence[Answer], figures: Sequence[ReportFigure]
) -> None:
    page.heading("Files")
    page.links(["report.pdf"], "This page as PDF")
    vectors = [f"figures/{figure.name}.{suffix}" for figure in figures for suffix in ("svg", "pdf")]
    page.links(vectors, f"Figures as vector graphics ({len(vectors)} files)")
    tables = [
        f"../{path.relative_to(project.folder).as_posix()}"
        for answer in answers
        for path in sorted(folder_of(project, answer.question).glob("*.csv"))
    ]
    own = [name for name in _TABLES if (project.folder / "report" / name).is_file()]
    tables = [*own, "../model/scores.csv", "../model/eigenvalues.csv", *tables]
    page.links(tables, f"Tables with the subjects' names ({len(tables)} files)")
