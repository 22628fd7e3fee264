"""Methods text, to repeat the analysis."""

from collections.abc import Iterator, Sequence

from homolog.analysis.procrustes import Alignment
from homolog.files.records import ResultRecord
from homolog.settings import Procrustes
from homolog_app.report.findings import LEVEL, correction_text, tested_text
from homolog_app.report.sample import voxel_text
from homolog_app.report.study import Study
from homolog_app.report.study_parts import values_of

__all__ = ["methods", "pose_text"]


def methods(record: ResultRecord, studies: list[Study]) -> list[str]:
    """Return paragraphs for the methods section of a paper: model, common methods of studies, each study."""
    sentences = [_statistics(study) for study in studies]
    shared = [text for text in sentences[0] if all(text in each for each in sentences)] if studies else []
    own = _own_sentences([[text for text in each if text not in shared] for each in sentences], studies)
    rigid = {"alignment": Alignment.RIGID}
    questions = {study.request.model_copy(update=rigid).question for study in studies}
    if len(questions) > 1:
        shared.append(
            f"{len(questions)} questions were asked of this result; p-values were corrected for pairs and "
            "answers within a question, not for the number of questions."
        )
    return [
        text for text in (_placed(record), _groomed(record), _model(record), " ".join(shared), *own) if text
    ]


def _own_sentences(sentences: list[list[str]], studies: list[Study]) -> list[str]:
    """Return a paragraph for each study; one like an earlier study says only what differs from that."""
    paragraphs = []
    for number, (own, study) in enumerate(zip(sentences, studies, strict=True), start=1):
        text = " ".join(own)
        for before, earlier in enumerate(sentences[: number - 1], start=1):
            instead = [sentence for sentence in own if sentence not in earlier]
            left = [sentence for sentence in earlier if sentence not in own]
            if len(instead) == len(left) <= _MOST_DIFFERENT:
                except_for = f", except: {' '.join(instead)}" if instead else "."
                text = f"Its methods were those of Study {before}{except_for}"
                break
        paragraphs.append(f"Study {number} ({study.request.title}). {text}")
    return paragraphs


_MOST_DIFFERENT = 3
"""Sentences in which a study may differ from an earlier one for its methods to be told by these."""


def _groomed(record: ResultRecord) -> str:
    if record.source:
        return "Surfaces and their alignment are those of that program."
    values = dict(values_of(record.settings.groom))
    spacings = [subject.spacing for subject in record.subjects if subject.spacing]
    if spacings:
        automatic = " (automatic)" if record.settings.groom.spacing is None else ""
        values["spacing"] = f"{_range(spacings, '.3g')} mm{automatic}"
    if not record.mirrored_text:
        values["mirror"] += " (nobody was mirrored)"
    listed = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in values.items())
    vertices = [subject.vertices for subject in record.subjects if subject.vertices]
    surfaces = f" Surfaces had {_range(vertices, 'd')} vertices." if vertices else ""
    voxels = [sorted(subject.voxel) for subject in record.subjects if subject.voxel]
    edges = f"Voxels of the files were {voxel_text(voxels)} mm (the shortest edge first). " if voxels else ""
    return (
        f"{edges}Segmentations were cleaned (enclosed cavities filled) and antialiased; surfaces are the "
        f"zero levels of signed distance fields. Shapes were groomed with these settings: {listed}.{surfaces}"
    )


def _model(record: ResultRecord) -> str:
    smoothed = record.smoothed_particles
    surface = (
        f", which is smoother around {smoothed} particles, where the mean or a mode would fold"
        if smoothed
        else ""
    )
    folds = f" {record.folded_faces} of its faces are folded." if record.folded_faces else ""
    remarks = f" Remarks of the program on subjects: {'; '.join(record.remarks)}." if record.remarks else ""
    return (
        f"The shape model is a principal component analysis of the particle positions, {pose_text(record)} "
        "(variances with the divisor n - 1). The mean surface is the mesh of the subject nearest to the "
        f"mean, carried to the mean particles by a thin-plate spline{surface}.{folds}{remarks}"
    )


