"""References that texts cite: ``[horn]`` in a text becomes the number of that reference."""

import re
from collections.abc import Sequence

__all__ = ["numbered"]

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
    "alekseyenko": (
        "Alekseyenko AV. Multivariate Welch t-test on distances. Bioinformatics 2016; 32: 3552-3558."
    ),
    "chung": (
        "Chung E, Romano JP. Exact and asymptotically robust permutation tests. Ann Stat 2013; 41: 484-507."
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

    Brackets around other words stay as they are.

    Parameters
    ----------
    texts : sequence of str
        ``[holm]`` and ``[reiser, steiger]`` cite.
    version : str
        Of the program.
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
