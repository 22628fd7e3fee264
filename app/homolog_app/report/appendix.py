"""The last parts of a report: definitions of its terms and quantities, and the references."""

import re
from collections.abc import Iterator, Sequence

from homolog.comparison.answer import Answer
from homolog.comparison.findings import LEVEL
from homolog.comparison.places import SurfaceCarrier
from homolog.comparison.sample import SHAPE_SIZE
from homolog.statistics.procrustes import Alignment
from homolog_app.report.study_section import axes_text

__all__ = ["definitions", "numbered"]


def definitions(
    studies: Sequence[Answer], carrier: SurfaceCarrier, *, confirmed: bool
) -> Iterator[tuple[str, str]]:
    """Yield the terms that the studies use, with their definitions.

    Parameters
    ----------
    studies : sequence of Study
        At least one.
    carrier : SurfaceCarrier
        Of the result.
    confirmed : bool
        Whether the authors have confirmed the axes.
    """
    yield from _of_answers(studies)
    yield from _of_places(carrier)
    yield "Places", axes_text(carrier, confirmed=confirmed)
    yield from _of_subjects(studies)


def _of_answers(studies: Sequence[Answer]) -> Iterator[tuple[str, str]]:
    """Yield the terms for comparisons and for effects on the whole shape."""
    kinds = {study.question.kind for study in studies}
    yield (
        "Answer, comparison",
        "A study answers one question for form or for shape; it compares two groups, all groups and each "
        "two of them, pairs, or values of a variable. A difference A - B is the mean of A minus that of B.",
    )
    similar = any(study.question.alignment is Alignment.SIMILARITY for study in studies)
    yield (
        "Form, shape, size",
        f"Form is size and shape. {SHAPE_SIZE}, or size, is the root mean square distance of a shape's "
        "particles from their centroid; standardized size is a difference or change of it divided by its "
        "standard deviation within groups or about the fit (of two groups Hedges' g)."
        + (
            " For shape, all are scaled to the cohort's mean size. Only isometric scaling is removed: shape "
            "that changes with size (allometry) remains. Its mm and mm² are those of the mean size."
            if similar
            else ""
        ),
    )
    yield (
        "p, significant",
        "p is that of randomization, two-sided (of accuracy and AUC one-sided), corrected as described in "
        f"the methods; significant is p ≤ {LEVEL:g}. Intervals (CI) are not corrected; those of "
        "D and ω², which can't be negative, are of 90 % [steiger]: they begin at 0 where F has p > 0.05.",
    )
    yield "D", " ".join(text for kind, text in _DISTANCE.items() if kind in kinds)
    yield (
        "ω²",
        "Fraction of the generalised variance in the tested modes that the groups, the variable or the mean "
        "difference explain, corrected for bias.",
    )
    yield (
        "Significant area",
        f"Area of the particles with p ≤ {LEVEL:g}, corrected over the surface (family-wise error), pairs "
        "and answers. A particle stands for the part of the mean surface of all subjects that is nearest "
        "to it, on the same side of a wall. The whole surface counts, of hollow shapes the inner and the "
        "outer side.",
    )


def _of_places(carrier: SurfaceCarrier) -> Iterator[tuple[str, str]]:
    """Yield the terms for the location and direction of differences."""
    yield (
        "Region, peak, outward",
        "A region is connected significant particles, its peak the one with the largest statistic. Outward "
        "is along the normal of the mean surface of the compared subjects, positive out of the tissue; its "
        "mean is over the region's area, with the mean of the particles' intervals, at least as wide as "
        "that of the mean. Positions are tested in all directions, so that an outward interval may contain "
        "zero: such area counts as neither out of the tissue nor into it. Where the peak moves much farther "
        "than its outward component, it moves along the surface, which on a smooth surface may be another "
        "distribution of points rather than of tissue: claim it only near edges and landmarks. Effects at "
        "peaks are overestimated, as peaks were chosen by their statistics.",
    )
    yield (
        "Maps",
        "Outward displacement on the mean shape of the compared subjects, blue out of the tissue, yellow "
        "into it, white neither, though points may move along the surface; grey where p is above "
        f"{LEVEL:g}. Colours of all maps of one quantity (of form, of shape, of one variable) end at the "
        "same value."
        + (
            " Outside views are named by the side from which the shape is seen; in inside views the near "
            "half is removed, and they are named by the visible wall."
            if carrier.is_hollow
            else ""
        ),
    )
    if carrier.is_hollow:
        yield (
            "Inner and outer surface, edge, wall",
            "The inner surface bounds the cavity, the outer surface faces away from it, and the edge of the "
            "opening lies between them. Differences in wall thickness are tested for the mean of the whole "
            "wall only; where both surfaces move out of the tissue, the wall is thicker. Mean wall "
            "thickness is the mean over a subject's surface of the distance to the opposite side (rays "
            "[shapira]).",
        )


