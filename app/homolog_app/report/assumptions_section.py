"""The part of a study's report on what its tests assume, and what they find where there is nothing."""

from homolog.analysis.cautions import LEVEL, p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.null_simulation import WHOLE_SHAPE_F
from homolog_app.report.findings import p_text
from homolog_app.report.page import Page
from homolog_app.report.study import Study

__all__ = ["add_assumptions", "add_false_positives"]

_EXCHANGE = {
    "groups": "Permutation tests assume that without an effect {who} are exchangeable between groups.",
    "regression": "Permutation tests assume that without an effect subjects (their residuals) are "
    "exchangeable along the variable.",
    "pairs": "Permutation tests assume that without an effect the differences of pairs are symmetric about "
    "zero, so that their signs are exchangeable, and that pairs are independent of each other.",
}
_DISPERSION = {
    "groups": "Dispersion is the mean distance of subjects from the centroid of their group, root mean "
    "square over the particles, in the modes of the comparison. These modes and the alignment are the "
    "comparison's own, so that a group's value differs between comparisons. Dispersions are compared by "
    "permutation (PERMDISP).",
    "regression": "Whether dispersion changes with the variable is tested by permutation of the distances "
    "from the fitted shapes (PERMDISP).",
    "pairs": "",
}
_FAR = {
    "groups": "the subject's distance from {mean}, divided by the group's median distance",
    "regression": "the subject's distance from the shape fitted to its value",
    "pairs": "the distance of a pair's difference from the mean difference (the first of the pair is named)",
}
_EXCHANGED = {
    "groups": "The labels of the groups were permuted",
    "regression": "The values of the variable were permuted",
    "pairs": "The signs of the differences were drawn at random",
}


def add_assumptions(page: Page, study: Study) -> None:
    """Add what the tests assume, with dispersion, skewness and outliers of each comparison."""
    kind = study.request.kind
    page.heading("Assumptions", 3)
    adjusted = bool(study.request.covariates)
    who = "residuals (what covariates leave of subjects)" if adjusted else "subjects"
    sentences = [_EXCHANGE[kind].format(who=who), _DISPERSION[kind]]
    if any(comparison.size_skewness is not None for comparison in study.comparisons):
        sentences.append(
            "Skewness of size is tested by D'Agostino's test, that of shapes by the same test of the five "
            "leading modes (squared deviates summed), both within groups."
            if kind == "groups"
            else "Skewness of the differences of size is tested by D'Agostino's test, that of the "
            "differences of shape by the same test of their five leading modes (squared deviates summed)."
        )
    mean = "the shape fitted to it" if adjusted else "the mean of its group"
    sentences.append(
        "Outliers have r above median(r) + 5 x 1.4826 MAD(r) of all that are compared: MAD is the median "
        "absolute deviation, 1.4826 MAD the standard deviation of normal data, r "
        f"{_FAR[kind].format(mean=mean)}. No p of this table is corrected; F of dispersion is compared with "
        "its permutations and needs no degrees of freedom."
    )
    page.paragraph(" ".join(filter(None, sentences)))
    page.table(
        [
            "comparison", "modes", "dispersion (mm)", "F of dispersion", "p of dispersion",
            "skewness of size", "p of skewness of shapes", "outliers",
        ],
        [_row(study, comparison) for comparison in study.comparisons],
        as_text=True,
        omit="–",
        caption="Assumptions of the tests",
    )  # fmt: skip


def _row(study: Study, comparison: Comparison) -> tuple[str, ...]:
    dispersion, skewness = comparison.dispersion, comparison.size_skewness
    tested = ("–", "–", "–")
    if dispersion is not None:
        means = ", ".join(f"{name} {value:.2f}" for name, value in dispersion.by_group.items()) or "–"
        tested = (means, f"{dispersion.f:.2f}", p_number(dispersion.p, dispersion.permutations))
    return (
        comparison.title,
        str(comparison.test.modes),
        *tested,
        "–" if skewness is None else f"{skewness.value:.2f} ({p_text(skewness.p)})",
        "–" if skewness is None else p_number(skewness.shape_p),
        ", ".join(
            f"{study.names[index]} (r {far:.3f}; limit {comparison.outlier_limit:.3f})"
            for index, far in zip(comparison.outliers, comparison.outlier_distances, strict=True)
        )
        or "none",
    )


def add_false_positives(page: Page, study: Study) -> None:
    """Add the type I error rates of the null simulation, if there was one."""
    rows = [
        (
            comparison.title,
            test.test,
            f"{100 * test.rate:.1f}",
            f"{100 * test.low:.1f} – {100 * test.high:.1f}",
        )
        for comparison in study.comparisons
        for test in comparison.false_positives
    ]
    if not rows:
        return
    page.heading("Type I error rates on this cohort", 3)
    page.paragraph(
        f"{_EXCHANGED[study.request.kind]} {study.request.null_repeats} times, so that there is nothing to "
        "find, and tested without scaling of dispersions. Permutation tests then have a type I error rate of "
        "5 % by construction: their rows check the software and do not validate the comparison. The bounds "
        "of about one row in twenty miss its true rate by chance. The rows of F show whether normal "
        f"distributions may be assumed: {_f_verdict(study)} The table can't show what differences in "
        "dispersion do; see Assumptions."
    )
    page.table(
        ["comparison", "test", "type I error (%)", "95 % bounds"],
        rows,
        as_text=True,
        caption="Type I error rates where there is no effect",
    )


def _f_verdict(study: Study) -> str:
    """Return in which comparisons the rate of F of the whole shape is not 5 %."""
    off = [
        comparison.title
        for comparison in study.comparisons
        for test in comparison.false_positives
        if test.test == WHOLE_SHAPE_F and not test.low <= LEVEL <= test.high
    ]
    if not off:
        return "here all bounds of the F of whole shapes include 5 %."
    return (
        f"here the bounds of the F of whole shapes exclude 5 % in {'; '.join(off)}, so that p (F) is not to "
        "be used there."
    )