def _size_of_groups(study: Study) -> list[str]:
    if study.overall.size_variance is None:
        return []
    f = "the F of the analysis of covariance" if study.request.covariates else "Welch's F"
    return [
        f"Size of all groups together has {f}; ω² is the share of its variance that lies between the groups, "
        "estimated from that F, with bounds from the noncentral F distribution."
    ]


def _range(values: Sequence[float], form: str) -> str:
    low, high = format(min(values), form), format(max(values), form)
    return low if low == high else f"{low} to {high}"


def _placed(record: ResultRecord) -> str:
    count = f"{len(record.subjects)} shapes, {record.particles} on each,"
    program = f"Homolog {record.versions.get('homolog', '')}"
    if record.source:
        return (
            f"Corresponding points on {count} were placed by another program and imported with {program} "
            f"from {record.source}."
        )
    method = record.settings.optimize.method
    ended = "converged" if record.ended == "converged" else "was stopped before convergence"
    mirrored = f" Before that, {record.mirrored_text}." if record.mirrored_text else ""
    marked = ", first points on landmarks" if record.settings.optimize.landmarks else ""
    return (
        f"Corresponding points were placed with {program} on {count} by entropy-based particle optimization "
        f"with {record.metric} distances between particles on a shape (method {method}, seed "
        f"{record.settings.optimize.seed}{marked}). The optimizer {ended} after {record.iterations} "
        f"iterations.{mirrored} {_jointly(record)} {_POSES[record.settings.placing.procrustes]}"
    )


def _jointly(record: ResultRecord) -> str:
    size = record.settings.optimize.core_set
    if size is None or size >= len(record.subjects):
        return "All shapes were optimized jointly."
    return f"A core set of {size} shapes was optimized jointly, and the others were fitted to it one by one."


def pose_text(record: ResultRecord) -> str:
    """Describe the alignment and size of the model's shapes."""
    if record.source:
        return "as they were imported"
    return _MODEL_POSES[record.settings.placing.procrustes]


_MODEL_POSES = {
    Procrustes.OFF: "as grooming aligned them",
    Procrustes.RIGID: "aligned rigidly by their particles, with their own sizes",
    Procrustes.FORM: "aligned rigidly by their particles, with their own sizes",
    Procrustes.SIMILARITY: "aligned by their particles and scaled to one size",
}
_POSES = {
    Procrustes.OFF: "During the optimization their poses stayed as they were after grooming.",
    Procrustes.RIGID: "During the optimization they were aligned rigidly by their particles.",
    Procrustes.FORM: (
        "During the optimization they were aligned by their particles and scaled to one size; the positions "
        "that are analyzed have their original sizes."
    ),
    Procrustes.SIMILARITY: (
        "During the optimization they were aligned by their particles and scaled to one size."
    ),
}


_ALIGNED = {
    Alignment.AS_IT_LIES: "Shapes were compared as the correspondence left them, not aligned further.",
    Alignment.RIGID: (
        "Shapes were aligned by generalized Procrustes analysis without scaling, so that size and shape "
        "(form) were compared."
    ),
    Alignment.SIMILARITY: (
        "Shapes were aligned by generalized Procrustes analysis with scaling to the cohort's mean size, so "
        "that shape without size was compared."
    ),
}


