"""Methods text and settings: what a reader needs to repeat the analysis."""

from homolog.files.records import ResultRecord
from homolog_app.report.study import Study

__all__ = ["methods", "settings_rows"]


_MODEL = (
    "The shape model is a principal component analysis of the aligned particle positions. The number of "
    "modes was chosen by Horn's parallel analysis: modes were kept up to the first whose variance did not "
    "exceed the 95th percentile of 200 data sets in which each coordinate was permuted among subjects."
)


def methods(record: ResultRecord, studies: list[Study]) -> list[str]:
    """Return paragraphs for the methods section of a paper."""
    return [_placed(record), _MODEL, *([_statistics(studies)] if studies else [])]


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
    marked = ", first points on landmarks" if record.settings.optimize.landmarks else ""
    return (
        f"Corresponding points were placed with {program} on {count} by entropy-based particle optimization "
        f"with {record.metric} distances between particles on a shape (method {method}, seed "
        f"{record.settings.optimize.seed}{marked}). The optimizer {ended} after {record.iterations} "
        "iterations."
    )


def _statistics(studies: list[Study]) -> str:
    request = studies[0].request
    words = [
        "Whole shapes were compared in the kept modes by Hotelling's T² (Wilks' lambda for more than two "
        "groups), "
        f"with the parametric F distribution and with {request.permutations} permutations. At every "
        "particle, "
        "positions were compared by Hotelling's T²; p-values were corrected over the surface by the "
        "permutation "
        "distribution of the largest statistic (family-wise), and false discovery rates were computed by the "
        "method of Benjamini and Hochberg. The linear discriminant was computed in the kept modes with the "
        "covariance shrunk after Ledoit and Wolf; accuracy and area under the curve come from repeated "
        "stratified "
        "cross-validation, bounds of its map from a bootstrap within groups."
    ]
    if any(study.request.covariates for study in studies):
        words.append(
            "Covariates were allowed for by a linear model of each coordinate; permutations were those of "
            "Freedman and Lane (residuals), with modes chosen anew in each."
        )
    if any(study.request.scaling for study in studies):
        words.append(
            "Where size was removed, shapes were scaled to the cohort's mean size by generalized Procrustes "
            "analysis; size is the root mean square distance of a shape's particles from their centroid."
        )
    if any(study.pairwise for study in studies):
        words.append("P-values of pairs of groups were adjusted by Holm's method.")
    if any(study.request.kind == "pairs" for study in studies):
        words.append("Paired subjects were compared by their differences, with random signs under the null.")
    if any(one.false_alarms for study in studies for one in study.comparisons):
        words.append(
            f"Each test's false-alarm rate was estimated on this cohort from {request.null_repeats} "
            "relabellings."
        )
    return " ".join(words)


def settings_rows(record: ResultRecord, studies: list[Study]) -> list[tuple[str, str, str]]:
    """Return every setting and version: part, name, value."""
    rows = [
        (part, name, "automatic" if value is None else str(value))
        for part, model in (("groom", record.settings.groom), ("optimize", record.settings.optimize))
        for name, value in model.model_dump(mode="json").items()
    ]
    rows += [("run", "device", record.device), ("run", "fingerprint", record.fingerprint)]
    for study in studies:
        rows += [
            (study.request.name, name, "automatic" if value is None else str(value))
            for name, value in study.request.model_dump(mode="json").items()
        ]
    return rows + [("version", name, number) for name, number in record.versions.items()]
