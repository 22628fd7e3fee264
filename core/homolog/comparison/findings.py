"""What an answer says: size, shape, place, each in a sentence, and what its tests could have found."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor, log10, prod, sqrt

import numpy as np
from scipy import optimize, stats

from homolog.comparison.answer import Answer
from homolog.comparison.places import SurfaceCarrier, significant_regions
from homolog.comparison.question import NOUNS
from homolog.statistics.cautions import LEVEL, caution_sentences, p_text
from homolog.statistics.comparison import Comparison
from homolog.statistics.effects import Effect

__all__ = [
    "CONTROLS",
    "POWER",
    "Finding",
    "Place",
    "Seen",
    "answer_text",
    "cautions",
    "covariate_rows",
    "decimals",
    "effect_text",
    "findings",
    "place_of",
    "share_of_surface",
    "step_of",
]

CONTROLS = (
    "Family-wise error 5 %: in 95 % of cohorts no particle is found by chance. False discovery rate 5 %: on "
    "average one in 20 found is."
)
"""What both counts of particles control."""
POWER = 0.8
"""Share of cohorts in which what a test can see is found."""
_NONE = "–"


@dataclass(frozen=True, slots=True)
class Seen:
    """The smallest effects that are found in four of five such cohorts; None if not known.

    Attributes
    ----------
    whole : float or None
        Of the whole shape, by its randomization test, in a typical direction of the variation between
        subjects: root mean square over the particles [mm].
    displacement : float or None
        Of a single particle, in the median over the surface after Bonferroni's correction [mm].
    """

    whole: float | None
    displacement: float | None

    @classmethod
    def of(cls, answer: Answer, comparison: Comparison) -> "Seen":
        """Return what the tests of a comparison could have found."""
        test, local = comparison.test, comparison.pointwise
        level = LEVEL / max(len(answer.pairwise), 1)
        whole = displacement = None
        if len(local.covariance):
            limit = float(np.quantile(test.whole.null, 1.0 - level, method="higher"))
            whole = sqrt(_noncentral(limit, *test.noise) / len(local.effect[0]))
        if len(local.covariance):
            within = float(np.median(local.dof)) - local.variables + 1.0
            if within >= 1.0:
                error = np.sqrt(np.trace(local.covariance, axis1=1, axis2=2) / 3.0)
                needed = _needed(local.variables, within, level / len(error))
                displacement = sqrt(needed) * float(np.median(error))
        return cls(whole, displacement)


def _noncentral(limit: float, trace: float, square: float) -> float:
    """Return the squared effect whose sum of squares exceeds its limit in `POWER` of cohorts.

    The tested sum of squares is normal with the mean ``trace + effect`` and the variance
    ``2 square + 4 effect square / trace``: of a covariance with these traces, and an effect along it.
    """
    beyond = (limit - 1.0) * trace
    deviate = float(stats.norm.ppf(POWER)) ** 2
    middle = beyond + 2.0 * deviate * square / trace
    root = sqrt(max(middle**2 - beyond**2 + 2.0 * deviate * square, 0.0))
    return max(middle + root, 0.0)


def _needed(between: float, within: float, level: float) -> float:
    """Return the noncentrality at which F exceeds its limit in `POWER` of cohorts."""
    limit = float(stats.f.isf(level, between, within))

    def missing(noncentrality: float) -> float:
        return POWER - float(stats.ncf.sf(limit, between, within, noncentrality))

    most = 1.0
    while missing(most) > 0.0 and most < 1e9:
        most *= 2.0
    return float(optimize.brentq(missing, 0.0, most)) if most < 1e9 else float("inf")


@dataclass(frozen=True, slots=True)
class Place:
    """Where particles differ.

    Attributes
    ----------
    particles : int
        Number of particles of the surface.
    certain : int
        Significant ones with control of the family-wise error: in 95 % of cohorts none of them is false.
    likely : int
        Significant ones at a false discovery rate of 5 %: one in twenty of them is expected to be false.
    percent : float
        Share of the surface of the certain ones.
    largest : str
        Location and displacement of the largest certain region; empty if unknown.
    """

    particles: int
    certain: int
    likely: int
    percent: float
    largest: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """What a comparison found.

    Attributes
    ----------
    title : str
        The comparison and its numbers of subjects.
    size, shape, place : str
        A sentence each; empty without size.
    covariates, sees : str
        A sentence on each covariate; what the tests could have found.
    noun : str
        What was compared: form or shape.
    is_significant : bool
        Whether the test of the whole shape is.
    """

    title: str
    size: str
    shape: str
    place: str
    covariates: str
    sees: str
    noun: str
    is_significant: bool

    @property
    def lines(self) -> tuple[tuple[str, str], ...]:
        """Size, shape, place, and the rest, each with its name."""
        named = (
            ("Size", self.size),
            (self.noun.capitalize(), self.shape),
            ("Place", self.place),
            ("Covariates", self.covariates),
            ("Power", self.sees),
        )
        return tuple((name, text) for name, text in named if text)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All lines as texts."""
        return tuple(f"{name}: {text}" for name, text in self.lines)


