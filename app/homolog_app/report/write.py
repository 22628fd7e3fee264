"""Writing the report of a project: the page, its figures as vector graphics, and the studies' tables."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.analysis.cautions import p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.effects import Effect
from homolog.analysis.shape_model import ShapeModel
from homolog.arrays import FloatArray
from homolog.errors import InputError, NumericalError
from homolog.exchange import project_landmark_errors
from homolog.files.atomic import atomic_write, write_text
from homolog.files.project import ProjectFolder
from homolog.files.records import ResultRecord
from homolog.files.report_details import ReportDetails, read_details
from homolog.files.results import Result, read_result
from homolog.files.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog_app.pictures import write_picture
from homolog_app.rendering.camera import Clip
from homolog_app.report import NOTICE
from homolog_app.report.correspondence import add_correspondence, correspondence_rows, landmark_text
from homolog_app.report.figures import ReportFigure, model_figures, quality_rows, study_figures
from homolog_app.report.findings import (
    LEVEL,
    NOUNS,
    Finding,
    cautions,
    findings,
    outlier_text,
)
from homolog_app.report.methods import methods, pose_text
from homolog_app.report.page import Page
from homolog_app.report.references import references
from homolog_app.report.request import read_requests, reference_first, study_folder
from homolog_app.report.sample import add_missing
from homolog_app.report.seeds import SeedAnswer, read_spread, seed_numbers, spread_by_comparison
from homolog_app.report.sheets import write_page
from homolog_app.report.study import Study, run_study
from homolog_app.report.study_parts import digits_of, effect_cell, interval_cell, settings_rows
from homolog_app.report.study_section import add_study
from homolog_app.report.surface_maps import Region, SurfaceCarrier, directions_of, significant_regions
from homolog_app.report.tables import save_study

__all__ = ["write_report"]


def write_report(project: ProjectFolder, tick: Tick = no_tick, clip: Clip | None = None) -> Path:
    """Answer all questions of a project again and write its report.

    Parameters
    ----------
    project : ProjectFolder
        With a result; studies are those that ``homolog analyze`` kept.
    tick : Tick
        Progress and cancelling.
    clip : Clip, optional
        The plane that cuts the shapes of the figures open.

    Returns
    -------
    Path
        The page; the same as ``report.pdf`` and figures in ``figures`` lie beside it.

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
    details = read_details(project)
    carrier = SurfaceCarrier.of(result, directions_of(details, record))
    model = ShapeModel.fit(result.world, names=result.names)
    figures = list(model_figures(project, result, model, carrier, part_of(tick, 0.5, 0.6), clip))
    of = f": {details.structure}" if details.structure else ""
    page = Page(f"Shape analysis of {project.folder.resolve().name}{of}", f"{NOTICE} {_made(record)}")
    seeds = [read_spread(study_folder(project, request), record.fingerprint) for request in requests]
    _summary(page, record, result, studies, seeds, carrier, details)
    _model_section(page, folder, record, result, model, figures)
    add_correspondence(page, folder, correspondence_rows(project, record, result, carrier))
    for index, study in enumerate(studies):
        part = part_of(tick, 0.6 + 0.3 * index / len(studies), 0.6 + 0.3 * (index + 1) / len(studies))
        save_study(project, study, result, carrier)
        own = list(study_figures(study, carrier, part, clip))
        add_study(page, study, index + 1, result, carrier, own, seeds[index], studies[:index])
        figures += own
    tick(0.9, "writing the report")
    _add_landmarks(page, project)
    one_seed = any(len(seed_numbers(answers)) < 2 for answers in seeds)
    _closing(page, project, record, studies, figures, details, one_seed)
    for figure in figures:
        for suffix in ("svg", "pdf"):
            with atomic_write(folder / "figures" / f"{figure.name}.{suffix}") as part_file:
                write_picture(figure.figure, part_file)
    write_text(folder / "report.html", page.html)
    write_page(folder / "report.pdf", page)
    return folder / "report.html"


def _made(record: ResultRecord) -> str:
    finished = record.finished.replace("T", " ").replace("+00:00", " UTC")
    return f"Made with Homolog {record.versions.get('homolog', '')} from the result of {finished}."


