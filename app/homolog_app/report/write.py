"""Writing the report of a project: the page, its figures as vector graphics, and the studies' tables."""

from collections.abc import Sequence
from pathlib import Path

from homolog.analysis.comparison import Comparison
from homolog.analysis.shape_model import ShapeModel, fit_shape_model
from homolog.errors import InputError
from homolog.files.atomic import replacing, write_text
from homolog.files.project import Project
from homolog.files.records import ResultRecord
from homolog.files.results import Result, read_result
from homolog.progress import Tick, no_tick, part_of
from homolog_app.pictures import write_picture
from homolog_app.report.figures import ReportFigure, model_figures, study_figures
from homolog_app.report.findings import LEVEL, cautions, findings, outlier_words, p_words
from homolog_app.report.landmarks import write_landmarks
from homolog_app.report.methods import methods, settings_rows
from homolog_app.report.page import Page
from homolog_app.report.request import read_requests, study_folder
from homolog_app.report.study import Study, run_study
from homolog_app.report.surface_maps import SurfaceCarrier
from homolog_app.report.tables import write_study_tables

__all__ = ["write_report"]

NOTICE = "For research use only. Not a medical device; not for diagnosis or treatment."


def write_report(project: Project, tick: Tick = no_tick) -> Path:
    """Answer all of a project's questions anew and write its report.

    Parameters
    ----------
    project : Project
        With a result; studies are those that ``homolog analyze`` kept.
    tick : Tick
        Progress and cancelling.

    Returns
    -------
    Path
        The page; figures lie in ``figures`` beside it.

    Raises
    ------
    InputError
        If there is no result, a study can't be answered any more, or the folder can't be written to.
    """
    tick(0.0, "reading the result")
    result = read_result(project)
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: has no result yet")
    folder = project.folder / "report"
    requests = read_requests(project)
    studies = []
    for index, request in enumerate(requests):
        share = 0.5 / len(requests)
        studies.append(run_study(result, request, part_of(tick, index * share, (index + 1) * share)))
    carrier = SurfaceCarrier.of(result)
    model = fit_shape_model(result.world, names=result.names)
    figures = list(model_figures(project, result, model, carrier, part_of(tick, 0.5, 0.6)))
    page = Page(f"Shape analysis of {project.folder.resolve().name}", f"{NOTICE} {_made(record)}")
    _summary(page, record, result, studies)
    _model_section(page, model, figures)
    for index, study in enumerate(studies):
        part = part_of(tick, 0.6 + 0.3 * index / len(studies), 0.6 + 0.3 * (index + 1) / len(studies))
        write_study_tables(study_folder(project, study.request), study, result, carrier)
        own = list(study_figures(study, carrier, part))
        _study_section(page, study, own)
        figures += own
    tick(0.9, "writing the report")
    write_landmarks(page, project)
    _closing(page, project, record, studies, figures)
    for figure in figures:
        for suffix in ("svg", "pdf"):
            with replacing(folder / "figures" / f"{figure.name}.{suffix}") as part_file:
                write_picture(figure.figure, part_file)
    write_text(folder / "report.html", page.html)
    return folder / "report.html"


def _made(record: ResultRecord) -> str:
    return f"Made with Homolog {record.versions.get('homolog', '')} from the result of {record.finished}."


def _summary(page: Page, record: ResultRecord, result: Result, studies: Sequence[Study]) -> None:
    groups = [one.group for one in record.subjects]
    counts = ", ".join(f"{groups.count(one)} {one or 'no group'}" for one in dict.fromkeys(groups))
    page.paragraph(
        f"{len(groups)} subjects{f' ({counts})' if any(groups) else ''} with {record.particles} "
        f"corresponding particles each; {record.metric} distances; surface: {record.surface_words}."
    )
    page.heading("Findings")
    for words in outlier_words(result):
        page.caution(words)
    if not studies:
        page.paragraph("No study has been made yet: homolog analyze PROJECT --group COLUMN.")
    for study in studies:
        page.heading(study.request.title, 3)
        page.points((one.verdict, one.numbers) for one in findings(study))
        for words in cautions(study):
            page.caution(words)


