"""Writing the report of a project: the page, its figures as vector graphics, and the studies' tables."""

from collections.abc import Sequence
from math import floor, isfinite, log10
from pathlib import Path

from homolog.analysis.comparison import Comparison
from homolog.analysis.shape_model import ShapeModel
from homolog.errors import InputError
from homolog.files.atomic import atomic_write, write_text
from homolog.files.project import ProjectFolder
from homolog.files.records import ResultRecord
from homolog.files.results import Result, read_result
from homolog.files.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog_app.clipping import Clip
from homolog_app.pictures import write_picture
from homolog_app.report import NOTICE
from homolog_app.report.figures import ReportFigure, model_figures, quality_rows, study_figures
from homolog_app.report.findings import (
    LEVEL,
    cautions,
    correction_words,
    findings,
    interval_words,
    outlier_words,
    p_words,
    percent_words,
    region_words,
)
from homolog_app.report.keep import keep_study
from homolog_app.report.landmarks import write_landmarks
from homolog_app.report.methods import methods, references, settings_rows
from homolog_app.report.page import Page
from homolog_app.report.regions import significant_regions
from homolog_app.report.request import read_requests, study_folder
from homolog_app.report.seeds import read_spread, spread_words
from homolog_app.report.sheets import write_page
from homolog_app.report.study import SHAPE_SIZE, Study, run_study
from homolog_app.report.surface_maps import SurfaceCarrier
from homolog_app.report.tables import sample_rows

__all__ = ["write_report"]