def findings(answer: Answer, carrier: SurfaceCarrier | None = None) -> list[Finding]:
    """Return the finding of each comparison of an answer, with places if a carrier is given.

    *Significant* refers to the permutation test, corrected for pairs of groups.
    """
    return [_finding(answer, comparison, carrier) for comparison in answer.comparisons]


def _finding(answer: Answer, comparison: Comparison, carrier: SurfaceCarrier | None) -> Finding:
    question, counts = answer.question, comparison.counts
    who = ", ".join(f"{count} {name}" for name, count in counts.items())
    if question.kind == "regression":
        who = f"{counts['all']} subjects"
    elif question.kind == "formula":
        who = f"{counts['all']} shapes"
    title = f"{comparison.title} ({who})" if len(counts) <= 2 else who
    seen = Seen.of(answer, comparison)
    covariates = ""
    if comparison.covariates:
        covariates = "; ".join(" ".join(row) for row in _covariate_texts(answer)) + "."
    return Finding(
        title,
        _size(answer, comparison),
        _shape(answer, comparison),
        _place(answer, comparison, place_of(answer, comparison, carrier)),
        covariates,
        _sees(answer, comparison, seen),
        NOUNS[question.alignment],
        comparison.p_adjusted <= LEVEL,
    )


def step_of(answer: Answer, title: str) -> tuple[float, str]:
    """Return the step in which an effect is told, and its text: ``" per 10 of age"``; 1 and none else."""
    along = [part for part in title.split(":") if part in answer.steps]
    step = prod(answer.steps[part] for part in along)
    return step, f" per {step:g} of {' x '.join(along)}" if along else ""


def decimals(width: float, edge: float = 0.0) -> int:
    """Return the decimals of two digits of half an interval's width, none below a tenth of a voxel."""
    half = width / 2.0
    digits = max(0, 1 - floor(log10(half))) if np.isfinite(half) and half > 0.0 else 2
    return min(digits, max(0, -floor(log10(edge / 10.0)))) if edge > 0.0 else digits


def effect_text(
    effect: Effect,
    unit: str = "",
    *,
    ci: str = "",
    edge: float = 0.0,
    step: float = 1.0,
    sign: bool = False,
) -> str:
    """Return an estimate with its interval, such as ``"+3.7 mm (95 % CI 1.4 to 6.1)"``.

    Parameters
    ----------
    effect : Effect
        Estimate and interval.
    unit : str
        Follows the estimate.
    ci : str
        Name of the interval.
    edge : float
        Edge of the voxels [mm], for effects in mm.
    step : float
        Factor of all numbers: the step of a variable.
    sign : bool
        Whether a positive estimate has a sign.
    """
    value, low, high = (step * item for item in (effect.value, effect.low, effect.high))
    if not np.isfinite(low):
        return f"{value:.3g}{unit}"
    digits = decimals(high - low, edge)
    value, low, high = (round(item, digits) + 0.0 for item in (value, low, high))  # no negative zero
    form = f"{'+' if sign else ''}.{digits}f"
    return f"{value:{form}}{unit} ({ci}{low:.{digits}f} to {high:.{digits}f})"


def _size(answer: Answer, comparison: Comparison) -> str:
    size, p = comparison.size, comparison.size_p_adjusted
    if size is None or p is None:
        return ""
    tested = p_text(p, size.permutations)
    if (between := comparison.size_variance) is not None:
        if answer.question.kind == "formula":  # an interaction has no groups of its own
            verb = f"{'an effect' if p <= LEVEL else 'no effect'} is shown"
        else:
            verb = "the groups differ" if p <= LEVEL else "no difference is shown"
        return f"{verb} (F({between.dof[0]:g}, {between.dof[1]:.3g}) = {between.f:.1f}, {tested})."
    if not np.isfinite(size.value):
        return f"{'an effect' if p <= LEVEL else 'no effect'} is shown, {tested}."
    step, per = step_of(answer, comparison.title)
    effect = effect_text(size, f" mm{per}", ci="95 % CI ", edge=answer.edge, step=step, sign=True)
    if answer.question.kind == "formula":
        return f"{'an effect' if p <= LEVEL else 'no effect'} is shown: {effect}, {tested}."
    if answer.question.kind == "regression":
        return f"{'changes' if p <= LEVEL else 'no change is shown'}: {effect}, {tested}."
    first, second = answer.question.between if answer.question.kind == "pairs" else comparison.counts
    larger = f"{second if size.value > 0.0 else first} larger" if p <= LEVEL else "no difference is shown"
    return f"{larger}: {effect}, {tested}."


def _shape(answer: Answer, comparison: Comparison) -> str:
    test, far = comparison.test, comparison.distance
    p = p_text(comparison.p_adjusted, test.permutations)
    step, per = step_of(answer, comparison.title)
    noun = NOUNS[answer.question.alignment]
    what, of, verb = {
        "regression": ("change", "of", f"{noun} changes"),
        "formula": ("effect", "on", f"an effect on {noun} is shown"),
    }.get(answer.question.kind, ("difference", "of", f"the groups differ in {noun}"))
    if comparison.p_adjusted <= LEVEL:
        stated = "" if far is None else f"D = {effect_text(far, per, ci='90 % CI ', step=step)}, "
        return f"{verb}: {stated}{p}."
    if far is None:
        return f"no {what} {of} {noun} is shown: {p}."
    most = step * far.high
    limit = f"{most:.{decimals(2.0 * most)}f}{per}"
    return f"no {what} {of} {noun} is shown: {p}; {what}s up to D = {limit} are not excluded."