def _of_subjects(studies: Sequence[Answer]) -> Iterator[tuple[str, str]]:
    """Yield the terms for the classification and the dispersion of subjects."""
    comparisons = [comparison for study in studies for comparison in study.comparisons]
    if any(comparison.discriminant is not None for comparison in comparisons):
        yield (
            "Balanced accuracy, AUC",
            "Balanced accuracy is the mean of the two groups' fractions of subjects that a cross-validated "
            "linear discriminant classifies correctly; the AUC is the probability that it ranks a subject of "
            "the second group above one of the first. Positions along the discriminant in figures are not "
            "cross-validated; bars are the groups' means.",
        )
    if any(comparison.dispersion is not None for comparison in comparisons):
        yield (
            "Dispersion, r",
            "Dispersion is the mean distance of subjects from their group's centroid or from the shape "
            "fitted to them, root mean square over the particles, in the comparison's own modes. r is a "
            "subject's distance divided by the median distance; outliers exceed its limit.",
        )


_DISTANCE = {
    "groups": "Mahalanobis distance of the group means in the retained modes, in standard deviations within "
    "groups (pooled covariance), corrected for bias; of all groups together the root mean square distance "
    "of their means from the common mean, weighted by numbers of subjects. Values from different modes, or "
    "from two groups and all groups, can't be compared.",
    "regression": "Length of the change per unit of the variable in the retained modes, in standard "
    "deviations of the residuals, corrected for bias.",
    "pairs": "Length of the mean difference of the pairs in the retained modes, in standard deviations of "
    "the differences, corrected for bias.",
}