def write_report(project: ProjectFolder, tick: Tick = no_tick, clip: Clip | None = None) -> Path:
    """Answer all of a project's questions anew and write its report.

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
    carrier = SurfaceCarrier.of(result)
    model = ShapeModel.fit(result.world, names=result.names)
    figures = list(model_figures(project, result, model, carrier, part_of(tick, 0.5, 0.6), clip))
    page = Page(f"Shape analysis of {project.folder.resolve().name}", f"{NOTICE} {_made(record)}")
    _summary(page, record, result, studies)
    _model_section(page, folder, result, model, figures)
    for index, study in enumerate(studies):
        part = part_of(tick, 0.6 + 0.3 * index / len(studies), 0.6 + 0.3 * (index + 1) / len(studies))
        keep_study(project, study, result, carrier)
        own = list(study_figures(study, carrier, part, clip))
        _study_section(
            page, study, result, carrier, own, (study_folder(project, study.request), record.fingerprint)
        )
        figures += own
    tick(0.9, "writing the report")
    write_landmarks(page, project)
    _closing(page, project, record, studies, figures)
    for figure in figures:
        for suffix in ("svg", "pdf"):
            with atomic_write(folder / "figures" / f"{figure.name}.{suffix}") as part_file:
                write_picture(figure.figure, part_file)
    write_text(folder / "report.html", page.html)
    write_page(folder / "report.pdf", page)
    return folder / "report.html"


def _made(record: ResultRecord) -> str:
    return f"Made with Homolog {record.versions.get('homolog', '')} from the result of {record.finished}."


def _summary(page: Page, record: ResultRecord, result: Result, studies: Sequence[Study]) -> None:
    groups = list(result.groups)
    counts = ", ".join(
        f"{groups.count(fromkey)} {fromkey or 'no group'}" for fromkey in dict.fromkeys(groups)
    )
    page.paragraph(
        f"{len(groups)} subjects{f' ({counts})' if any(groups) else ''} with {record.particles} "
        f"corresponding particles each; {record.metric} distances; surface: {record.surface_words}."
    )
    if record.excluded:
        page.paragraph(f"Excluded before the run: {len(record.excluded)}. {' '.join(record.excluded)}")
    if record.mirrored_words:
        names = ", ".join(subject.name for subject in record.subjects if subject.is_mirrored)
        page.paragraph(
            f"{record.mirrored_words}: {names}. Means, modes and differences are shown in the common frame."
        )
    page.heading("Findings")
    if not studies:
        for text in outlier_words(result):
            page.caution(text)
        page.paragraph("No study yet: homolog analyze PROJECT --group COLUMN.")
    for study in studies:
        page.heading(study.request.title, 3)
        page.points((finding.verdict, finding.numbers) for finding in findings(study))
        for text in cautions(study):
            page.caution(text)


def _mm(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _model_section(
    page: Page, folder: Path, result: Result, model: ShapeModel, figures: Sequence[ReportFigure]
) -> None:
    page.heading("Shape model")
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
        )
    deviations = model.standard_deviations / len(model.mean) ** 0.5
    shares = zip(
        deviations, model.explained_variance_ratio, model.explained_variance_ratio.cumsum(), strict=True
    )
    page.table(
        ["mode", "standard deviation (mm rms)", "share (%)", "cumulated (%)"],
        (
            (str(mode), f"{deviation:.2f}", f"{100 * share:.1f}", f"{100 * total:.1f}")
            for mode, (deviation, share, total) in enumerate(shares, start=1)
        ),
        summary="All modes",
    )


def _study_section(
    page: Page,
    study: Study,
    result: Result,
    carrier: SurfaceCarrier,
    figures: Sequence[ReportFigure],
    kept: tuple[Path, str],
) -> None:
    page.heading(f"Study: {study.request.title}")
    _sample(page, study, result)
    page.heading("Results", 3)
    correction = correction_words(study)
    page.paragraph(
        "Effects come with 95 % confidence intervals, which are not corrected for pairs or answers. "
        + (
            f"P-values of the whole shape, of particles and of the discriminant are {correction}; "
            "those of size are " + (f"{correction_words(study, size=True)}. " if study.pairwise else "not. ")
            if correction
            else "P-values are not corrected for other questions. "
        )
        + "p (F) assumes normal data and equal covariances and is not corrected."
    )
    page.table(_COLUMNS, (_row(study, comparison) for comparison in study.comparisons))
    _where(page, study, carrier)
    spread = spread_words(read_spread(*kept))
    page.paragraph(
        "The seed of the correspondence is part of the uncertainty. "
        + (" ".join(spread) or "Its share was not computed; homolog analyze --seeds 5 computes it.")
    )
    checks = [
        _check_row(study, comparison) for comparison in study.comparisons if comparison.dispersion is not None
    ]
    if checks:
        page.heading("Assumptions", 3)
        page.paragraph(
            "Permutation tests assume that without an effect subjects are exchangeable between groups (with "
            "covariates: their residuals). Equal dispersion is tested by the permuted distance to the "
            "centroid (PERMDISP), skewness of size by D'Agostino's test. Outliers have r above median(r) + "
            "7.4 MAD(r): r is the distance from the mean over the group's median distance, MAD the median "
            "absolute deviation."
        )
        page.table(
            ["comparison", "dispersion (mm)", "F", "p", "skewness of size", "outliers"], checks, as_text=True
        )
    for figure in figures:
        if figure.heading:
            page.heading(figure.heading, 3)
        page.figures([figure])
    false_positives = [
        (
            comparison.title,
            test.test,
            f"{100 * test.rate:.1f}",
            f"{100 * test.low:.1f} – {100 * test.high:.1f}",
        )
        for comparison in study.comparisons
        for test in comparison.false_positives
    ]
    if false_positives:
        page.heading("Type I error rates on this cohort", 3)
        page.paragraph(
            f"The labels were permuted {study.request.null_repeats} times, so that there is nothing to "
            "find. Permutation tests then have a type I error rate of 5 % by construction: their rows check "
            "the software and do not validate the comparison. The rows of F show whether "
            "normal distributions may be assumed. The table can't show what differences in dispersion do; "
            "see Assumptions."
        )
        page.table(["comparison", "test", "type I error (%)", "95 % bounds"], false_positives, as_text=True)


def _where(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add the regions where particles are significant."""
    per = f" per unit of {study.request.column}" if study.request.kind == "regression" else ""
    rows = [
        (
            comparison.title,
            f"{len(region.particles)}",
            f"{region.area:.0f}",
            region.place,
            f"{interval_words(region.outward)}, {region.direction}",
            f"{region.length:.2f}",
            f"{region.mean_outward:.2f}",
            _p(region.p, comparison.pointwise.permutations),
        )
        for comparison in study.comparisons
        for region in significant_regions(study, comparison, carrier)
    ]
    if not rows:
        return
    page.heading("Where", 3)
    page.paragraph(
        f"Connected regions of particles with family-wise p ≤ {LEVEL:g}, corrected. The peak is the "
        "particle with the largest studentized statistic. Outward is along the normal of the mean surface, "
        "positive out of the tissue. The position was tested in all directions: the interval of its outward "
        "part alone may hold zero. Intervals are of the peak by itself, not corrected over the surface; "
        "since the peak was chosen by its statistic, its effect is overestimated. Places follow the axes "
        "of the input files, from the middle of the mean shape: they are anatomical only if those are. On an "
        "inner surface (its normal points to the middle) into the tissue means a wider cavity."
    )
    page.table(
        [
            "comparison", "particles", "area (mm²)", "place of the peak",
            f"outward at the peak (mm{per}, 95 % CI)", f"displacement of the peak (mm{per})",
            f"mean outward (mm{per})", "corrected p at the peak",
        ],
        rows,
        as_text=True,
    )  # fmt: skip


