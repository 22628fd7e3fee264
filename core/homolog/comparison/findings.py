"""Findings in plain language: effects with intervals, then p-values."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from homolog.comparison.answer import Answer
from homolog.comparison.question import NOUNS
from homolog.io.results import Result
from homolog.statistics.assumptions import Dispersion, shape_outliers
from homolog.statistics.cautions import LEVEL, cautions_of, dispersion_caution, p_text
from homolog.statistics.comparison import Comparison
from homolog.statistics.effects import Effect, SizeVariance

__all__ = [
    "LEVEL", "NOUNS", "Finding", "cautions", "classified_text", "correction_text", "covariate_area",
    "covariate_interval", "covariate_sentences", "covariate_size", "covariate_unit", "dispersion_text",
    "findings", "group_dispersions", "interval_text", "outlier_text", "p_text", "percent_text",
    "region_text", "shown_variance", "shows_size", "size_variance_text", "verdict_of",
]  # fmt: skip


def interval_text(effect: Effect, digits: int = 2) -> str:
    """Return an estimate with its interval, such as ``"1.27 (90 % CI 0.41 to 2.02)"``."""
    value, low, high = (f"{item:.{digits}f}" for item in (effect.value, effect.low, effect.high))
    return f"{value} ({100.0 * effect.level:.0f} % CI {low} to {high})"


def percent_text(effect: Effect) -> str:
    """Return a percentage with its interval, such as ``"83 % (95 % CI 63 to 92 %)"``."""
    value, low, high = (f"{100.0 * item:.0f}" for item in (effect.value, effect.low, effect.high))
    return f"{value} % (95 % CI {low} to {high} %)"


def _statistics_text(comparison: Comparison, *, corrected: bool) -> str:
    """Return the tests of the whole shape with statistics, degrees of freedom and p-values, not corrected."""
    test = comparison.test
    noun = "mode" if test.modes == 1 else "modes"
    name = f"Wilks' lambda = {test.wilks:.3f}"
    if test.t_squared is not None:
        name = f"Hotelling's T² = {test.t_squared:.1f}"
    how = f"all {test.permutations + 1}" if test.exact else f"{test.permutations}"
    before = " before correction" if corrected else ""
    share = f", ω² = {interval_text(comparison.explained)}" if comparison.explained is not None else ""
    p = p_text(test.p_permutation, test.permutations)
    return (
        f"Randomization test of the whole shape ({how} randomizations): statistic {test.studentized:.2f}, "
        f"R² = {test.r_squared:.3f}, {p}{before}. In {test.modes} {noun} with "
        f"{shown_variance(comparison):.0f} % of the variance: {name}, "
        f"F({test.dof[0]:g}, {test.dof[1]:.4g}) = {test.f:.2f}, {p_text(test.p)}{share}."
    )


def group_dispersions(dispersion: Dispersion, unit: str = "") -> str:
    """Return the dispersion of each group with its interval, such as ``"NOR 3.11 (2.20 to 4.38), …"``."""
    cells = {name: f"{value:.2f}{unit}" for name, value in dispersion.by_group.items()}
    for name, own in dispersion.intervals.items():
        cells[name] += f" ({own.low:.2f} to {own.high:.2f})"
    return ", ".join(f"{name} {cell}" for name, cell in cells.items())


def dispersion_text(dispersion: Dispersion) -> str:
    """Return the dispersion of groups, or its change along a variable, with interval and p."""
    p = p_text(dispersion.p, dispersion.permutations)
    groups, effect = group_dispersions(dispersion, " mm"), dispersion.effect
    if effect is None:
        return f"{groups}, {p}"
    if groups:
        second, first = list(dispersion.by_group)[::-1]
        return f"{groups}; {second} / {first} = {interval_text(effect)}, {p}"
    value, low, high = (f"{item:+.3g}" for item in (effect.value, effect.low, effect.high))
    return f"{value} mm per unit (95 % CI {low} to {high}), {p}"


def correction_text(answer: Answer, *, overall: bool = False) -> str:
    """Return the correction of p-values for pairs of groups, or nothing; see `Answer.pairwise`."""
    if not answer.pairwise or overall:
        return ""
    return f"corrected for {len(answer.pairwise)} pairs of groups (Holm)"


def shows_size(answer: Answer) -> bool:
    """Return whether an answer reports size."""
    return answer.overall.reports_size


def shown_variance(comparison: Comparison) -> float:
    """Return the percentage of the variance that the tested modes explain."""
    eigenvalues = comparison.test.parallel.eigenvalues
    return 100.0 * float(eigenvalues[: comparison.test.modes].sum() / max(eigenvalues.sum(), 1e-300))


def classified_text(comparison: Comparison) -> str:
    """Return how many of each group were classified correctly, such as ``"8 of 10 A, 9.5 of 12 B"``."""
    if comparison.discriminant is None:
        return ""
    counts = zip(comparison.discriminant.right, comparison.counts.items(), strict=True)
    return ", ".join(f"{round(right, 1):g} of {count} {name}" for right, (name, count) in counts)


def region_text(answer: Answer, comparison: Comparison) -> str:
    """Return the extent of significance: particles, area, and percentage of the surface."""
    significant = comparison.p_fwe <= LEVEL
    if not significant.any():
        return f"none of {len(significant)} particles"
    area, whole = float(answer.areas[significant].sum()), float(answer.areas.sum())
    return (
        f"{np.count_nonzero(significant)} of {len(significant)} particles, {area:.{0 if area >= 10 else 1}f} "
        f"mm², {100.0 * area / max(whole, np.finfo(float).tiny):.1f} % of the surface"
    )


@dataclass(frozen=True, slots=True)
class Finding:
    """The results of a comparison.

    Attributes
    ----------
    verdict : str
        Summary in one sentence.
    effects : tuple of str
        Effects with their intervals and corrected p-values, in sentences: whole shape, particles,
        classification, size.
    details : tuple of str
        Statistics of the test of the whole shape, and the corrections of p-values.
    """

    verdict: str
    effects: tuple[str, ...]
    details: tuple[str, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """Effects and details."""
        return self.effects + self.details


def findings(answer: Answer) -> list[Finding]:
    """Return the findings of each comparison of a answer.

    *Significant* refers to the permutation test, corrected for pairs of groups.
    """
    return [
        Finding(verdict_of(answer, comparison), _effects(answer, comparison), _details(answer, comparison))
        for comparison in answer.comparisons
    ]


def outlier_text(result: Result) -> list[str]:
    """Return a warning if subjects lie far from all others."""
    far = [result.names[index] for index in shape_outliers(result.world)]
    if not far:
        return []
    verb = "lies" if len(far) == 1 else "lie"
    return [
        f"{', '.join(far)}: {verb} far from all other shapes. Check segmentation and particles before "
        "trusting any test; p-values of F are unreliable with such subjects."
    ]


def cautions(answer: Answer) -> list[str]:
    """Return the cautions of an answer."""
    raised = [
        caution for comparison in answer.comparisons for caution in cautions_of(comparison, answer.names)
    ]
    return [*raised, *answer.notes]


def covariate_sentences(answer: Answer) -> Iterator[str]:
    """Yield a sentence on each covariate of a answer."""
    for effect in answer.overall.covariates:
        test = effect.test
        whole = "no mode exceeds chance"
        if test.modes:
            far = (
                ""
                if effect.distance is None
                else f"D = {covariate_interval(effect.distance, f' SD{covariate_unit(effect)}')}, "
            )
            whole = f"{far}whole shape {p_text(effect.p_adjusted, test.permutations)}"
        inside = int(np.count_nonzero(effect.p_fwe <= LEVEL))
        yield (
            f"Covariate {effect.title}: {whole}; {inside} of {len(effect.p_fwe)} particles, "
            f"{covariate_area(answer, effect):.1f} % of the surface, are significant"
            f"{_covariate_size_text(effect)}."
        )


def covariate_size(effect: Comparison) -> Effect | None:
    """Return the effect on size; None if it is not reported."""
    return effect.size if effect.reports_size else None


def _covariate_size_text(effect: Comparison) -> str:
    """Return the effect on size with its p-value; an empty text if size is not reported."""
    size = covariate_size(effect)
    if size is None or size.p is None or not np.isfinite(size.value):
        return ""
    measured = covariate_interval(size, f" mm{covariate_unit(effect)}")
    return f"; size alone {measured}, {p_text(size.p, size.permutations)}"


def covariate_unit(effect: Comparison) -> str:
    """Return ``" per unit"`` for the effect of a number, an empty text for a difference of categories."""
    several = effect.pointwise.effect.shape[0] > 1
    return "" if several or " - " in effect.title else " per unit"


def covariate_area(answer: Answer, effect: Comparison) -> float:
    """Return the percentage of the surface on which a covariate's effect is significant."""
    inside = float(answer.areas[effect.p_fwe <= LEVEL].sum())
    return 100.0 * inside / max(float(answer.areas.sum()), np.finfo(float).tiny)