def place_of(answer: Answer, comparison: Comparison, carrier: SurfaceCarrier | None = None) -> Place:
    """Return where particles differ, and how many."""
    inside = comparison.p_fwe <= LEVEL
    largest = ""
    if carrier is not None and (regions := significant_regions(answer, comparison, carrier)):
        region = regions[0]
        step, per = step_of(answer, comparison.title)
        moves = effect_text(region.mean_outward, " mm", edge=answer.edge, step=step, sign=True)
        way = region.direction(region.mean_outward)
        largest = f"{region.where}, mean {moves}{per}, {way}"
    return Place(
        len(inside),
        int(np.count_nonzero(inside)),
        int(np.count_nonzero(comparison.pointwise.q <= LEVEL)),
        share_of_surface(answer, comparison),
        largest,
    )


def share_of_surface(answer: Answer, comparison: Comparison) -> float:
    """Return the percentage of the surface whose particles are significant (family-wise error)."""
    inside = float(answer.areas[comparison.p_fwe <= LEVEL].sum())
    return 100.0 * inside / max(float(answer.areas.sum()), np.finfo(float).tiny)


def _place(answer: Answer, comparison: Comparison, place: Place) -> str:
    verb = "change" if step_of(answer, comparison.title)[1] else "differ"
    noun = f"{place.particles} particles"
    likely = f"{place.likely} at a false discovery rate of 5 %"
    if place.certain <= 1:
        verb = f"{verb}s"
    if not place.certain:
        return f"none of {noun} {verb} (family-wise error 5 %), {likely}."
    sentence = (
        f"{place.certain} of {noun} {verb}, {place.percent:.1f} % of the surface (family-wise error 5 %), "
        f"{likely}."
    )
    if comparison.p_adjusted > LEVEL:
        sentence += " The test of the whole shape is not significant; that of places is."
    return f"{sentence} Largest: {place.largest}." if place.largest else sentence


def _sees(answer: Answer, comparison: Comparison, seen: Seen) -> str:
    step, per = step_of(answer, comparison.title)
    parts = []
    if seen.whole is not None:
        parts.append(f"{step * seen.whole:.2g} mm over the whole shape")
    if seen.displacement is not None and np.isfinite(seen.displacement):
        parts.append(f"{step * seen.displacement:.2g} mm at a particle")
    if not parts:
        return ""
    return f"four of five such cohorts show {' or '.join(parts)}{per}."


def covariate_rows(answer: Answer) -> Iterator[tuple[str, ...]]:
    """Yield title with its step, D with its interval, p, share of the surface, size with its interval, p."""
    for effect in answer.overall.covariates:
        test, size = effect.test, effect.size
        step, _ = step_of(answer, effect.title)
        known = size is not None and size.p is not None and np.isfinite(size.value)
        yield (
            f"{effect.title}{f' (per {step:g})' if effect.title in answer.steps else ''}",
            effect_text(effect.distance, step=step) if effect.distance is not None else _NONE,
            p_text(effect.p_adjusted, test.permutations),
            f"{share_of_surface(answer, effect):.1f}",
            effect_text(size, edge=answer.edge, step=step, sign=True)
            if size is not None and known
            else _NONE,
            p_text(size.p, size.permutations) if size is not None and size.p is not None else _NONE,
        )


def _covariate_texts(answer: Answer) -> Iterator[tuple[str, ...]]:
    """Yield a text on each covariate: its title, its effect on shape, and that on size."""
    for title, far, p, _, size, of_size in covariate_rows(answer):
        yield (
            title,
            ", ".join(
                [f"D = {far}"] * (far != _NONE) + [p] + [f"size {size} mm, {of_size}"] * (size != _NONE)
            ),
        )


def cautions(answer: Answer) -> list[str]:
    """Return the cautions of an answer, each once with the comparisons that it is about."""
    titles: dict[str, list[str]] = {}
    for comparison in answer.comparisons:
        for sentence in caution_sentences(comparison, answer.names):
            titles.setdefault(sentence, []).append(comparison.title)
    raised = [f"{'; '.join(titles[sentence])}: {sentence}" for sentence in titles]
    return [*raised, *answer.notes]


def answer_text(answer: Answer, sentences: Sequence[Finding]) -> str:
    """Return an answer as it is printed, with its findings."""
    lines = [answer.question.title, *(f"  {line}" for line in answer.table_lines)]
    for finding in sentences:
        lines += [f"  {finding.title}", *(f"    {sentence}" for sentence in finding.sentences)]
    lines += [f"  {line}" for line in answer.further_lines]
    return "\n".join([*lines, *(f"  Caution: {caution}" for caution in cautions(answer)), f"  {CONTROLS}"])