def _statistics(study: Study) -> list[str]:
    """Return the sentences on a study's tests."""
    request = study.request
    sentences = [
        *_test_of_the_shape(study),
        _ALIGNED[study.request.alignment],
        "At every particle the position was tested by the same statistic as the whole shape; p-values were "
        "corrected over the surface by the permutation distribution of the largest statistic (family-wise "
        "error, Westfall and Young), and false discovery rates of the permutation p-values were computed by "
        "the method of Benjamini and Hochberg.",
        f"The level was alpha = {LEVEL:g}; tests are two-sided{_one_sided(study)}.",
        "Size is the root mean square distance of a shape's particles from their centroid; it was tested by "
        f"permutation of {_SIZE_STATISTIC[request.kind]}"
        f"{_OF_ALL_GROUPS if study.pairwise else ''}.",
        *_size_of_groups(study),
        f"95 % intervals of size and of displacements at particles {_intervals(study)}; they are not "
        "corrected "
        "over the surface or for pairs.",
        *_adjustments(study),
        *_further_measures(study),
        *_discriminants(study),
    ]
    if study.overall.false_positives:
        sentences.append(
            f"{_EXCHANGED[request.kind]} {request.null_repeats} times to estimate type I error rates on this "
            "cohort."
        )
    return sentences


def _intervals(study: Study) -> str:
    if study.request.kind == "regression" or study.request.covariates:
        return "have HC2 standard errors"
    return "are those of Student's t" if study.request.kind == "pairs" else "are those of Welch"


_SIZE_STATISTIC = {
    "groups": "its studentized difference",
    "regression": "its studentized slope",
    "pairs": "the signs of the studentized mean difference of the pairs",
}
_OF_ALL_GROUPS = ", that of all groups together by permutation of Welch's F"
_EXCHANGED = {
    "groups": "Labels were permuted",
    "regression": "Values were permuted",
    "pairs": "Signs of the differences were drawn",
}


def _one_sided(study: Study) -> str:
    separated = any(comparison.discriminant is not None for comparison in study.comparisons)
    return ", those of accuracy and AUC one-sided" if separated else ""


def _test_of_the_shape(study: Study) -> Iterator[str]:
    """Yield the comparison, its modes and its statistic."""
    request, first = study.request, study.overall
    modes = (
        f"the first {request.modes} modes (chosen beforehand)"
        if request.modes is not None
        else "the modes that Horn's parallel analysis of its subjects retained for each comparison (variance "
        f"above the 95th percentile of {first.test.parallel.repeats} data sets without correlation)"
    )
    names = f"{', '.join(request.between[:-1])} and {request.between[-1]}" if request.between else ""
    tested = {
        "groups": f"the groups {names} of the column {request.column!r} were compared; "
        "a difference A - B is the mean of A minus the mean of B",
        "regression": f"the linear effect of {request.column} was tested; effects are per unit of it",
        "pairs": f"{names} were compared in pairs by {request.pairs}, with random "
        "signs of the differences under the null",
    }[request.kind]
    yield f"{tested[0].upper()}{tested[1:]}."
    yield (
        f"The whole shape was tested in {modes}, by permutation of a studentized statistic: "
        f"{_statistic(study)}."
    )
    yield _permutations(study)
    yield (
        "Hotelling's T² or Wilks' lambda with the F distribution are given as well and assume equal "
        "covariances."
    )


def _adjustments(study: Study) -> Iterator[str]:
    """Yield adjustments and corrections of the tests."""
    request = study.request
    if request.covariates:
        yield (
            f"Shapes were adjusted for {', '.join(request.covariates)} by a linear model of each coordinate; "
            "residuals were permuted (Freedman and Lane). Each covariate was tested in the same way, "
            "adjusted for the study's own effect and the other covariates."
        )
    if request.complete_cases:
        partners = ", and those whose partner is missing," if request.pairs else ""
        yield f"Subjects with missing values{partners} were excluded (complete cases)."
    if correction := correction_text(study):
        size = correction_text(study, size=True)
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
                "less, and so on (Holm over surfaces)."
            )
    else:
        yield "P-values were not corrected for other questions."
    yield f"The tests of the {tested_text(study, 'of size')} were not corrected for each other."


