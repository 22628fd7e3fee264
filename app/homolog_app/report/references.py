"""References of the methods that a report's studies used."""

from homolog.analysis.procrustes import Alignment
from homolog.files.records import ResultRecord
from homolog_app.report.study import Study

__all__ = ["references"]

_REFERENCES = {
    "program": "Homolog contributors. Homolog, version {}: a program for statistical shape analysis. 2026.",
    "geodesic": (
        "Datar M, Gur Y, Paniagua B, Styner M, Whitaker R. Geometric Correspondence for Ensembles of "
        "Nonregular Shapes. MICCAI 2011, LNCS 6892: 368-375. PMC3346950."
    ),
    "particles": (
        "Cates J, Fletcher PT, Styner M, Shenton M, Whitaker R. Shape modeling and analysis with "
        "entropy-based particle systems. IPMI 2007, LNCS 4584: 333-345."
    ),
    "procrustes": "Gower JC. Generalized Procrustes analysis. Psychometrika 1975; 40: 33-51.",
    "parallel": "Horn JL. A rationale and test for the number of factors. Psychometrika 1965; 30: 179-185.",
    "studentized": (
        "Welch BL. On the comparison of several mean values: an alternative approach. Biometrika 1951; 38: "
        "330-336. Brown MB, Forsythe AB. The small sample behavior of some statistics which test the "
        "equality of several means. Technometrics 1974; 16: 129-132. Chung E, Romano JP. Exact and "
        "asymptotically robust permutation tests. Ann Stat 2013; 41: 484-507. Alekseyenko AV. "
        "Multivariate Welch t-test on distances. Bioinformatics 2016; 32: 3552-3558."
    ),
    "hc2": (
        "MacKinnon JG, White H. Some heteroskedasticity-consistent covariance matrix estimators. J Econom "
        "1985; 29: 305-325."
    ),
    "dispersion": (
        "Anderson MJ. Distance-based tests for homogeneity of multivariate dispersions. Biometrics 2006; 62: "
        "245-253."
    ),
    "local": (
        "Westfall PH, Young SS. Resampling-based multiple testing. Wiley, 1993. Benjamini Y, Hochberg Y. "
        "Controlling the false discovery rate. J R Stat Soc B 1995; 57: 289-300."
    ),
    "freedman": (
        "Freedman D, Lane D. A nonstochastic interpretation of reported significance levels. J Bus Econ Stat "
        "1983; 1: 292-298."
    ),
    "holm": "Holm S. A simple sequentially rejective multiple test procedure. Scand J Stat 1979; 6: 65-70.",
    "distance": (
        "Reiser B. Confidence intervals for the Mahalanobis distance. Commun Stat Simul Comput "
        "2001; 30: 37-45."
    ),
    "explained": (
        "Steiger JH. Beyond the F test: effect size confidence intervals and tests of close fit in the "
        "analysis of variance and contrast analysis. Psychol Methods 2004; 9: 164-182."
    ),
    "mckeon": (
        "McKeon JJ. F approximations to the distribution of Hotelling's T0². Biometrika 1974; 61: 381-383."
    ),
    "discriminant": (
        "Ledoit O, Wolf M. A well-conditioned estimator for large-dimensional covariance matrices. J "
        "Multivar Anal 2004; 88: 365-411. DeLong ER, DeLong DM, Clarke-Pearson DL. Comparing the areas under "
        "two or more correlated receiver operating characteristic curves. Biometrics 1988; 44: 837-845. "
        "Newcombe RG. Interval estimation for the difference between independent proportions: comparison of "
        "eleven methods. Stat Med 1998; 17: 873-890."
    ),
}


def references(record: ResultRecord, studies: list[Study]) -> list[str]:
    """Return the references of what was done, the program's first."""
    named = ["program"]
    if not record.source:
        named += ["geodesic", "particles"]
    comparisons = [comparison for study in studies for comparison in study.comparisons]
    requests = [study.request for study in studies]
    if any(request.alignment is not Alignment.AS_IT_LIES for request in requests):
        named.append("procrustes")
    if any(request.modes is None for request in requests):
        named.append("parallel")
    named += ["studentized", "local"] if comparisons else []
    if any(request.covariates or request.kind == "regression" for request in requests):
        named.append("hc2")
    if any(request.covariates for request in requests):
        named.append("freedman")
    if any(comparison.dispersion is not None for comparison in comparisons):
        named.append("dispersion")
    if any(study.pairwise for study in studies):
        named += ["holm", "mckeon"]
    if any(comparison.distance is not None for comparison in comparisons):
        named += ["distance", "explained"]
    if any(comparison.discriminant is not None for comparison in comparisons):
        named.append("discriminant")
    return [_REFERENCES[item].format(record.versions.get("homolog", "")) for item in named]