def _model_section(page: Page, model: ShapeModel, figures: Sequence[ReportFigure]) -> None:
    page.heading("Shape model")
    small = [one for one in figures if one.name in ("scree", "scores")]
    page.figures(small)
    for one in figures:
        if one not in small:
            page.figures([one])
    deviations = model.standard_deviations / len(model.mean) ** 0.5
    shares = zip(deviations, model.explained, model.explained.cumsum(), strict=True)
    page.table(
        ["mode", "standard deviation (mm rms)", "share (%)", "cumulated (%)"],
        (
            (str(mode), f"{deviation:.2f}", f"{100 * share:.1f}", f"{100 * total:.1f}")
            for mode, (deviation, share, total) in enumerate(shares, start=1)
        ),
        summary="All modes",
    )


def _study_section(page: Page, study: Study, figures: Sequence[ReportFigure]) -> None:
    page.heading(f"Study: {study.request.title}")
    page.table(_COLUMNS, (_row(one) for one in study.comparisons))
    for one in figures:
        if one.heading:
            page.heading(one.heading, 3)
        page.figures([one])
    alarms = [
        (one.title, test.test, f"{100 * test.rate:.1f}", f"{100 * test.low:.1f} – {100 * test.high:.1f}")
        for one in study.comparisons
        for test in one.false_alarms
    ]
    if alarms:
        page.heading("False alarms on this cohort", 3)
        page.paragraph(
            f"The labels were exchanged {study.request.null_repeats} times, so that there is nothing to "
            "find. A "
            f"test that keeps its word calls {100 * LEVEL:g} % of these significant; without correction "
            "over the "
            "surface, some particle nearly always is."
        )
        page.table(["comparison", "test", "false alarms (%)", "95 % bounds"], alarms, words=True)


_COLUMNS = (
    "comparison", "modes", "T² or lambda", "p (F)", "p (permutation)", "p (Holm)", "distance (SD)",
    f"particles p ≤ {LEVEL:g}, corrected (%)", f"particles q ≤ {LEVEL:g} (%)", "accuracy (%)", "AUC",
    "size p",
)  # fmt: skip


def _row(one: Comparison) -> tuple[str, ...]:
    test, local, line = one.test, one.local, one.discriminant
    return (
        one.title,
        str(test.modes),
        f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
        p_words(test.p)[4:],
        p_words(test.p_permutation)[4:],
        p_words(one.p_adjusted)[4:],
        f"{test.mahalanobis:.2f}" if test.mahalanobis is not None else "–",
        f"{100 * (local.p_family <= LEVEL).mean():.1f}",
        f"{100 * (local.q <= LEVEL).mean():.1f}",
        f"{100 * line.accuracy:.0f}" if line is not None else "–",
        f"{line.auc:.2f}" if line is not None else "–",
        p_words(one.size_p)[4:],
    )


def _closing(
    page: Page,
    project: Project,
    record: ResultRecord,
    studies: list[Study],
    figures: Sequence[ReportFigure],
) -> None:
    page.heading("Methods")
    for words in methods(record, studies):
        page.paragraph(words)
    page.table(
        ["part", "setting", "value"], settings_rows(record, studies), words=True, summary="All settings"
    )
    page.table(
        ["subject", "group", "notes"],
        ((one.name, one.group or "", "; ".join(one.notes)) for one in record.subjects),
        words=True,
        summary="All subjects",
    )
    page.heading("Files")
    vectors = [f"figures/{one.name}.{suffix}" for one in figures for suffix in ("svg", "pdf")]
    page.links(vectors, f"Figures as vector graphics ({len(vectors)} files)")
    tables = [
        f"../{path.relative_to(project.folder).as_posix()}"
        for study in studies
        for path in sorted(study_folder(project, study.request).glob("*.csv"))
    ]
    tables = ["../model/scores.csv", "../model/eigenvalues.csv", *tables]
    page.links(tables, f"Tables with the subjects' names ({len(tables)} files)")
