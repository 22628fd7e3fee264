"""All results about one effect: whole shape, every particle, size, discriminant."""

from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np

from homolog.arrays import BoolArray, FloatArray, IntArray, data_frame, frozen, html_of
from homolog.errors import InputError
from homolog.progress import Tick, part_of
from homolog.statistics.assumptions import (
    Dispersion,
    SizeSkewness,
    dispersion_test,
    outlier_limit,
    outliers_by,
    relative_distances,
    size_skewness,
)
from homolog.statistics.cautions import cautions_of, p_text
from homolog.statistics.design import Hypothesis
from homolog.statistics.discriminant import Discriminant
from homolog.statistics.effects import (
    Effect,
    SizeVariance,
    corrected_distance,
    distance_of_several,
    explained_variance,
    size_effect,
    size_variance,
    standardized_size,
)
from homolog.statistics.mode_test import ModeTest, mode_test
from homolog.statistics.pointwise_test import PointwiseTest, pointwise_test
from homolog.statistics.procrustes import Alignment, aligned, rms_radii

__all__ = ["DEFAULT", "Comparison", "Options", "prepare_shapes", "run_comparison"]


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a comparison.

    Attributes
    ----------
    alignment : Alignment
        How shapes are aligned before they are compared: not at all, rigidly (form: size and shape, the
        default), or by similarities (shape alone). Size is always tested separately.
    modes : int or None
        Number of modes; chosen by parallel analysis if not given.
    permutations : int
        Permutations of each test.
    bootstraps : int
        Bootstrap samples for the bounds of the discriminant.
    classifications : int
        Permutations for the p-values of the discriminant's accuracy and AUC.
    answers : int
        Number of answers to the same question that are reported together, such as form and shape. p-values of
        the whole shape, of particles and of the discriminant are corrected for it (Bonferroni).
    seed : int
        Same seed, same result.
    """

    alignment: Alignment = Alignment.FORM
    modes: int | None = None
    permutations: int = 10_000
    bootstraps: int = 1000
    classifications: int = 1999
    answers: int = 1
    seed: int = 0

    @property
    def reports_size(self) -> bool:
        """Whether the answer reports size; an answer on shape does not if there are other answers."""
        return self.answers == 1 or self.alignment is not Alignment.SHAPE


DEFAULT = Options()


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All results about one effect.

    Attributes
    ----------
    title : str
        Title, such as ``"HCM - NOR"``.
    subjects : (m,) int array
        Indices of the compared subjects; for pairs, those of the first members.
    counts : dict
        Number of subjects in each group.
    mean : (N, 3) array
        Mean shape of those subjects [mm].
    test : ModeTest
        Test of the whole shape.
    pointwise : PointwiseTest
        Tests at every particle; the effect is the difference, or the change per unit [mm].
    size : Effect or None
        Difference in size, or change per unit [mm], with permutation p; None if size itself is tested or
        adjusted for.
    distance : Effect or None
        Mahalanobis distance of the means (or length of the change per unit) in the retained modes, corrected
        for its bias. For three or more groups, the root mean square distance from their common mean.
    explained : Effect or None
        Share of the generalised variance in the retained modes that the tested effect explains (omega squared
        of Wilks' lambda).
    dispersion : Dispersion or None
        Test of equal dispersion of the groups; None for pairs.
    discriminant : Discriminant or None
        The discriminant of two groups, if at least one mode is retained.
    p_adjusted : float
        Permutation p of the whole shape, corrected for pairs of groups (Holm) and answers (Bonferroni).
    p_fwe : (N,) array
        Permutation p of each particle, corrected over the surface, pairs (Holm) and answers (Bonferroni).
    size_p_adjusted : float or None
        Permutation p of size, corrected for pairs of groups (Holm).
    accuracy_p_adjusted, auc_p_adjusted : float or None
        Permutation p of the discriminant's accuracy and AUC, corrected for pairs of groups (Holm) and answers
        (Bonferroni).
    size_skewness : SizeSkewness or None
        Test of skewness of size; None for a continuous variable.
    outliers : (n,) int array
        Indices of subjects far from the mean of their group, the farthest first; for pairs, those of the
        first members.
    without_outliers : Comparison or None
        All results without the outliers, corrected in the same way; None if there are no outliers, or too few
        other subjects.
    notes : tuple of str
        Deviations from the request, in sentences.
    size_variance : SizeVariance or None
        Variance of size between three or more groups; None otherwise.
    pairwise : tuple of Comparison
        Comparisons of each pair of three or more groups, from `homolog.compare_groups`.
    size_standardized : Effect or None
        The effect on size in standard deviations within groups (Hedges' g), of the differences of pairs, or
        of the residuals of a regression; None if `size` is None.
    outlier_distances : tuple of float
        Distances of the outliers from the mean of their group, divided by the median distance of the group.
    outlier_limit : float
        Relative distance above which a subject is an outlier.
    reports_size : bool
        Whether size is reported, with its caution; of several answers, only that on form reports it.
    covariates : tuple of Comparison
        Effects of the covariates, each adjusted for the tested effect and for the other covariates.
    """

    title: str
    subjects: IntArray
    counts: dict[str, int]
    mean: FloatArray
    test: ModeTest
    pointwise: PointwiseTest
    size: Effect | None
    distance: Effect | None
    explained: Effect | None
    dispersion: Dispersion | None
    discriminant: Discriminant | None
    p_adjusted: float
    p_fwe: FloatArray
    size_p_adjusted: float | None
    size_skewness: SizeSkewness | None
    outliers: IntArray
    without_outliers: "Comparison | None" = None
    notes: tuple[str, ...] = ()
    accuracy_p_adjusted: float | None = None
    auc_p_adjusted: float | None = None
    size_variance: SizeVariance | None = None
    pairwise: tuple["Comparison", ...] = ()
    size_standardized: Effect | None = None
    outlier_distances: tuple[float, ...] = ()
    outlier_limit: float = float("inf")
    reports_size: bool = True
    covariates: tuple["Comparison", ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in ("subjects", "mean", "p_fwe", "outliers"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __repr__(self) -> str:
        """Return a one-line summary."""
        particles = int(np.sum(self.p_fwe < 0.05))
        return (
            f"Comparison({self.title}, {len(self.subjects)} subjects: {p_text(self.p_adjusted)} of the whole "
            f"shape, {particles} of {len(self.p_fwe)} particles with p_fwe < 0.05)"
        )

    def to_dataframe(self) -> Any:  # noqa: ANN401 - pandas is imported when it is needed
        """Return a `pandas.DataFrame` with a row for each particle: mean, effect [mm] and p-values."""
        columns: dict[str, object] = dict(zip("xyz", self.mean.T, strict=True))
        for number, effect in enumerate(self.pointwise.effect, start=1):
            several = f"{number}_" if len(self.pointwise.effect) > 1 else ""
            columns |= {f"effect_{several}{axis}": effect[:, i] for i, axis in enumerate("xyz")}
        columns |= {"p": self.pointwise.p, "p_fwe": self.p_fwe, "q": self.pointwise.q}
        return data_frame(columns, range(len(self.mean)), "particle")

    def to_pyvista(self) -> Any:  # noqa: ANN401 - the core does not depend on pyvista
        """Return the mean particles as `pyvista.PolyData`, with the columns of `to_dataframe` as values."""
        points = import_module("pyvista").PolyData(self.mean.copy())
        for name, values in self.to_dataframe().items():
            points[name] = values.to_numpy()
        return points

    def _repr_html_(self) -> str:
        """Return the summary that notebooks show."""
        return html_of(repr(self), self.to_dataframe(), self.notes)

    def renumbered(self, members: IntArray) -> "Comparison":
        """Return the comparison with indices into a larger cohort that contains the compared subjects."""
        rest = self.without_outliers
        return replace(
            self,
            subjects=members[self.subjects],
            outliers=members[self.outliers],
            without_outliers=None if rest is None else rest.renumbered(members),
            covariates=tuple(item.renumbered(members) for item in self.covariates),
        )

    @property
    def cautions(self) -> tuple[str, ...]:
        """Cautions as sentences, without those of the pairs."""
        return cautions_of(self)


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """The subjects and data of a comparison; see `run_comparison`."""

    shapes: FloatArray
    subjects: IntArray
    design: Hypothesis
    title: str
    counts: dict[str, int]
    members: dict[str, BoolArray]
    mean: FloatArray | None
    data: FloatArray | None
    size: FloatArray

    def tested(self, options: Options) -> FloatArray:
        """Return the tested data: the aligned shapes, or differences of pairs."""
        return prepare_shapes(self.shapes[self.subjects], options) if self.data is None else self.data

    def of(self, kept: BoolArray) -> "_Sample":
        """Return the part of the sample whose subjects (m,) are kept."""
        numbers = [np.count_nonzero(own & kept) for own in self.members.values()] or [np.count_nonzero(kept)]
        return replace(
            self,
            subjects=self.subjects[kept],
            design=self.design.of(kept),
            counts=dict(zip(self.counts, map(int, numbers), strict=True)),
            members={name: own[kept] for name, own in self.members.items()},
            data=None if self.data is None else self.data[kept],
            size=self.size[kept],
        )


def run_comparison(
    shapes: FloatArray,
    subjects: IntArray,
    design: Hypothesis,
    title: str,
    counts: dict[str, int],
    options: Options,
    tick: Tick,
    *,
    members: dict[str, BoolArray] | None = None,
    mean: FloatArray | None = None,
    data: FloatArray | None = None,
    size: FloatArray | None = None,
    nested: bool = True,
) -> Comparison:
    """Run the tests of one design, and once more without outliers.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Checked positions of the whole cohort [mm].
    subjects : (m,) int array
        Indices of the compared subjects.
    design : Hypothesis
        What is tested, with m rows.
    title, counts, options
        See `Comparison`.
    tick : Tick
        Progress and cancellation.
    members : dict of (m,) bool arrays, optional
        Members of each group, for designs of groups.
    mean : (N, 3) array, optional
        Mean shape of the result, if it is not that of the subjects [mm].
    data : (m, N, 3) array, optional
        Tested data in place of the subjects' shapes: differences of pairs [mm].
    size : (m,) array, optional
        Tested sizes in place of the subjects' sizes [mm].
    nested : bool
        Whether to repeat the comparison without outliers.

    Returns
    -------
    Comparison
    """
    size = rms_radii(shapes[subjects]) if size is None else size
    sample = _Sample(shapes, subjects, design, title, counts, members or {}, mean, data, size)
    done = _compared(sample, options, tick)
    kept = ~np.isin(subjects, done.outliers)
    if not nested or kept.all() or any(np.count_nonzero(own & kept) < 2 for own in sample.members.values()):
        return done
    with suppress(InputError):  # too few subjects remain
        remainder = _compared(sample.of(kept), options, part_of(tick, 0.9, 1.0))
        return replace(done, without_outliers=remainder)
    return done


def _compared(sample: _Sample, options: Options, tick: Tick) -> Comparison:
    """Run all tests of a sample."""
    data, design, size = sample.tested(options), sample.design, sample.size
    drawn = {"permutations": options.permutations, "seed": options.seed}
    test = mode_test(data, design, modes=options.modes, **drawn, tick=part_of(tick, 0.0, 0.4))
    alike = () if design.covariates.shape[1] else tuple(sample.members.values())
    pointwise = pointwise_test(data, design, members=alike, **drawn, tick=part_of(tick, 0.4, 1.0))
    effect = size_effect(size, design, alike, shapes=data.reshape(len(data), -1), **drawn)
    several = effect is not None and design.tested.shape[1] > 1
    distances = relative_distances(data, design, list(sample.members.values()))
    outliers = outliers_by(distances)
    return Comparison(
        title=sample.title,
        subjects=sample.subjects,
        counts=sample.counts,
        mean=data.mean(axis=0) if sample.mean is None else sample.mean,
        test=test,
        pointwise=pointwise,
        size=effect,
        distance=_distance(test, design),
        explained=None
        if design.n_units < len(design.units)
        else explained_variance(
            test.wilks, test.modes, design.tested.shape[1], design.error_dof, len(design.tested)
        ),
        dispersion=dispersion_test(data, design, test.modes, sample.members, **drawn),
        discriminant=None,
        p_adjusted=min(options.answers * test.p_permutation, 1.0),
        p_fwe=np.minimum(options.answers * pointwise.p_fwe, 1.0),
        size_p_adjusted=None if effect is None else effect.p,
        size_variance=size_variance(size, design, alike)
        if several and design.n_units == len(design.units)
        else None,
        size_standardized=standardized_size(size, design)
        if effect is not None and design.n_units == len(design.units)
        else None,
        size_skewness=size_skewness(size, data, design, sample.members),
        outliers=sample.subjects[outliers],
        outlier_distances=tuple(distances[outliers].tolist()),
        outlier_limit=outlier_limit(distances),
        reports_size=options.reports_size,
    )


def prepare_shapes(shapes: FloatArray, options: Options) -> FloatArray:
    """Return the shapes, aligned for the comparison."""
    return aligned(shapes, options.alignment)


def _distance(test: ModeTest, design: Hypothesis) -> Effect | None:
    if design.n_units < len(design.units):
        return None
    if test.t_squared is None:
        columns = design.tested.shape[1]
        return distance_of_several(test.lawley, test.modes, columns, design.error_dof, len(design.tested))
    scale = float(np.square(design.columns).sum())
    return corrected_distance(test.t_squared, test.modes, design.error_dof, scale)