def covariate_interval(effect: Effect, unit: str) -> str:
    """Return a covariate's effect with its interval, to three digits."""
    bounds = (effect.value, effect.low, effect.high)
    value, low, high = ("0" if bound == 0.0 else f"{bound:#.3g}".rstrip(".") for bound in bounds)
    if not unit:
        return f"{value} ({low} to {high})"
    return f"{value}{unit} ({100.0 * effect.level:.0f} % CI {low} to {high})"


_NOTHING = {
    ("groups", False): "no difference in {} can be shown",
    ("groups", True): "no difference of the whole {} can be shown, but {} of {} particles differ",
    ("regression", False): "no change of {} with {} can be shown",
    ("regression", True): "no change of the whole {} with {} can be shown, but {} of {} particles change",
}
"""Texts if there is no effect on the whole shape: without and with significant particles."""


def verdict_of(answer: Answer, comparison: Comparison) -> str:
    """Return a summary of a comparison in one sentence."""
    noun = NOUNS[answer.question.alignment]
    significant = comparison.p_adjusted <= LEVEL
    inside = int(np.count_nonzero(comparison.p_fwe <= LEVEL))
    local, counted = inside > 0, (inside, len(comparison.p_fwe))
    who = ", ".join(f"{count} {name}" for name, count in comparison.counts.items())
    if answer.question.kind == "regression":
        column = answer.question.column
        nothing = _NOTHING["regression", local].format(noun, column, *counted)
        verdict = f"{noun} changes with {column}" if significant else nothing
        return f"{comparison.title} ({comparison.counts['all']} subjects): {verdict}."
    if len(comparison.counts) > 2:
        verdict = (
            f"the groups differ in {noun}"
            if significant
            else _NOTHING["groups", local].format(noun, *counted)
        )
        return f"{who}: {verdict}."
    verdict = f"they differ in {noun}" if significant else _NOTHING["groups", local].format(noun, *counted)
    return f"{comparison.title} ({who}): {verdict}."