def _summary(
    page: Page, record: ResultRecord, result: Result, studies: Sequence[Study],
    seeds: Sequence[Sequence[SeedAnswer]], carrier: SurfaceCarrier, details: ReportDetails,
) -> None:  # fmt: skip
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
    page.heading("Findings")
    if not studies:
        for text in outlier_text(result):
            page.caution(text)
        page.paragraph("No group comparison yet: run homolog analyze PROJECT --group COLUMN.")
    if studies:
        page.paragraph(
            "p values are corrected as the results of each study say; 95 % intervals (CI) are not corrected. "
            "A difference A - B is the mean of A minus that of B. Significant means p ≤ "
            f"{LEVEL:g} after correction."
        )
        _overview(page, studies)
    for number, (study, answers) in enumerate(zip(studies, seeds, strict=True), start=1):
        page.heading(f"Study {number}. {study.request.title}", 3)
        ranges = spread_by_comparison(answers)
        page.points(
            (
                finding.verdict,
                [
                    *_effects(study, comparison, finding, carrier),
                    ranges.get(comparison.title, "One seed of the correspondence."),
                ],
            )
            for finding, comparison in zip(findings(study), study.comparisons, strict=True)
        )
        for text in cautions(study):
            page.caution(text)


def _answer(study: Study) -> str:
    """Return what a study compares, in a word or two."""
    adjusted = ", adjusted" if study.request.covariates else ""
    return f"{NOUNS[study.request.alignment]}{adjusted}"


def _overview(page: Page, studies: Sequence[Study]) -> None:
    """Add a table of the main results of all studies."""
    rows = []
    for number, study in enumerate(studies, start=1):
        for comparison in study.comparisons:
            test, line = comparison.test, comparison.discriminant
            significant = comparison.p_fwe <= LEVEL
            area = 100.0 * study.areas[significant].sum() / max(study.areas.sum(), 1e-300)
            rows.append(
                (
                    f"{number} ({_answer(study)})",
                    comparison.title,
                    "–" if comparison.distance is None else effect_cell(study, comparison.distance),
                    p_number(comparison.p_adjusted, test.permutations) if test.modes else "–",
                    f"{area:.1f}",
                    "–" if line is None else interval_cell(line.accuracy, 0, 100.0),
                )
            )
    page.table(
        ["study", "comparison", "D (SD, 95 % CI)", "p of the whole shape", "significant area (%)",
         "balanced accuracy (%, 95 % CI)"],
        rows,
        omit="–",
        caption="Main results (all p corrected)",
    )  # fmt: skip
    page.paragraph(
        "D is the Mahalanobis distance of the group means, of three and more groups their root mean square "
        "distance from the common mean, of a regression the change per unit."
    )


def _in_order(groups: Sequence[str | None], studies: Sequence[Study]) -> list[str | None]:
    """Return the different groups, in the order of the first study of them."""
    compared = [group for study in studies for group in study.request.between]
    there = list(dict.fromkeys([*compared, *reference_first(filter(None, groups)), *groups]))
    return [group for group in there if group in groups]


def _effects(
    study: Study, comparison: Comparison, finding: Finding, carrier: SurfaceCarrier
) -> tuple[str, ...]:
    """Return the sentences of a finding, with some on the largest region after that on particles."""
    regions = significant_regions(study, comparison, carrier)
    if not regions:
        return finding.effects
    region = regions[0]
    count = "One region" if len(regions) == 1 else f"{len(regions)} regions, the largest"
    per = f" per unit of {study.request.column}" if study.request.kind == "regression" else ""
    on_wall = f" of the {region.wall}" if region.wall else ""
    digits = digits_of(study, region.outward.high - region.outward.low) - (0 if per else 1)
    if len(region.particles) == 1:
        largest = f"{count}: {region.area:.0f} mm²{on_wall}, {region.place}"
    else:
        moves = _moves(region, region.mean_outward, digits, per)
        towards = "" if carrier.directions.are_named else "towards "
        largest = (
            f"{count}: {region.area:.0f} mm²{on_wall}, which moves outward by {moves}. Its peak is "
            f"{towards}{region.place}"
        )
    largest += f", where the surface moves outward by {_moves(region, region.outward, digits, per)}."
    inside, ways = comparison.p_fwe <= LEVEL, carrier.ways_at_particles(comparison)
    out, into, rest = (float(study.areas[inside & (ways == way)].sum()) for way in (1, -1, 0))
    largest += (
        f" Of the significant area {out:.0f} mm² clearly move out of the tissue, {into:.0f} mm² into it, and "
        f"{rest:.0f} mm² neither."
    )
    if abs(region.outward.value) < _MAINLY_ALONG * region.length:
        largest += f" The peak moves by {region.length:.{digits}f} mm{per}, mainly along the surface."
    return (*finding.effects[:2], largest, *finding.effects[2:])


