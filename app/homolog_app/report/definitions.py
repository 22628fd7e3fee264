"""What the words and numbers of a report mean: each once."""

from collections.abc import Iterator, Sequence

from homolog.analysis.procrustes import Alignment
from homolog_app.report.findings import LEVEL
from homolog_app.report.request import SHAPE_SIZE
from homolog_app.report.study import Study
from homolog_app.report.study_parts import axes_text
from homolog_app.report.surface_maps import SurfaceCarrier

__all__ = ["definitions"]


def definitions(
    studies: Sequence[Study], carrier: SurfaceCarrier, *, confirmed: bool
) -> Iterator[tuple[str, str]]:
    """Yield terms with their meanings, those that the studies need.

    Parameters
    ----------
    studies : sequence of Study
        At least one.
    carrier : SurfaceCarrier
        Of the result.
    confirmed : bool
        Whether the authors have said what the axes are.
    """
    yield from _of_answers(studies)
    yield from _of_places(carrier)
    yield "Places", axes_text(carrier, confirmed=confirmed)
    yield from _of_subjects(studies)


def _of_answers(studies: Sequence[Study]) -> Iterator[tuple[str, str]]:
    """Yield what is compared, and the numbers that say how it differs."""
    kinds = {study.request.kind for study in studies}
    yield (
        "Study, comparison",
        "A study answers one question for form or for shape; it compares two groups, all groups and each "
        "two of them, pairs, or values of a variable. A difference A - B is the mean of A minus that of B.",
    )
    similar = any(study.request.alignment is Alignment.SIMILARITY for study in studies)
    yield (
        "Form, shape, size",
        f"Form is size and shape. {SHAPE_SIZE}, or size, is the root mean square distance of a shape's "
        "particles from their centroid."
        + (
            " For shape, all are scaled to the cohort's mean size. Only isometric scaling is removed: shape "
            "that changes with size (allometry) remains. Its mm and mm² are those of the mean size."
            if similar
            else ""
        ),
    )
    yield (
        "p, significant",
        "p is the permutation p, two-sided (of accuracy and AUC one-sided), corrected as the methods say; "
        f"significant is p ≤ {LEVEL:g}. Intervals (95 % CI) are not corrected.",
    )
    yield "D", " ".join(text for kind, text in _DISTANCE.items() if kind in kinds)
    yield (
        "ω²",
        "Share of the generalised variance in the tested modes that the groups, the variable or the mean "
        "difference explain, corrected for bias.",
    )
    yield (
        "Significant area",
        f"Area of the particles with p ≤ {LEVEL:g}, corrected over the surface (family-wise error), pairs "
        "and analyses. A particle stands for the part of the mean surface of all subjects that is nearest "
        "to it, on the same side of a wall. The whole surface counts, of hollow shapes the inner and the "
        "outer side.",
    )


def _of_places(carrier: SurfaceCarrier) -> Iterator[tuple[str, str]]:
    """Yield what says where shapes differ, and which way they move."""
    yield (
        "Region, peak, outward",
        "A region is connected significant particles, its peak the one with the largest statistic. Outward "
        "is along the normal of the mean surface of the compared subjects, positive out of the tissue; its "
        "mean is over the region's area, with the mean of the particles' intervals, at least as wide as "
        "that of the mean. Positions are tested in all directions, so that an outward interval may contain "
        "zero: such area counts as neither out of the tissue nor into it. Where the peak moves much farther "
        "than its outward part, it moves along the surface, which on a smooth surface may be another "
        "distribution of points rather than of tissue: claim it only near edges and landmarks. Effects at "
        "peaks are overestimated, as peaks were chosen by their statistics.",
    )
    yield (
        "Maps",
        "Outward displacement on the mean shape of the compared subjects, blue out of the tissue, yellow "
        "into it. Scales of figures differ."
        + (" Inside: the half that faces the viewer is removed." if carrier.is_hollow else ""),
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


def _of_subjects(studies: Sequence[Study]) -> Iterator[tuple[str, str]]:
    """Yield what tells single subjects apart, where a study does."""
    comparisons = [comparison for study in studies for comparison in study.comparisons]
    if any(comparison.discriminant is not None for comparison in comparisons):
        yield (
            "Balanced accuracy, AUC",
            "Balanced accuracy is the mean of the two groups' shares of subjects that a cross-validated "
            "linear discriminant puts on the right side, the AUC the probability that it ranks a subject of "
            "the second group above one of the first. Positions along the discriminant in figures are not "
            "cross-validated; bars are the groups' means.",
        )
    if any(comparison.dispersion is not None for comparison in comparisons):
        yield (
            "Dispersion, r",
            "Dispersion is the mean distance of subjects from their group's centroid or from the shape "
            "fitted to them, root mean square over the particles, in the comparison's own modes. r, which "
            "outliers exceed the limit of, is a subject's distance divided by the median distance.",
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
