"""Cautions about a comparison, identical in every interface."""

from collections.abc import Mapping, Sequence
from math import ceil, log10
from typing import TYPE_CHECKING

from homolog.arrays import IntArray
from homolog.statistics.assumptions import Dispersion, SizeSkewness
from homolog.statistics.randomization import LEVEL

if TYPE_CHECKING:
    from homolog.statistics.comparison import Comparison

__all__ = [
    "LEVEL",
    "caution_sentences",
    "cautions_of",
    "dispersion_caution",
    "outlier_caution",
    "p_number",
    "p_text",
    "size_caution",
]

_UNLIKE = 1.5
"""Ratio of two groups' dispersions, or of their numbers of subjects, that raises a caution."""


def cautions_of(comparison: "Comparison", names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Return the cautions about a comparison, in sentences.

    Parameters
    ----------
    comparison : Comparison
        The comparison; its pairs have cautions of their own.
    names : sequence of str, optional
        Names of all subjects; subject 1, 2 … by default.
    """
    return tuple(f"{comparison.title}: {sentence}" for sentence in caution_sentences(comparison, names))


def caution_sentences(comparison: "Comparison", names: Sequence[str] | None = None) -> tuple[str, ...]:
    """Return the cautions about a comparison without its title; see `cautions_of`."""
    of_size = comparison.reports_size and comparison.size is not None
    sentences = [
        *comparison.test.warnings,
        dispersion_caution(comparison.dispersion, comparison.counts),
        size_caution(comparison.size_skewness, comparison.counts) if of_size else "",
        outlier_caution(comparison.outliers, comparison.counts, names, comparison.without_outliers),
        *comparison.notes,
    ]
    return tuple(filter(None, sentences))


def dispersion_caution(dispersion: Dispersion | None, counts: Mapping[str, int]) -> str:
    """Return a caution if groups differ in dispersion, or it changes with the variable; empty otherwise."""
    if dispersion is None:
        return ""
    numbers = [counts[name] for name in dispersion.by_group]
    uneven = _unlike(numbers)
    if dispersion.p > LEVEL and not (uneven and dispersion.ratio >= _UNLIKE):
        return ""
    p = p_text(dispersion.p, dispersion.permutations)
    if not numbers:
        return (
            f"covariances change along the design ({p}). The tests of the whole shape, particles and size "
            "remain valid; T², F and the interval of D do not."
        )
    mean = ", ".join(f"{name} {value:.2f} mm" for name, value in dispersion.by_group.items())
    what = (
        "T², F, the intervals of D and ω² and the p-values of accuracy and AUC do not."
        if len(numbers) == 2
        else "Λ, F and the intervals of D and ω² of all groups together do not; those of a pair may be used "
        "where it gets no caution."
    )
    return (
        f"the groups differ in covariance (mean distance to the centroid: {mean}; {p})"
        f"{' and in number of subjects' if uneven else ''}. The tests of the whole shape, particles and size "
        f"remain valid; {what}"
    )


def size_caution(skewness: SizeSkewness | None, counts: Mapping[str, int]) -> str:
    """Return a caution if skewness of sizes or shapes affects the test of size; empty otherwise."""
    if skewness is None or min(skewness.p, skewness.shape_p) > LEVEL:
        return ""
    skewed = f"sizes are skewed (skewness {skewness.value:.1f}, {p_text(skewness.p)})"
    if skewness.p > LEVEL:
        skewed = f"shapes are skewed ({p_text(skewness.shape_p)}), and sizes may be skewed, too,"
    if not skewness.deviations:
        return f"differences of {skewed}. The test of size assumes symmetric differences without an effect."
    unlike = [
        word
        for word, values in (
            ("number of subjects", [counts[name] for name in skewness.deviations]),
            ("dispersion of size", list(skewness.deviations.values())),
        )
        if _unlike(values)
    ]
    if not unlike:
        return ""
    return (
        f"{skewed} and the groups differ in {' and '.join(unlike)}. The type I error rate of the test of "
        "size and its interval may then differ from the nominal ones, up to twice as large; compare "
        "logarithms or medians of size as well."
    )


def outlier_caution(
    outliers: IntArray,
    counts: Mapping[str, int],
    names: Sequence[str] | None = None,
    without: "Comparison | None" = None,
) -> str:
    """Return a caution that names the outliers of each group.

    It includes the test of the whole shape without them, if that is known.
    """
    if not len(outliers):
        return ""
    kind = next(iter(counts)) if len(counts) == 1 else ""
    who = ", ".join(f"subject {index + 1}" if names is None else names[index] for index in outliers)
    rest = ""
    if without is not None and without.test.modes:
        far, test = without.distance, without.test
        digits, unit = (3, "SD per unit") if kind == "all" else (2, "SD")
        effect = ""
        if far is not None:
            value, low, high = (f"{bound:.{digits}f}" for bound in (far.value, far.low, far.high))
            effect = f"D = {value} {unit} ({100.0 * far.level:.0f} % CI {low} to {high}), "
        p = p_text(without.p_adjusted, test.permutations)
        pronoun = "it" if len(outliers) == 1 else "them"
        rest = f" Without {pronoun}, the whole shape has {effect}{p}."
    outlying = "is an outlier" if len(outliers) == 1 else "are outliers"
    return (
        f"{who} {outlying}, {_FAR.get(kind, _FAR_FROM_GROUP)}. Check segmentation and particles before "
        f"trusting any test; p-values of F are unreliable with such subjects.{rest}"
    )


_FAR_FROM_GROUP = "far from the rest of the group"
_FAR = {
    "all": "far from the shape that the regression predicts",
    "pairs": "whose difference within the pair is far from the mean difference",
}
"""Descriptions of outliers in designs without groups, by the name of the only group."""


def p_text(p: float, permutations: int | None = None) -> str:
    """Return a p-value in publication style, such as ``"p = 0.034"`` or ``"p < 0.001"`` (see `p_number`)."""
    number = p_number(p, permutations)
    return f"p {number}" if number[0] in "<>" else f"p = {number}"


def p_number(p: float, permutations: int | None = None) -> str:
    """Return a p-value for a cell of a table, such as ``"0.034"`` or ``"< 0.001"``.

    Parameters
    ----------
    p : float
        The p-value.
    permutations : int, optional
        Number of permutations, which limits the number of digits.
    """
    if p < 0.001:
        return "< 0.001"
    digits = 3 if p < 0.0995 else 2
    if permutations is not None:
        digits = min(digits, max(1, ceil(log10(permutations + 1))))
    if round(p, digits) >= 1.0:
        return f"> {1.0 - 10.0**-digits:.{digits}f}"
    if round(p, digits) == 0.0:
        return f"< {10.0**-digits:.{digits}f}"
    return f"{p:.{digits}f}"


def _unlike(values: Sequence[float]) -> bool:
    return bool(values) and max(values) >= _UNLIKE * min(values)