_DISTANCES = {
    "several": "Root mean square Mahalanobis distance of the groups' means from their common mean D = {} SD, "
    "corrected for bias",
    "groups": "Mahalanobis distance of the group means D = {} SD, corrected for bias",
    "pairs": "Mean difference of the pairs D = {} SD of the differences, corrected for bias",
    "regression": "Change per unit of {column}: {} SD, corrected for bias",
}


def _effects(answer: Answer, comparison: Comparison) -> tuple[str, ...]:
    test, kind, column = comparison.test, answer.question.kind, answer.question.column
    if test.modes:
        p = p_text(comparison.p_adjusted, test.permutations)
        sentence = f"Whole shape: {p}."
        if comparison.distance is not None:
            interval = interval_text(comparison.distance, 3 if kind == "regression" else 2)
            several = "several" if len(comparison.counts) > 2 else kind
            sentence = f"{_DISTANCES[several].format(interval, column=column)}; whole shape {p}."
    else:
        sentence = "No mode exceeds chance (parallel analysis); the whole shape was not tested."
    sentences = [
        sentence,
        f"Locally significant: {region_text(answer, comparison)} (p ≤ {LEVEL:g}, "
        f"{_local_correction(answer, comparison)}).",
    ]
    if comparison.discriminant is not None:
        separation = comparison.discriminant
        accuracy = _tested(comparison.accuracy_p_adjusted, separation.accuracy)
        auc = _tested(comparison.auc_p_adjusted, separation.auc)
        sentences.append(
            "Cross-validated linear discriminant: balanced accuracy "
            f"{percent_text(separation.accuracy)}{accuracy} (correct on average: "
            f"{classified_text(comparison)}), AUC {interval_text(separation.auc)}{auc}."
        )
    if dispersion_caution(comparison.dispersion, comparison.counts) and len(comparison.counts) == 2:
        sentences.append(
            "The interval of D and the p-values of accuracy and AUC assume equal dispersion, which these "
            "groups do not have."
        )
    size = _size_text(answer, comparison) if shows_size(answer) else []
    return (*sentences, *size, *(covariate_sentences(answer) if comparison is answer.overall else ()))