def _further_measures(study: Study) -> Iterator[str]:
    """Yield the tests of dispersion and the correction of distances."""
    request = study.request
    if study.overall.dispersion is not None:
        yield (
            f"Equality of dispersion was tested by the distances of subjects to {_centre(study)} in the "
            "tested modes: residuals were permuted, and distances computed to the centroids of the permuted "
            f"residuals ({study.overall.dispersion.permutations} permutations, p not corrected). Intervals "
            f"of dispersions {_JACKKNIFE[request.kind]} come from the jackknife."
        )
    if any(comparison.distance is not None for comparison in study.comparisons):
        several = _OF_SEVERAL * bool(study.pairwise)
        yield (
            f"{_DISTANCES[request.kind]}{several} and the explained share of the generalised variance (ω², "
            "from Wilks' lambda) were corrected for bias; their intervals come from the noncentral F "
            "distribution (Reiser, Steiger), assume equal covariances and are not corrected for pairs."
        )


_JACKKNIFE = {"groups": "and of their ratios", "regression": "along the variable", "pairs": ""}


def _centre(study: Study) -> str:
    of_groups = study.request.kind == "groups" and not study.request.covariates
    return "their group's centroid" if of_groups else "the shape fitted to them"


_OF_SEVERAL = (
    ", and of all groups together the root mean square distance of their means from the common mean (from "
    "Hotelling and Lawley's trace, McKeon),"
)
_DISTANCES = {
    "groups": "Mahalanobis distances of group means in the retained modes (D, in standard deviations within "
    "groups)",
    "regression": "Lengths of the change per unit in the retained modes (D, in standard deviations of the "
    "residuals)",
    "pairs": "Mean differences of pairs in the retained modes (D, in standard deviations of the differences)",
}


def _discriminants(study: Study) -> Iterator[str]:
    fits = [
        comparison.discriminant for comparison in study.comparisons if comparison.discriminant is not None
    ]
    if not fits:
        return
    adjusted = ", covariates' effects" if study.request.covariates else ""
    folds = " to ".join(str(item) for item in sorted({fit.folds for fit in fits}))
    yield (
        "The linear discriminant was computed in the retained modes with the covariance shrunk after "
        f"Ledoit and Wolf. Balanced accuracy and area under the curve (AUC) come from {folds}-fold "
        f"stratified cross-validation, repeated {fits[0].repeats} times; in each fold as many modes as the "
        f"comparison retained{adjusted} and the direction were fitted without the left-out subjects. Their "
        "intervals are those of Wilson (joined as by Newcombe) and of DeLong (of an AUC of 1, whose variance "
        "would be zero: the exact binomial bound of the smaller group). Their p-values come "
        f"from {fits[0].auc.permutations} permutations: before correction the least possible is "
        f"{1.0 / (fits[0].auc.permutations + 1):.2g}. Bounds of "
        f"the discriminant's map come from {len(fits[0].bootstrap)} bootstrap cohorts drawn within "
        "groups."
    )


_SCALED = (
    "Before subjects were exchanged, each was divided by the dispersion of its group, and afterwards "
    "multiplied by that of the group it came to, so that permuted groups have the dispersions of the real "
    "ones. In place of the mean, which centring removes, one was drawn at random; where all permutations "
    "were taken, that of each subject was used in turn"
)


def _statistic(study: Study) -> str:
    """Return the statistic of a study's permutation tests."""
    request = study.request
    if request.kind == "groups" and not request.covariates:
        statistic = (
            "Welch's F with squared distances in the standardized modes, divided by their number, from each "
            "group's own variance"
        )
        return f"{statistic}. {_SCALED}"
    statistic = (
        "the tested sum of squares in standardized modes divided by its expectation without an effect, "
        "estimated from each subject's own residual (Brown and Forsythe; HC2)"
    )
    if request.kind == "regression":
        return (
            f"{statistic}. Before permutation subjects were scaled to one dispersion along the variable, by "
            "a linear model of the logarithm of their distances from the fitted shapes, and afterwards to "
            "that at the new value"
        )
    return statistic if request.kind == "pairs" else f"{statistic}. {_SCALED}"


def _permutations(study: Study) -> str:
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
        return f"{tests} took {listed} permutations."
    few = f", and {', '.join(all_of)}" if all_of else ""
    return f"{tests} took {random[0]} random permutations (seed {study.request.seed}){few}."
