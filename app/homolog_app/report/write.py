"""Writing the report of a project: the page, its figures as vector graphics, and the studies' tables."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.comparison.answer import Answer, ask
from homolog.comparison.findings import outlier_text
from homolog.comparison.places import SurfaceCarrier, directions_of
from homolog.comparison.sample import Sample
from homolog.comparison.seeds import SeedAnswer, read_spread, seed_numbers, spread_text
from homolog.comparison.stored import folder_of, stored_answers
from homolog.comparison.tables import store
from homolog.errors import InputError, NumericalError
from homolog.exchange import project_landmark_errors
from homolog.inspection import inspect
from homolog.inspection.verdict import Word, read_verdict
from homolog.io.atomic import atomic_write, write_text
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord
from homolog.io.report_details import Axes, ReportDetails, read_details
from homolog.io.results import Result, read_result, read_surface
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.design import reference_first
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh
from homolog.threads import cores
from homolog_app.pictures import write_picture
from homolog_app.rendering.camera import Clip
from homolog_app.report import NOTICE
from homolog_app.report.appendix import definitions, numbered
from homolog_app.report.figures import ReportFigure, map_limits, model_figures, quality_rows, study_figures
from homolog_app.report.main_results import add_main_results
from homolog_app.report.methods import methods
from homolog_app.report.model_section import (
    add_correspondence,
    correspondence_rows,
    landmark_text,
    pose_text,
    settings_rows,
)
from homolog_app.report.page import Page
from homolog_app.report.sample import add_measures, add_missing, add_samples, measures_of
from homolog_app.report.sheets import write_page
from homolog_app.report.study_section import add_assumptions, add_statistics, add_study

__all__ = ["write_report"]


def write_report(project: ProjectFolder, tick: Tick = no_tick, clip: Clip | None = None) -> Path:
    """Answer all questions of a project again and write its report.

    Parameters
    ----------
    project : ProjectFolder
        Project with a result and the studies that ``homolog analyze`` stored.
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
        If there is no result, a study can no longer be answered, or the folder can't be written to.
    """
    tick(0.0, "reading the result")
    result = read_result(project)
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result yet")
    folder = project.folder / "report"
    kept, lost = stored_answers(project)
    primary = any(study.is_primary for study in kept)
    studies = []
    for index, one in enumerate(kept):
        part = part_of(tick, 0.5 * index / len(kept), 0.5 * (index + 1) / len(kept))
        try:
            studies.append(ask(Sample.of(result), one.question, part))
        except InputError as error:  # such as a value that a subject added later lacks
            lost.append(f"{one.question.title}: {error}")
    seeds = [read_spread(folder_of(project, study.question), record.fingerprint, study) for study in studies]
    details = read_details(project)
    carrier = SurfaceCarrier.of(result, directions_of(details, record))
    model = ShapeModel.fit(result.world, names=result.names)
    figures = list(model_figures(project, result, model, carrier, part_of(tick, 0.5, 0.55), clip))
    tick(0.55, "surfaces of the subjects")
    meshes = _surfaces(project, record)
    correspondence = correspondence_rows(meshes, result, carrier)
    of = f": {details.structure}" if details.structure else ""
    page = Page(f"Shape analysis of {project.folder.resolve().name}{of}", f"{NOTICE} {_made(record)}")
    _introduction(page, record, result, studies, details)
    verdict = read_verdict(project, result.world, part_of(tick, 0.55, 0.58))
    (page.paragraph if verdict.word is Word.SOUND else page.caution)(verdict.line)
    for text in lost:
        page.caution(f"Left out: {text}")
    page.heading("Main results")
    if studies:
        add_main_results(page, studies, seeds, carrier, correspondence, primary=primary)
        page.heading("Sample")
        add_samples(page, studies, result)
        add_measures(page, folder, result, studies, measures_of(meshes, hollow=carrier.is_hollow))
    else:
        for text in outlier_text(result):
            page.caution(text)
        page.paragraph("No group comparison yet: run homolog analyze PROJECT --group COLUMN.")
    _model_section(page, folder, record, result, model, figures)
    page.table(("measure", "value"), verdict.rows, as_text=True, caption="What the verdict follows from")
    add_correspondence(page, folder, correspondence)
    _add_check(page, result, meshes)
    _add_landmarks(page, project)
    limits = map_limits(studies, carrier)
    seed = None if record.source else record.settings.optimize.seed
    for index, study in enumerate(studies):
        part = part_of(tick, 0.6 + 0.3 * index / len(studies), 0.6 + 0.3 * (index + 1) / len(studies))
        store(project, study, result, carrier)
        own = list(study_figures(study, carrier, limits[index], part, clip))
        title = f"Study {index + 1}{', primary' if primary and not index else ''}"
        add_study(page, study, title, seed, carrier, own)
        figures += own
    tick(0.9, "writing the report")
    if studies:
        page.heading("Statistics of all studies")
        add_statistics(page, studies)
        add_assumptions(page, studies)
        for text in [line for answers in seeds for line in spread_text(answers)]:
            page.paragraph(text)
    _methods(page, folder, record, studies, seeds, carrier, details, primary=primary)
    _files(page, project, studies, figures)
    _write_figures(folder / "figures", figures)
    write_text(folder / "report.html", page.html)
    write_page(folder / "report.pdf", page)
    return folder / "report.html"


def _write_figures(folder: Path, figures: Sequence[ReportFigure]) -> None:
    for figure in figures:
        for suffix in ("svg", "pdf"):
            with atomic_write(folder / f"{figure.name}.{suffix}") as part:
                write_picture(figure.figure, part)


def _surfaces(project: ProjectFolder, record: ResultRecord) -> list[TriangleMesh]:
    """Return the subjects' surfaces in the coordinates of their files; none if one is missing."""
    meshes = []
    for subject in record.subjects:
        try:
            meshes.append(read_surface(project, subject))
            check_mesh(meshes[-1], subject.name)
        except InputError:
            return []
    return meshes


