"""What was found, in plain language with its numbers."""

from dataclasses import dataclass

from homolog.analysis.comparison import Comparison
from homolog.analysis.null_simulation import WHOLE_SHAPE_F, WHOLE_SHAPE_PERMUTATION
from homolog.analysis.outliers import outlying
from homolog.files.results import Result
from homolog_app.report.study import Study

__all__ = [
    "LEVEL",
    "Finding",
    "cautions",
    "effect_words",
    "findings",
    "outlier_words",
    "p_words",
]

LEVEL = 0.05
"""Corrected p-values up to this are called significant."""

_LOOSE = 0.02
"""Excess of false alarms that is worth a warning."""


def p_words(p: float) -> str:
    """Return a p-value with two digits, such as ``"p = 0.034"``."""
    return f"p = {p:.2g}" if p >= 0.95e-4 else f"p = {p:.1e}"


def effect_words(comparison: Comparison) -> str:
    """Return the test of the whole shape with its statistic, degrees of freedom and p-values."""
    test = comparison.test
    if not test.modes:
        return "No mode above chance, p = 1"
    noun = "mode" if test.modes == 1 else "modes"
    name = f"Wilks' lambda = {test.wilks:.3f}"
    if test.t_squared is not None:
        name = f"Hotelling's T² = {test.t_squared:.1f}"
    return (
        f"{name} in {test.modes} {noun}, F({test.dof[0]:g}, {test.dof[1]:.4g}) = {test.f:.2f}, "
        f"{p_words(test.p)}; permutation {p_words(test.p_permutation)}"
    )


@dataclass(frozen=True, slots=True)
class Finding:
    """What a comparison shows, in a few words, and the numbers to it, in sentences."""

    verdict: str
    numbers: str


def findings(study: Study) -> list[Finding]:
    """Return what each comparison of a study shows.

    Significant is called what the permutation test, adjusted for the number of pairs of groups, calls so.
    """
    return [Finding(_verdict(study, one), _numbers(study, one)) for one in study.comparisons]


def outlier_words(result: Result) -> list[str]:
    """Return a warning if subjects lie far from all others."""
    far = [result.names[index] for index in outlying(result.world)]
    if not far:
        return []
    verb = "lies" if len(far) == 1 else "lie"
    return [
        f"{', '.join(far)}: {verb} far from all other shapes. Look at segmentation and particles before "
        "trusting "
        "any test; F distributions are wrong with such subjects."
    ]


def cautions(study: Study) -> list[str]:
    """Return what a reader should be careful about."""
    thin = [f"{one.title}: {warning}" for one in study.comparisons for warning in one.test.warnings]
    loose = [
        f"{one.title}: the F distribution raises false alarms in {100 * excess:.1f} % more of the "
        "relabellings than the permutation test; trust the latter."
        for one in study.comparisons
        if (excess := _excess(one)) > _LOOSE
    ]
    return thin + loose


def _excess(one: Comparison) -> float:
    """Return how much more often F than the permutation test raises false alarms, on the same relabellings.

    The permutation test is exact; both rates share the chance of which relabellings were drawn.
    """
    rates = {test.test: test.rate for test in one.false_alarms}
    return rates.get(WHOLE_SHAPE_F, 0.0) - rates.get(WHOLE_SHAPE_PERMUTATION, 0.0)


def _verdict(study: Study, one: Comparison) -> str:
    significant = one.p_adjusted <= LEVEL
    who = ", ".join(f"{count} {name}" for name, count in one.counts.items())
    if study.request.kind == "regression":
        verdict = "shape changes with it" if significant else "no change of shape with it can be shown"
        return f"{one.title} ({one.counts['all']} subjects): {verdict}."
    if len(one.counts) > 2:
        verdict = "the groups differ in shape" if significant else "no difference in shape can be shown"
        return f"{who}: {verdict}."
    verdict = "the shapes differ" if significant else "no difference in shape can be shown"
    return f"{one.title} ({who}): {verdict}."


def _numbers(study: Study, one: Comparison) -> str:
    words = [f"{effect_words(one)}{_adjusted(study, one)}."]
    if one.test.mahalanobis is not None and study.request.kind == "groups":
        words.append(f"The groups' means are {one.test.mahalanobis:.1f} standard deviations apart.")
    share = float((one.local.p_family <= LEVEL).mean())
    place = f"on {100 * share:.0f} % of the particles" if share else "at no single particle"
    words.append(f"Locally the effect is significant {place}, corrected over the surface.")
    if one.discriminant is not None:
        words.append(
            f"A discriminant tells the groups apart in {100 * one.discriminant.accuracy:.0f} % of left-out "
            f"subjects (AUC {one.discriminant.auc:.2f})."
        )
    words.append(_size_words(one, study.request.kind))
    return " ".join(words)


def _adjusted(study: Study, one: Comparison) -> str:
    if one in study.pairwise:
        return f", after Holm's correction for {len(study.pairwise)} pairs {p_words(one.p_adjusted)}"
    return ""


def _size_words(one: Comparison, kind: str) -> str:
    if len(one.size_effect) > 1:
        return f"Size alone: {p_words(one.size_p)}."
    unit = " mm per unit" if kind == "regression" else " mm"
    return f"Size alone: {one.size_effect[0]:+.2g}{unit}, {p_words(one.size_p)}."
