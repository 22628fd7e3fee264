"""Text on methods, with which the analysis can be repeated."""

from collections.abc import Iterator, Sequence

from homolog.comparison.answer import Answer
from homolog.comparison.findings import LEVEL, correction_text
from homolog.io.records import ResultRecord
from homolog.statistics.procrustes import Alignment
from homolog_app.report.model_section import model_methods

__all__ = ["least_text", "methods", "questions_of"]


def methods(record: ResultRecord, studies: list[Answer]) -> list[str]:
    """Return paragraphs for the methods section of a paper: model, common methods of studies, each study.

    Citations are the keys of `homolog_app.report.appendix.numbered`.
    """
    sentences = [_statistics(study) for study in studies]
    shared = [text for text in sentences[0] if all(text in each for each in sentences)] if studies else []
    if (count := questions_of(studies)) > 1:
        shared.append(
            f"The studies ask {count} questions; p-values were corrected within each question, for pairs and "
            "for its studies of form and shape, not for the number of questions."
        )
    titles = [f"Study {number}: {study.question.title}." for number, study in enumerate(studies, start=1)]
    own = _own_sentences([[text for text in each if text not in shared] for each in sentences])
    texts = (*model_methods(record), " ".join(shared), " ".join(titles), *own)
    return [text for text in texts if text]


def questions_of(studies: Sequence[Answer]) -> int:
    """Return the number of questions of studies; form and shape of the same question count once."""
    rigid = {"alignment": Alignment.RIGID}
    return len({study.question.model_copy(update=rigid).identity for study in studies})


def _own_sentences(sentences: list[list[str]]) -> list[str]:
    """Return each sentence once, in paragraphs by the studies to which it applies."""
    studies_of: dict[str, list[str]] = {}
    for number, own in enumerate(sentences, start=1):
        for sentence in dict.fromkeys(own):
            studies_of.setdefault(sentence, []).append(str(number))
    paragraphs: dict[str, list[str]] = {}
    for sentence, numbers in studies_of.items():
        paragraphs.setdefault(f"Study {', '.join(numbers)}:", []).append(sentence)
    return [" ".join([start, *own]) for start, own in paragraphs.items()]


def _size_of_groups(study: Answer) -> list[str]:
    if study.overall.size_variance is None:
        return []
    f = "the F of the analysis of covariance" if study.question.covariates else "Welch's F"
    return [
        f"The statistic for size of all groups together is {f}.",
        "The ω² of size is the fraction of its variance between the groups, estimated from that F, "
        "with bounds from the noncentral F distribution.",
    ]


_ALIGNED = {
    Alignment.AS_IT_LIES: "Shapes were compared in their alignment after the run, without another one.",
    Alignment.RIGID: (
        "Shapes were aligned by generalized Procrustes analysis [gower] without scaling, so that size and "
        "shape (form) were compared."
    ),
    Alignment.SIMILARITY: (
        "Shapes were aligned by generalized Procrustes analysis [gower] with scaling to the cohort's mean "
        "size, so that shape was compared. Only isometric scaling was removed: shape that changes with size "
        "(allometry) remains."
    ),
}


def _statistics(study: Answer) -> list[str]:
    """Return the sentences on a study's tests."""
    sentences = [
        *_test_of_the_shape(study),
        _ALIGNED[study.question.alignment],
        "At every particle the position was tested by a Wald statistic b'V^-1 b, b being its effect in "
        "three directions and V the covariance of b that subjects show, as in the test of the whole "
        "shape; p-values were corrected over the surface by the null distribution of the largest "
        "statistic (family-wise error [westfall]); false discovery rates [benjamini] are in the tables.",
        _exchangeable(study),
        f"The level was alpha = {LEVEL:g}; tests are two-sided{_one_sided(study)}.",
        "Size is the root mean square distance of a shape's particles from their centroid; it was tested "
        "like the whole shape.",
        *_size_of_groups(study),
        f"95 % intervals of size and of displacements at particles {_intervals(study)}.",
        "Intervals of size and displacements are not corrected over the surface or for pairs.",
        *_adjustments(study),
        *_further_measures(study),
        *_discriminants(study),
    ]
    return sentences


def _intervals(study: Answer) -> str:
    if study.question.kind == "regression" or study.question.covariates:
        return "have HC4 standard errors [cribari]"
    return "are those of Student's t" if study.question.kind == "pairs" else "are those of Welch"


def _exchangeable(study: Answer) -> str:
    """Return the assumptions of the tests."""
    pairs = study.question.kind == "pairs"
    return (
        f"The tests assume independent {'pairs' if pairs else 'subjects'} and, without an effect, "
        f"{'differences' if pairs else 'residuals'} that are symmetric about zero; covariances may differ."
    )


def _one_sided(study: Answer) -> str:
    separated = any(comparison.discriminant is not None for comparison in study.comparisons)
    return ", those of accuracy and AUC one-sided" if separated else ""


