"""The first page of a report: the main results in one table and a few sentences, and cautions."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from homolog.comparison.answer import Answer
from homolog.comparison.findings import (
    LEVEL,
    NOUNS,
    covariate_interval,
    covariate_size,
    covariate_unit,
    verdict_of,
)
from homolog.comparison.places import Region, SurfaceCarrier, significant_regions
from homolog.comparison.seeds import SeedAnswer, median_answer, seed_numbers
from homolog.statistics.cautions import cautions_of, dispersion_caution, outlier_caution, p_number, p_text
from homolog.statistics.comparison import Comparison
from homolog.statistics.procrustes import Alignment
from homolog_app.report.methods import questions_of
from homolog_app.report.model_section import CorrespondenceRow
from homolog_app.report.page import Page
from homolog_app.report.study_section import digits_of, effect_cell, interval_cell

__all__ = ["add_main_results"]

_LITTLE = 0.5
"""Fraction of the smaller significant area; with less overlap two studies hardly agree on the location."""
_MAINLY_ALONG = 0.5
"""Fraction of a displacement below which its outward component counts as the smaller one."""
_MARK = "†"


def add_main_results(
    page: Page,
    studies: Sequence[Answer],
    seeds: Sequence[Sequence[SeedAnswer]],
    carrier: SurfaceCarrier,
    correspondence: Sequence[CorrespondenceRow],
    *,
    primary: bool,
) -> None:
    """Add the verdicts of all studies, cautions, the table of their main results, and remarks.

    The first study may be the primary one.
    """
    if roles := _role_text(studies, primary=primary):
        page.paragraph(roles)
    for number, (study, answers) in enumerate(zip(studies, seeds, strict=True), start=1):
        shown = [_shown(comparison, answers) for comparison in study.comparisons]
        subjects, _, verdict = verdict_of(study, shown[0]).partition(": ")
        text = f"{verdict[0].upper()}{verdict[1:]}" if study.pairwise else f"{subjects}: {verdict}"
        sentences = [text, *_sentences(study, shown, answers, carrier)]
        role = "" if not primary or len(studies) < 2 else "primary; " if number == 1 else "secondary; "
        page.paragraph(f"Study {number} ({role}{_answer(study)}). {' '.join(sentences)}")
    for text in _cautions(studies, correspondence):  # before the table: they belong on the first page
        page.caution(text)
    _table(page, studies, seeds)
    for text in _remarks(studies, [_with_intervals(answers) for answers in seeds]):
        page.paragraph(text)


def _role_text(studies: Sequence[Answer], *, primary: bool) -> str:
    """Return the roles of the studies and the consequences for p-values; an empty text for a single study."""
    if len(studies) < 2:
        return ""
    count = questions_of(studies)
    within = "within its question" if count == 1 else "within their questions"
    if primary:
        others, them = ("The others are", "them") if len(studies) > 2 else ("Study 2 is", "it")
        return (
            f"Study 1 was declared primary. {others} secondary: p-values are corrected {within} only, "
            f"which makes {them} exploratory."
        )
    if count == 1:
        return "No study was declared primary (homolog analyze --primary)."
    return (
        f"No study was declared primary (homolog analyze --primary). p-values are corrected {within}, not "
        f"for their number: without any effect, up to {100.0 * LEVEL * count:g} % of reports with {count} "
        f"questions would find one. Declare the primary study, or consider p ≤ {LEVEL / count:.2g} "
        "significant."
    )


def _answer(study: Answer) -> str:
    """Return a short description of what a study compares."""
    adjusted = f", adjusted for {', '.join(study.question.covariates)}" if study.question.covariates else ""
    remains = "; allometry remains" if study.question.alignment is Alignment.SIMILARITY else ""
    return f"{NOUNS[study.question.alignment]}{adjusted}{remains}"


def _shown(comparison: Comparison, answers: Sequence[SeedAnswer]) -> Comparison:
    """Return a comparison with the median p over the seeds, if there are several."""
    median = median_answer(answers, comparison.title)
    return comparison if median is None else replace(comparison, p_adjusted=median.p)


def _sentences(
    study: Answer, shown: Sequence[Comparison], answers: Sequence[SeedAnswer], carrier: SurfaceCarrier
) -> Iterator[str]:
    """Yield the pairs that differ, and the largest regions that hardly depend on the seed."""
    pairs = shown[1:]
    differ = [pair.title for pair in pairs if pair.p_adjusted <= LEVEL]
    if len(differ) == len(pairs) > 0:
        yield "All pairs differ as well."
    elif pairs:
        rest = ", ".join(pair.title for pair in pairs if pair.title not in differ)
        yield f"Of the pairs {', '.join(differ) or 'none'} differ; no difference can be shown of {rest}."
    where, unsure, nowhere = [], [], []
    for comparison, seen in zip(study.comparisons, shown, strict=True):
        if seen.p_adjusted <= LEVEL and not (comparison.p_fwe <= LEVEL).any():
            nowhere.append(comparison.title)
        regions = significant_regions(study, comparison, carrier)
        median = median_answer(answers, comparison.title)
        if regions and (len(regions[0].particles) == 1 or (median is not None and not median.percent > 0.0)):
            unsure.append(comparison.title)
        elif regions:
            where.append(_where(comparison.title, regions, study))
    if where:
        yield f"Largest regions, by the location of their peak: {'; '.join(where)}."
    if unsure:
        yield (
            f"No region can be claimed for {', '.join(unsure)}: only single particles are significant, or "
            "none with most seeds."
        )
    if nowhere:
        yield f"No particle is significant for {', '.join(nowhere)}."


def _where(title: str, regions: Sequence[Region], study: Answer) -> str:
    """Return the location and the direction of the largest region."""
    region = regions[0]
    per = f" per unit of {study.question.column}" if study.question.kind == "regression" else ""
    digits = digits_of(study, region.mean_outward.high - region.mean_outward.low) - (0 if per else 1)
    moves = f"mean {region.mean_outward.value:+.{digits}f} mm{per}, {region.direction(region.mean_outward)}"
    if region.mean_outward.low <= 0.0 <= region.mean_outward.high:
        along = abs(region.outward.value) < _MAINLY_ALONG * region.length
        moves = f"direction not determined{', mainly along the surface' if along else ''}"
    share = 100.0 * region.area / float(study.areas.sum())
    return f"{title} {region.where} ({share:.1f} % of the surface), {moves}"


def _with_intervals(answers: Sequence[SeedAnswer]) -> Sequence[SeedAnswer]:
    """Return the answers of all seeds; none if an earlier version stored them without intervals."""
    effects = [effect for answer in answers for effect in answer.effects if effect is not None]
    return answers if all(np.isfinite(effect.low) for effect in effects) else []


def _table(page: Page, studies: Sequence[Answer], seeds: Sequence[Sequence[SeedAnswer]]) -> None:
    older = [
        str(number)
        for number, answers in enumerate(seeds, start=1)
        if answers and not _with_intervals(answers)
    ]
    seeds = [_with_intervals(answers) for answers in seeds]
    rows = [
        _row(str(number), study, comparison, answers)
        for number, (study, answers) in enumerate(zip(studies, seeds, strict=True), start=1)
        for comparison in study.comparisons
    ]
    page.table(
        ["study", "comparison", "modes", "D (SD, 90 % CI)", "p", "area (%)", "accuracy (%, 95 % CI)",
         "p of accuracy"],
        rows,
        as_text=True,
        omit="–",
        caption="Main results of the whole shape; all p corrected",
    )  # fmt: skip
    sentences = []
    several = [str(number) for number, answers in enumerate(seeds, start=1) if len(seed_numbers(answers)) > 1]
    numbers = sorted({number for answers in seeds for number in seed_numbers(answers)})
    if several:
        sentences.append(
            f"With seeds {', '.join(map(str, numbers))} the placement of particles and the tests were "
            f"repeated: in Study {', '.join(several)} D, p, area, accuracy and bounds of intervals are each "
            "the median over the seeds of the correspondence (ranges: last table; of each seed: seeds.csv). "
            "Numbers of modes and all further results, including maps, are those of the first seed."
        )
    if older:
        sentences.append(
            f"Study {', '.join(older)}: values of the first seed; other seeds are in the last table, and "
            "their intervals "
            "after homolog analyze --seeds again."
        )
    if any(study.pairwise for study in studies):
        sentences.append("D from other numbers of modes, or of two and of all groups, can't be compared.")
    if any(_MARK in cell for row in rows for cell in row):
        sentences.append(f"{_MARK} Not reliable: groups differ in dispersion.")
    page.paragraph(" ".join(sentences))


def _row(name: str, study: Answer, comparison: Comparison, answers: Sequence[SeedAnswer]) -> tuple[str, ...]:
    """Return a row of the main results: medians over seeds, if there are several."""
    test, line, distance = comparison.test, comparison.discriminant, comparison.distance
    significant = comparison.p_fwe <= LEVEL
    area = 100.0 * float(study.areas[significant].sum()) / max(float(study.areas.sum()), 1e-300)
    p, accuracy, tested = comparison.p_adjusted, None, _accuracy_p(comparison, answers)
    permutations = 0 if line is None else line.accuracy.permutations
    if line is not None:
        accuracy = line.accuracy
    if (median := median_answer(answers, comparison.title)) is not None:
        distance, p, area, accuracy = median.distance, median.p, median.percent, median.accuracy
    mark = f" {_MARK}" if dispersion_caution(comparison.dispersion, comparison.counts) else ""
    return (
        name,
        "all groups" if study.pairwise and comparison is study.overall else comparison.title,
        str(test.modes),
        "–" if distance is None else effect_cell(study, distance) + mark,
        p_number(p, test.permutations) if test.modes else "–",
        f"{area:.1f}",
        "–" if accuracy is None else interval_cell(accuracy, 0, 100.0),
        "–" if tested is None else p_number(tested, permutations),
    )


def _accuracy_p(comparison: Comparison, answers: Sequence[SeedAnswer]) -> float | None:
    """Return the corrected p of the accuracy: the median over the seeds, if there are several."""
    median = median_answer(answers, comparison.title)
    if median is None:
        return comparison.accuracy_p_adjusted
    return None if median.accuracy is None else median.accuracy.p


def _remarks(studies: Sequence[Answer], seeds: Sequence[Sequence[SeedAnswer]]) -> Iterator[str]:
    """Yield remarks that the table does not show directly."""
    alike = [
        f"{comparison.title} (Study {number}, {p_text(tested)})"
        for number, (study, answers) in enumerate(zip(studies, seeds, strict=True), start=1)
        for comparison in study.comparisons
        for tested in [_accuracy_p(comparison, answers)]
        if tested is not None and _shown(comparison, answers).p_adjusted <= LEVEL < tested
    ]
    if alike:
        yield f"Means differ, but balanced accuracy is not shown to exceed chance: {', '.join(alike)}."
    apart = []
    for number, study in enumerate(studies, start=1):
        for other in range(number, len(studies)):
            again = studies[other]
            if again.question.alignment is study.question.alignment:
                apart += [
                    f"{title}, Study {number} and {other + 1} ({percent:.0f} %)"
                    for title, percent in _disagreements(study, again)
                ]
    if apart:
        yield (
            "The location is uncertain, because significant areas of unadjusted and adjusted studies hardly "
            f"overlap: {', '.join(apart)}."
        )
    effects = [
        f"Study {number}, {text}"
        for number, study in enumerate(studies, start=1)
        for text in _covariate_effects(study)
    ]
    if effects:
        yield f"Covariates: {'; '.join(effects)}."


def _covariate_effects(study: Answer) -> Iterator[str]:
    """Yield short descriptions of significant effects of covariates on the whole shape or on size."""
    for effect in study.overall.covariates:
        parts = []
        if effect.test.modes and effect.p_adjusted <= LEVEL:
            parts.append(f"whole shape {p_text(effect.p_adjusted, effect.test.permutations)}")
        size = covariate_size(effect)
        if size is not None and size.p is not None and size.p <= LEVEL and np.isfinite(size.value):
            measured = covariate_interval(size, f" mm{covariate_unit(effect)}")
            parts.append(f"size {measured}, {p_text(size.p, size.permutations)}, not corrected")
        if parts:
            yield f"{effect.title}: {', '.join(parts)}"


def _disagreements(study: Answer, other: Answer) -> Iterator[tuple[str, float]]:
    """Yield comparisons of two studies whose significant areas hardly overlap, and the overlap [%]."""
    others = {comparison.title: comparison.p_fwe <= LEVEL for comparison in other.comparisons}
    for comparison in study.comparisons:
        own, its = comparison.p_fwe <= LEVEL, others.get(comparison.title)
        if its is None or not own.any() or not its.any():
            continue
        smaller = min(float(study.areas[own].sum()), float(study.areas[its].sum()))
        shared = float(study.areas[own & its].sum()) / max(smaller, np.finfo(float).tiny)
        if shared < _LITTLE:
            yield comparison.title, 100.0 * shared


def _cautions(studies: Sequence[Answer], correspondence: Sequence[CorrespondenceRow]) -> Iterator[str]:
    """Yield the cautions of all studies, those on outliers and on dispersion once."""
    yield from _outliers(studies, correspondence)
    uneven = [
        f"{comparison.title} (Study {number}, "
        f"{p_text(comparison.dispersion.p, comparison.dispersion.permutations)})"
        for number, study in enumerate(studies, start=1)
        for comparison in study.comparisons
        if comparison.dispersion is not None
        and dispersion_caution(comparison.dispersion, comparison.counts)
    ]  # fmt: skip
    if uneven:
        yield (
            f"Covariances differ or change: {', '.join(uneven)}. There T², Λ, F, the intervals of D and ω², "
            "and any p of accuracy and AUC, can't be relied on; the tests of shape, particles and size "
            "hold."
        )
    further: dict[str, list[str]] = {}
    for number, study in enumerate(studies, start=1):
        for comparison in study.comparisons:
            above = {
                dispersion_caution(comparison.dispersion, comparison.counts),
                outlier_caution(
                    comparison.outliers, comparison.counts, study.names, comparison.without_outliers
                ),
            }
            for text in cautions_of(comparison, study.names):
                sentence = text.removeprefix(f"{comparison.title}: ")
                if sentence not in above:
                    further.setdefault(sentence, []).append(f"{comparison.title} (Study {number})")
        for note in study.notes:
            further.setdefault(note, []).append(f"Study {number}")
    for sentence, where in further.items():
        yield f"{', '.join(where)}: {sentence}"


def _outliers(studies: Sequence[Answer], correspondence: Sequence[CorrespondenceRow]) -> Iterator[str]:
    studies_of: dict[str, dict[int, list[str]]] = {}
    for number, study in enumerate(studies, start=1):
        for comparison in study.comparisons:
            for index in comparison.outliers.tolist():
                of_subject = studies_of.setdefault(study.names[index], {})
                of_subject.setdefault(number, []).append(comparison.title)
    for name, places in studies_of.items():
        where = ", ".join(f"Study {number} ({'; '.join(titles)})" for number, titles in places.items())
        rest = [str(number) for number in range(1, len(studies) + 1) if number not in places]
        others = f", not in Study {', '.join(rest)}" if rest else ""
        worst = ""
        if correspondence and max(correspondence, key=lambda row: row.surface_mean_mm).name == name:
            worst = " Its surface is the one that particles represent worst."
        yield (
            f"{name} is an outlier in {where}{others}.{worst} Check it before trusting any test; results "
            "without it follow."
        )