_MAINLY_ALONG = 0.5
"""Share of a displacement below which its outward part counts as the smaller one."""


def _moves(region: Region, outward: Effect, digits: int, per: str) -> str:
    """Return how far and which way a surface moves: "+1.2 mm (95 % CI +0.3 to +2.1), out of the tissue"."""
    value, low, high = (f"{item:+.{digits}f}" for item in (outward.value, outward.low, outward.high))
    return f"{value} mm{per} (95 % CI {low} to {high}), {region.direction(outward)}"


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
    held_out = "" if record.source else "; it had taken part in the correspondence"
    page.paragraph(
        f"{len(result.names)} shapes, {pose_text(record)}. The mean surface has an area of {area:.0f} mm²; a "
        f"particle stands for {each:.3g} mm² of it on average, so that particles are about {each**0.5:.2g} "
        "mm apart. The modes below are those of all subjects; tests use modes of the subjects and the "
        "alignment of each comparison. The sign of a mode is arbitrary. Scores and standard deviations are "
        "root mean squares over the particles. For generalization each subject in turn was held out and "
        f"fitted with modes of the others{held_out}. Specificity was "
        "computed for some numbers of modes only."
    )
    small = [figure for figure in figures if figure.name in ("scree", "scores")]
    page.figures(small)
    for item in figures:
        if item not in small:
            page.figures([item])
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
    shares = zip(
        model.standard_deviations,
        model.explained_variance_ratio,
        model.explained_variance_ratio.cumsum(),
        strict=True,
    )
    page.table(
        ["mode", "standard deviation (mm rms)", "share (%)", "cumulative (%)"],
        (
            (str(mode), f"{deviation:.2f}", f"{100 * share:.1f}", f"{100 * total:.1f}")
            for mode, (deviation, share, total) in enumerate(shares, start=1)
        ),
        summary="All modes",
        caption="All modes",
    )


def _closing(
    page: Page,
    project: ProjectFolder,
    record: ResultRecord,
    studies: list[Study],
    figures: Sequence[ReportFigure],
    details: ReportDetails,
    one_seed: bool,
) -> None:
    page.heading("Methods")
    for paragraph in methods(record, studies):
        page.paragraph(paragraph)
    page.heading("For the authors to add", 3)
    add_missing(page, record, details, one_seed)
    page.heading("References", 3)
    for paragraph in references(record, studies):
        page.paragraph(paragraph)
    page.table(
        ["part", "setting", "value"],
        settings_rows(record, studies),
        as_text=True,
        summary="All settings",
        caption="All settings, by the names that the program's options have",
    )
    page.table(
        ["subject", "group", "notes"],
        ((subject.name, subject.group or "", "; ".join(subject.notes)) for subject in record.subjects),
        as_text=True,
        summary="All subjects",
        caption="All subjects",
    )
    page.heading("Files")
    page.links(["report.pdf"], "This page as PDF")
    vectors = [f"figures/{figure.name}.{suffix}" for figure in figures for suffix in ("svg", "pdf")]
    page.links(vectors, f"Figures as vector graphics ({len(vectors)} files)")
    tables = [
        f"../{path.relative_to(project.folder).as_posix()}"
        for study in studies
        for path in sorted(study_folder(project, study.request).glob("*.csv"))
    ]
    own = [
        name for name in ("quality.csv", "correspondence.csv") if (project.folder / "report" / name).is_file()
    ]
    tables = [*own, "../model/scores.csv", "../model/eigenvalues.csv", *tables]
    page.links(tables, f"Tables with the subjects' names ({len(tables)} files)")


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
        f"{landmark_text(errors)}. Each subject's landmarks were carried to each other subject by the "
        "thin-plate spline of the particles, put on the surface, and compared with that subject's own."
    )
    page.table(
        ["landmark", "mean (mm)", "median (mm)", "95th percentile (mm)", "largest (mm)"],
        (
            (name, *(f"{value:.2f}" for value in _figures(errors.errors[..., index])))
            for index, name in enumerate(errors.names)
        ),
    )


def _figures(errors: FloatArray) -> tuple[float, float, float, float]:
    there = errors[np.isfinite(errors)]
    median, high = np.quantile(there, [0.5, 0.95])
    return float(there.mean()), float(median), float(high), float(there.max())