def _test_of_the_shape(study: Answer) -> Iterator[str]:
    """Yield the comparison, its modes and its statistic."""
    request, first = study.question, study.overall
    modes = (
        f"the first {request.modes} modes (chosen beforehand)"
        if request.modes is not None
        else "the modes that Horn's parallel analysis [horn] of its subjects retained for each comparison "
        f"(variance above the 95th percentile of {first.test.parallel.repeats} data sets without correlation)"
    )
    names = f"{', '.join(request.between[:-1])} and {request.between[-1]}" if request.between else ""
    tested = {
        "groups": f"the groups {names} of the column {request.column!r} were compared",
        "regression": f"the linear effect of {request.column} was tested; effects are per unit of it",
        "pairs": f"{names} were compared in pairs by {request.pairs}, with random "
        "signs of the differences under the null",
    }[request.kind]
    yield f"{tested[0].upper()}{tested[1:]}."
    yield "The whole shape was tested on the coordinates of all particles, by randomization of residuals."
    yield from _statistic(study)
    yield _permutations(study)
    yield f"D and ω² were computed in {modes}."
    yield (
        "Hotelling's T² [hotelling] or Wilks' lambda [wilks] with the F distribution are also reported; "
        "they assume normal data and equal covariances and are not corrected."
    )


def _adjustments(study: Answer) -> Iterator[str]:
    """Yield adjustments and corrections of the tests."""
    request = study.question
    if request.covariates:
        yield (
            f"Shapes were adjusted for {', '.join(request.covariates)} by a linear model of each coordinate; "
            "residuals were randomized [freedman]. Each covariate was tested in the same way, adjusted for "
            "the study's own effect and the other covariates; p-values were not "
            "corrected for the number of covariates."
        )
    if request.complete_cases:
        partners = ", and those whose partner is missing," if request.pairs else ""
        yield f"Subjects with missing values{partners} were excluded (complete cases)."
    if correction := correction_text(study):
        size = correction_text(study)
        overall = correction_text(study, overall=True) or "not corrected"
        together = f"; those of all groups together were {overall}, their size not" if study.pairwise else ""
        two = " of two groups" if study.pairwise else ""
        yield (
            f"P-values of the {tested_text(study)} were {correction}{together}; p-values of size{two} were "
            f"{size or 'not corrected'}."
        )
        if study.pairwise:
            yield (
                "For particles, the pairs were put in the order of their smallest p corrected over the "
                f"surface; all p of the first were multiplied by {len(study.pairwise)}, of the next by one "
                "less, and so on (Holm [holm] over surfaces)."
            )
    else:
        yield "P-values were not corrected for other questions."
    yield f"The tests of the {tested_text(study, 'of size')} were not corrected for each other."


def _further_measures(study: Answer) -> Iterator[str]:
    """Yield the tests of dispersion and the correction of distances."""
    request = study.question
    if study.overall.dispersion is not None:
        yield (
            "Equality of covariances was tested by the products of residual scores in the retained modes, "
            "divided by the distance from the fitted shape [anderson]: residuals were permuted, and the "
            "model fitted to them again "
            f"({study.overall.dispersion.permutations} permutations, p not corrected). Intervals of "
            f"dispersions {_JACKKNIFE[request.kind]} come from the jackknife."
        )
        yield (
            f"Distances in the test of dispersion are those to {_centre(study)}, divided by the root of 1 - "
            "leverage."
        )
    if any(comparison.size_skewness is not None for comparison in study.comparisons):
        yield (
            "Skewness of size was tested by D'Agostino's test [dagostino], that of shapes by the same test "
            "of the five leading modes (squared deviates summed), both "
            f"{'within groups' if request.kind == 'groups' else 'of the differences'}."
        )
    yield (
        f"Outliers are {_FAR[request.kind]} exceeds median(r) + 5 x 1.4826 MAD(r), MAD being the median "
        "absolute deviation."
    )
    if any(comparison.distance is not None for comparison in study.comparisons):
        several = _OF_SEVERAL * bool(study.pairwise)
        yield (
            f"{_DISTANCES[request.kind]}{several} and the explained fraction of the generalised variance "
            "(ω², from Wilks' lambda) were corrected for bias; their intervals come from the noncentral F "
            "distribution [reiser, steiger], assume equal covariances and are not corrected for pairs."
        )


_FAR = {
    "groups": "subjects whose distance r from the mean of their group or the shape fitted to them, divided "
    "by the group's median distance,",
    "regression": "subjects whose distance r from the shape fitted to their value",
    "pairs": "pairs whose distance r of the difference from the mean difference",
}
_JACKKNIFE = {"groups": "and of their ratios", "regression": "along the variable", "pairs": ""}


def _centre(study: Answer) -> str:
    of_groups = study.question.kind == "groups" and not study.question.covariates
    return "their group's centroid" if of_groups else "the shape fitted to them"