_REFERENCES = {
    "homolog": "Homolog contributors. Homolog, version {}: a program for statistical shape analysis. 2026.",
    "datar": (
        "Datar M, Gur Y, Paniagua B, Styner M, Whitaker R. Geometric Correspondence for Ensembles of "
        "Nonregular Shapes. MICCAI 2011, LNCS 6892: 368-375. PMC3346950."
    ),
    "cates": (
        "Cates J, Fletcher PT, Styner M, Shenton M, Whitaker R. Shape modeling and analysis with "
        "entropy-based particle systems. IPMI 2007, LNCS 4584: 333-345."
    ),
    "gower": "Gower JC. Generalized Procrustes analysis. Psychometrika 1975; 40: 33-51.",
    "horn": "Horn JL. A rationale and test for the number of factors. Psychometrika 1965; 30: 179-185.",
    "welch": (
        "Welch BL. On the comparison of several mean values: an alternative approach. Biometrika 1951; 38: "
        "330-336."
    ),
    "wu": (
        "Wu CFJ. Jackknife, bootstrap and other resampling methods in regression analysis. Ann Stat 1986; "
        "14: 1261-1295."
    ),
    "davidson": ("Davidson R, Flachaire E. The wild bootstrap, tamed at last. J Econom 2008; 146: 162-169."),
    "cribari": (
        "Cribari-Neto F. Asymptotic inference under heteroskedasticity of unknown form. Comput Stat Data "
        "Anal 2004; 45: 215-233."
    ),
    "brown": (
        "Brown MB, Forsythe AB. The small sample behavior of some statistics which test the equality of "
        "several means. Technometrics 1974; 16: 129-132."
    ),
    "mackinnon": (
        "MacKinnon JG, White H. Some heteroskedasticity-consistent covariance matrix estimators. J Econom "
        "1985; 29: 305-325."
    ),
    "hotelling": "Hotelling H. The generalization of Student's ratio. Ann Math Stat 1931; 2: 360-378.",
    "wilks": "Wilks SS. Certain generalizations in the analysis of variance. Biometrika 1932; 24: 471-494.",
    "anderson": (
        "Anderson MJ. Distance-based tests for homogeneity of multivariate dispersions. Biometrics 2006; "
        "62: 245-253."
    ),
    "dagostino": (
        "D'Agostino RB. Transformation to normality of the null distribution of g1. Biometrika 1970; 57: "
        "679-681."
    ),
    "westfall": "Westfall PH, Young SS. Resampling-based multiple testing. Wiley, 1993.",
    "benjamini": (
        "Benjamini Y, Hochberg Y. Controlling the false discovery rate. J R Stat Soc B 1995; 57: 289-300."
    ),
    "freedman": (
        "Freedman D, Lane D. A nonstochastic interpretation of reported significance levels. J Bus Econ "
        "Stat 1983; 1: 292-298."
    ),
    "holm": "Holm S. A simple sequentially rejective multiple test procedure. Scand J Stat 1979; 6: 65-70.",
    "reiser": (
        "Reiser B. Confidence intervals for the Mahalanobis distance. Commun Stat Simul Comput 2001; 30: "
        "37-45."
    ),
    "steiger": (
        "Steiger JH. Beyond the F test: effect size confidence intervals and tests of close fit in the "
        "analysis of variance and contrast analysis. Psychol Methods 2004; 9: 164-182."
    ),
    "mckeon": (
        "McKeon JJ. F approximations to the distribution of Hotelling's T0². Biometrika 1974; 61: 381-383."
    ),
    "ledoit": (
        "Ledoit O, Wolf M. A well-conditioned estimator for large-dimensional covariance matrices. J "
        "Multivar Anal 2004; 88: 365-411."
    ),
    "wilson": (
        "Wilson EB. Probable inference, the law of succession, and statistical inference. J Am Stat Assoc "
        "1927; 22: 209-212."
    ),
    "newcombe": (
        "Newcombe RG. Interval estimation for the difference between independent proportions: comparison of "
        "eleven methods. Stat Med 1998; 17: 873-890."
    ),
    "auc": (
        "Newcombe RG. Confidence intervals for an effect size measure based on the Mann-Whitney statistic. "
        "Part 2: asymptotic methods and evaluation. Stat Med 2006; 25: 559-573."
    ),
    "hanley": (
        "Hanley JA, McNeil BJ. The meaning and use of the area under a receiver operating characteristic "
        "(ROC) curve. Radiology 1982; 143: 29-36."
    ),
    "shapira": (
        "Shapira L, Shamir A, Cohen-Or D. Consistent mesh partitioning and skeletonisation using the shape "
        "diameter function. Vis Comput 2008; 24: 249-259."
    ),
}
_CITED = re.compile(r"\[([a-z]+(?:, [a-z]+)*)\]")


def numbered(texts: Sequence[str], version: str) -> tuple[list[str], list[str]]:
    """Return texts with the numbers of the references that they cite, and those references in order.

    Brackets around other words are unchanged.

    Parameters
    ----------
    texts : sequence of str
        Texts with citations such as ``[holm]`` and ``[reiser, steiger]``.
    version : str
        Version of the program.
    """
    cited: list[str] = []

    def number(citation: re.Match[str]) -> str:
        keys = citation[1].split(", ")
        if not set(keys) <= set(_REFERENCES):
            return citation[0]
        cited.extend(key for key in keys if key not in cited)
        return f"[{', '.join(str(cited.index(key) + 1) for key in keys)}]"

    own = [_CITED.sub(number, text) for text in texts]
    return own, [f"{place}. {_REFERENCES[key].format(version)}" for place, key in enumerate(cited, start=1)]