def _local_correction(answer: Answer, comparison: Comparison) -> str:
    """Return the corrections of the particles' p-values."""
    parts = ["the surface"]
    if comparison in answer.pairwise:
        parts.append(f"{len(answer.pairwise)} pairs")
    return (
        f"corrected over {', '.join(parts[:-1])} and {parts[-1]}"
        if len(parts) > 1
        else ("corrected over the surface")
    )


def _details(answer: Answer, comparison: Comparison) -> tuple[str, ...]:
    overall = comparison is answer.overall
    correction = correction_text(answer, overall=overall)
    statistics: tuple[str, ...] = ()
    if comparison.test.modes:
        statistics = (_statistics_text(comparison, corrected=bool(correction)),)
    if comparison.dispersion is not None:
        statistics += (f"Dispersion: {dispersion_text(comparison.dispersion)}.",)
    if not correction:
        return statistics
    tested = "whole shape and of particles"
    if comparison.discriminant is not None:
        tested = "whole shape, of particles and of the discriminant"
    size = ""
    if shows_size(answer) and comparison.size_p_adjusted is not None:
        size = f"; that of size is {correction_text(answer, overall=overall) or 'not corrected'}"
    return (*statistics, f"p-values of the {tested} are {correction}{size}.")


def _tested(p: float | None, effect: Effect) -> str:
    if p is None:
        return ""
    return f", permutation {p_text(p, effect.permutations)}"


def size_variance_text(between: SizeVariance) -> str:
    """Return F and the fraction of the variance of size that is between groups."""
    return (
        f"F({between.dof[0]:g}, {between.dof[1]:.3g}) = {between.f:.2f}, ω² = "
        f"{interval_text(between.omega_squared)}"
    )


def _size_text(answer: Answer, comparison: Comparison) -> list[str]:
    size, p = comparison.size, comparison.size_p_adjusted
    if size is None or p is None:
        return []
    sentence = p_text(p, size.permutations)
    if (between := comparison.size_variance) is not None:
        return [f"Size alone: {size_variance_text(between)}, {sentence}."]
    unit = f"mm per unit of {answer.question.column}" if answer.question.kind == "regression" else "mm"
    form = "+.3g" if answer.question.kind == "regression" else "+.2f"
    value, low, high = (format(bound, form) for bound in (size.value, size.low, size.high))
    larger = ""
    if answer.question.kind != "regression":
        first, second = answer.question.between if answer.question.kind == "pairs" else comparison.counts
        larger = f", {second if size.value > 0.0 else first} larger"
    relative = ""
    if (own := comparison.size_standardized) is not None and answer.question.kind != "regression":
        name = "Hedges' g" if answer.question.kind == "groups" else "standardized"
        relative = f"; {name} = {interval_text(own)}"
    return [f"Size alone: {value} {unit}{larger} (95 % CI {low} to {high}), {sentence}{relative}."]