_OF_SEVERAL = (
    ", and of all groups together the root mean square distance of their means from the common mean (from "
    "Hotelling and Lawley's trace [mckeon]),"
)
_DISTANCES = {
    "groups": "Mahalanobis distances of group means in the retained modes (D, in standard deviations within "
    "groups)",
    "regression": "Lengths of the change per unit in the retained modes (D, in standard deviations of the "
    "residuals)",
    "pairs": "Mean differences of pairs in the retained modes (D, in standard deviations of the differences)",
}


def _discriminants(study: Answer) -> Iterator[str]:
    fits = [
        comparison.discriminant for comparison in study.comparisons if comparison.discriminant is not None
    ]
    if not fits:
        return
    folds = " to ".join(str(item) for item in sorted({fit.folds for fit in fits}))
    yield (
        "The linear discriminant was computed in the retained modes with a shrunk covariance [ledoit]. "
        f"Balanced accuracy and area under the curve (AUC) come from {folds}-fold stratified "
        f"cross-validation, repeated {fits[0].repeats} times; in each fold, as many modes as the comparison "
        "retained and the direction were fitted without the held-out subjects. Both are means over the "
        "repeats. The interval of accuracy combines those of both groups' fractions [wilson, newcombe]; that "
        "of the AUC is Newcombe's method 5 [auc] with the variance of Hanley and McNeil [hanley] for the "
        "mean AUC and the numbers of both groups. They treat held-out subjects as independent; if interval "
        f"and p disagree, p is the test. The p-values of both come from {fits[0].auc.permutations} "
        f"permutations; the smallest possible uncorrected p is {1.0 / (fits[0].auc.permutations + 1):.2g}."
    )
    if study.question.covariates:
        yield "The effects of covariates were also fitted without the held-out subjects."


_RATIO = (
    "The statistic is the tested sum of squares divided by its expectation without an effect, estimated from "
    "each subject's own residual [brown, mackinnon]: Σ |t'y|² over the orthonormal tested columns t, divided "
    "by Σ w_i |r_i|², where y are the data with the other columns regressed out, r_i the residuals of the "
    "whole model, h_i their leverages, and w_i = Σ t_i² / (1 - h_i); both sums are relative to those of "
    "independent errors. "
)
_FLIPPED = (
    "In the null distribution each subject keeps its own covariance (wild bootstrap with the null "
    "hypothesis imposed [wu, davidson]): the residuals of the model without the tested columns get random "
    "signs, and the statistic is computed again. That model is fitted with weights from the dispersion "
    "of subjects, whose logarithm is a linear function of all columns."
)
_SIGNS = "In the null distribution the differences of pairs get random signs."
_PERMUTED = (
    "In the null distribution the residuals of the model without the tested columns are permuted [freedman], "
    "since so few subjects have hardly any signs; this assumes equal covariances."
)


def _statistic(study: Answer) -> tuple[str, ...]:
    """Return the statistic of a study's tests, and its null distribution."""
    if study.question.kind == "pairs":
        return (_RATIO + _SIGNS,)
    return (_RATIO + (_PERMUTED if study.overall.test.permuted else _FLIPPED),)


def _permutations(study: Answer) -> str:
    """Return the number of permutations; comparisons of few subjects use all of them."""
    tests = "The tests of the whole shape, of particles and of size"
    counts = {
        comparison.title: (comparison.test.permutations, comparison.test.exact)
        for comparison in study.comparisons
    }
    random = [count for count, exact in counts.values() if not exact]
    all_of = [f"all {count + 1} of {title}" for title, (count, exact) in counts.items() if exact]
    if not random:
        listed = f"all {study.overall.test.permutations + 1}" if len(counts) == 1 else ", ".join(all_of)
        return f"{tests} used {listed} randomizations. {least_text(study)}"
    few = f", and {', '.join(all_of)}" if all_of else ""
    return f"{tests} used {random[0]} randomizations (seed {study.question.seed}){few}. {least_text(study)}"


def tested_text(study: Answer, *further: str) -> str:
    """Return the tested quantities: "whole shape, of particles and of the discriminant"."""
    parts = ["whole shape", "of particles", *further]
    if any(comparison.discriminant is not None for comparison in study.comparisons):
        parts.insert(2, "of the discriminant")
    return f"{', '.join(parts[:-1])} and {parts[-1]}"


def least_text(study: Answer) -> str:
    """Return the smallest possible p before correction, if it is the same for all comparisons."""
    counts = {
        (comparison.test.permutations, comparison.test.exact)
        for comparison in study.comparisons
        if comparison.test.modes
    }
    if len(counts) != 1:
        return ""
    ((count, exact),) = counts
    least = 1 / (count + 1)
    how = f"all {count + 1}" if exact else f"{count}"
    return (
        f"With {how} randomizations the smallest possible p of whole shape and particles is {least:.2g}, "
        "before correction."
    )