def _add_check(page: Page, result: Result, meshes: Sequence[TriangleMesh]) -> None:
    """Add the suspects of `homolog check`."""
    if len(meshes) < 3:
        page.paragraph(
            "Particles were not checked for wrong positions, which requires three subjects with surfaces."
        )
        return
    suspects = inspect(result.local, meshes, result.alignments, names=result.names, workers=cores()).suspects
    if not suspects:
        page.paragraph("homolog check finds no location where the correspondence may be wrong.")
        return
    kinds = [suspect.kind.value for suspect in suspects]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    particles = {(suspect.subject, int(particle)) for suspect in suspects for particle in suspect.particles}
    names = sorted({result.names[suspect.subject] for suspect in suspects})
    of_worst = result.names[suspects[0].subject]
    page.paragraph(
        f"homolog check finds {len(suspects)} locations where the correspondence may be wrong ({counts}): "
        f"{len(particles)} of {result.world.shape[0] * result.world.shape[1]} particles on {len(names)} of "
        f"{len(result.names)} subjects ({', '.join(names)}), the most severe on {of_worst}. Check them "
        "before local differences there are claimed."
    )


def _made(record: ResultRecord) -> str:
    finished = record.finished.replace("T", " ").replace("+00:00", " UTC")
    return f"Made with Homolog {record.versions.get('homolog', '')} from the result of {finished}."


def _introduction(
    page: Page, record: ResultRecord, result: Result, studies: Sequence[Answer], details: ReportDetails
) -> None:
    groups = list(result.groups)
    counts = ", ".join(f"{groups.count(group)} {group or 'no group'}" for group in _in_order(groups, studies))
    what = f"Structure: {details.structure}. " if details.structure else ""
    page.paragraph(
        f"{what}{len(groups)} subjects{f' ({counts})' if any(groups) else ''} with {record.particles} "
        f"corresponding particles each, placed with {record.metric} distances."
    )
    if details.cohort:
        page.paragraph(f"Cohort: {details.cohort.rstrip('.')}.")
    if record.excluded:
        page.paragraph(f"Excluded before the run: {len(record.excluded)}. {' '.join(record.excluded)}")
    if record.mirrored_text:
        names = ", ".join(subject.name for subject in record.subjects if subject.is_mirrored)
        page.paragraph(
            f"{record.mirrored_text}: {names}. Means, modes and differences are shown in the common frame."
        )


def _in_order(groups: Sequence[str | None], studies: Sequence[Answer]) -> list[str | None]:
    """Return the different groups, in the order of the first study of them."""
    compared = [group for study in studies for group in study.question.between]
    order = list(dict.fromkeys([*compared, *reference_first(filter(None, groups)), *groups]))
    return [group for group in order if group in groups]