_COLUMNS = (
    "comparison", "modes", "D, corrected for bias (95 % CI)", "studentized statistic", "p (permutation)",
    "p (corrected)",
    "T² or lambda", "F (degrees of freedom)", "p (F)", f"particles p ≤ {LEVEL:g}, corrected",
    "balanced accuracy (95 % CI)", "AUC (95 % CI)", "size (95 % CI)", "size p",
)  # fmt: skip


def _row(study: Study, comparison: Comparison) -> tuple[str, ...]:
    test, line, size = comparison.test, comparison.discriminant, comparison.size
    unit = f"mm per unit of {study.request.column}" if study.request.kind == "regression" else "mm"
    digits = 3 if study.request.kind == "regression" else 2
    return (
        comparison.title,
        str(test.modes),
        interval_words(comparison.distance, digits) if comparison.distance is not None else "–",
        f"{test.studentized:.2f}" if test.modes else "–",
        _p(test.p_permutation, test.permutations),
        _p(comparison.p_adjusted, test.permutations),
        f"T² {test.t_squared:.1f}" if test.t_squared is not None else f"Λ {test.wilks:.3f}",
        f"{test.f:.2f} ({test.dof[0]:g}, {test.dof[1]:.4g})" if test.modes else "–",
        _p(test.p),
        region_words(study, comparison),
        percent_words(line.accuracy) if line is not None else "–",
        interval_words(line.auc) if line is not None else "–",
        f"{interval_words(size)} {unit}" if size is not None and isfinite(size.value) else "–",
        _p(comparison.size_p_adjusted, size.permutations)
        if size is not None and comparison.size_p_adjusted is not None
        else "–",
    )


def _p(p: float, permutations: int | None = None) -> str:
    return p_words(p, permutations).removeprefix("p ").removeprefix("= ")


def _check_row(study: Study, comparison: Comparison) -> tuple[str, ...]:
    dispersion, skewness = comparison.dispersion, comparison.size_skewness
    assert dispersion is not None
    mean = (
        ", ".join(f"{name} {value:.2f}" for name, value in dispersion.by_group.items())
        or "along the variable"
    )
    return (
        comparison.title,
        mean,
        f"{dispersion.f:.2f}",
        _p(dispersion.p, dispersion.permutations),
        "–" if skewness is None else f"{skewness.value:.2f} ({p_words(skewness.p)})",
        ", ".join(study.names[index] for index in comparison.outliers) or "none",
    )


def _mean_words(mean: float, spread: float) -> str:
    """Return mean and standard deviation with the same decimals, three digits of the latter."""
    size = spread or abs(mean)
    decimals = max(0, 2 - floor(log10(size))) if size else 0
    return f"{mean:.{decimals}f} ± {spread:.{decimals}f}"


def _sample(page: Page, study: Study, result: Result) -> None:
    page.heading("Sample", 3)
    page.table(
        ["group", "variable", "n", "mean ± SD"],
        (
            (
                group,
                f"{variable} {category}".strip() + (" (mm)" if variable == SHAPE_SIZE else ""),
                str(count),
                "–" if mean is None or spread is None else _mean_words(mean, spread),
            )
            for group, variable, category, count, mean, spread in sample_rows(study, result)
        ),
        as_text=True,
    )
    gone = [f"{name} ({why})" for name, why in study.left_out.items()]
    excluded = f"Not compared: {len(gone)} of {len(result.names)} subjects. {', '.join(gone)}"
    page.paragraph(excluded if gone else "All subjects were compared.")


def _closing(
    page: Page,
    project: ProjectFolder,
    record: ResultRecord,
    studies: list[Study],
    figures: Sequence[ReportFigure],
) -> None:
    page.heading("Methods")
    for paragraph in methods(record, studies):
        page.paragraph(paragraph)
    page.heading("References", 3)
    for paragraph in references(record, studies):
        page.paragraph(paragraph)
    page.table(
        ["part", "setting", "value"], settings_rows(record, studies), as_text=True, summary="All settings"
    )
    page.table(
        ["subject", "group", "notes"],
        ((subject.name, subject.group or "", "; ".join(subject.notes)) for subject in record.subjects),
        as_text=True,
        summary="All subjects",
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
    own = ["quality.csv"] if (project.folder / "report" / "quality.csv").is_file() else []
    tables = [*own, "../model/scores.csv", "../model/eigenvalues.csv", *tables]
    page.links(tables, f"Tables with the subjects' names ({len(tables)} files)")