def _mm(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _model_section(
    page: Page,
    folder: Path,
    record: ResultRecord,
    result: Result,
    model: ShapeModel,
    figures: Sequence[ReportFigure],
) -> None:
    page.heading("Shape model")
    area = result.mean_surface.area
    each = area / record.particles
    held_out = "" if record.source else "; it was included in the correspondence"
    page.paragraph(
        f"{len(result.names)} shapes, {pose_text(record)}. The mean surface has an area of {area:.0f} mm²; a "
        f"particle represents {each:.3g} mm² of it on average, so that particles are about {each**0.5:.2g} "
        "mm apart. The modes below are those of all subjects; tests use modes of the subjects and the "
        "alignment of each comparison. The sign of a mode is arbitrary. Scores and standard deviations are "
        "root mean squares over the particles. For generalization each subject in turn was held out and "
        f"fitted with modes of the others{held_out}. Specificity was computed for some numbers of modes only."
    )
    page.figures([figure for figure in figures if figure.small])
    page.figures([figure for figure in figures if not figure.small])
    rows = quality_rows(result, model)
    if rows:
        write_table(
            folder / "quality.csv", ["modes", "compactness", "generalization_mm", "specificity_mm"], rows
        )
        page.table(
            ["modes", "compactness (%)", "generalization (mm)", "specificity (mm)"],
            (
                (str(k), f"{100 * share:.1f}", _mm(left_out), _mm(drawn))
                for k, share, left_out, drawn in rows
                if drawn is not None
            ),
            caption="Quality of the model",
        )


def _methods(
    page: Page, folder: Path, record: ResultRecord, studies: list[Answer],
    seeds: Sequence[Sequence[SeedAnswer]], carrier: SurfaceCarrier, details: ReportDetails, *, primary: bool,
) -> None:  # fmt: skip
    """Add methods, definitions, a list for the authors to complete, and references; settings as a table."""
    page.heading("Methods")
    terms = list(definitions(studies, carrier, confirmed=details.axes is not Axes.AUTO)) if studies else []
    texts, references = numbered(
        [*methods(record, studies), *(text for _, text in terms)], record.versions.get("homolog", "")
    )
    for text in texts[: len(texts) - len(terms)]:
        page.paragraph(text)
    repeated = [str(number) for number, own in enumerate(seeds, start=1) if len(seed_numbers(own)) > 1]
    if repeated:
        numbers = sorted({number for own in seeds for number in seed_numbers(own)})
        page.paragraph(
            f"Study {', '.join(repeated)}: optimization and tests were repeated on the same surfaces with "
            f"seeds {', '.join(map(str, numbers))} of the optimization; the main results are medians."
        )
    write_table(folder / "settings.csv", ["part", "setting", "value"], settings_rows(record, studies))
    page.paragraph("All settings and versions are in settings.csv.")
    if terms:
        page.heading("Definitions", 3)
        for (term, _), text in zip(terms, texts[len(texts) - len(terms) :], strict=True):
            page.paragraph(f"{term}: {text}")
    page.heading("For the authors to add", 3)
    one_seed = len(repeated) < len(seeds)
    add_missing(page, record, details, one_seed=one_seed, primary=primary if len(studies) > 1 else None)
    page.heading("References", 3)
    for text in references:
        page.paragraph(text)


def _files(
    page: Page, project: ProjectFolder, studies: Sequence[Answer], figures: Sequence[ReportFigure]
) -> None:
    page.heading("Files")
    page.links(["report.pdf"], "This page as PDF")
    vectors = [f"figures/{figure.name}.{suffix}" for figure in figures for suffix in ("svg", "pdf")]
    page.links(vectors, f"Figures as vector graphics ({len(vectors)} files)")
    tables = [
        f"../{path.relative_to(project.folder).as_posix()}"
        for study in studies
        for path in sorted(folder_of(project, study.question).glob("*.csv"))
    ]
    own = [name for name in _TABLES if (project.folder / "report" / name).is_file()]
    tables = [*own, "../model/scores.csv", "../model/eigenvalues.csv", *tables]
    page.links(tables, f"Tables with the subjects' names ({len(tables)} files)")


_TABLES = ("quality.csv", "correspondence.csv", "measures.csv", "settings.csv")
"""File next to the page."""


def _add_landmarks(page: Page, project: ProjectFolder) -> None:
    """Write the report's section on landmarks, if the project's subjects have any."""
    try:
        errors = project_landmark_errors(project)
    except (InputError, NumericalError) as error:
        page.heading("Landmarks")
        page.caution(f"Landmarks can't be compared. {error}")
        return
    if errors is None:
        return
    page.heading("Landmarks")
    page.paragraph(
        f"{landmark_text(errors)}. Each subject's landmarks were transferred to each other subject by the "
        "thin-plate spline of the particles, projected onto the surface, and compared with that subject's "
        "own."
    )
    page.table(
        ["landmark", "mean (mm)", "median (mm)", "95th percentile (mm)", "largest (mm)"],
        (
            (name, *(f"{value:.2f}" for value in _figures(errors.errors[..., index])))
            for index, name in enumerate(errors.names)
        ),
    )


def _figures(errors: FloatArray) -> tuple[float, float, float, float]:
    finite = errors[np.isfinite(errors)]
    median, high = np.quantile(finite, [0.5, 0.95])
    return float(finite.mean()), float(median), float(high), float(finite.max())
