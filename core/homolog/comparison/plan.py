"""Planning of a study: power for an effect of given size and place, needed numbers, and stability of a pilot.

Studies are simulated from the pilot: shapes of two groups are normal with the covariance of the pilot's
residuals, the effect is added to those of the second one, and each study is tested as any comparison is. The
power is a probit function of the square root of the number of subjects, fitted to all simulated studies.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy import optimize, stats

from homolog.arrays import BoolArray, FloatArray
from homolog.comparison.sample import Sample
from homolog.comparison.seeds import results_of_seeds
from homolog.errors import InputError
from homolog.geometry import farthest_point_sampling
from homolog.io.atomic import write_text
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.design import Hypothesis, group_design
from homolog.statistics.parallel import parallel_analysis
from homolog.statistics.procrustes import Alignment, aligned, rms_radii
from homolog.statistics.randomization import Randomization, shape_test
from homolog.statistics.shape_model import principal_components
from homolog.surfaces.nearest import normals_at

__all__ = [
    "FEWEST",
    "PLAN_FOLDER",
    "Plan",
    "PlanSettings",
    "Power",
    "Stability",
    "bump",
    "plan_project",
    "plan_study",
    "power_curve",
]

FEWEST = 6
"""Subjects of a pilot beyond its groups."""
PLAN_FOLDER = "plan"
_FORMAT = 2
_WIDTH = 4.0
"""Default width of an effect [spacings of the particles]: narrower ones have few particles on them."""
_LEVEL = 0.05
_SUBSETS, _SHARE = 10, 0.8
"""Random parts of the pilot, and share of each group in them."""
_DRAWS = 999
"""Randomizations of a test of the pilot or a part of it."""
_FEWEST_PARTICLES = 16
_MOST_NEEDED = 1000
"""Largest number per group that is looked for."""


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """What is planned.

    Attributes
    ----------
    effect : float
        Height of the effect: a smooth bump in the second group [mm], outward if positive.
    width : float
        Full width at half maximum of the bump [mm].
    particle : int or None
        The place; by default the particle whose variation along the normal is the median.
    per_group : tuple of int
        Numbers per group for which studies are simulated.
    power : float
        Wanted power.
    alignment : Alignment
        Alignment of the comparison.
    studies : int
        Simulated studies of each number.
    permutations : int
        Randomizations in each of them.
    seed : int
        Same seed, same plan.
    """

    effect: float
    width: float
    particle: int | None = None
    per_group: tuple[int, ...] = (8, 12, 20, 30, 50, 80)
    power: float = 0.8
    alignment: Alignment = Alignment.SHAPE
    studies: int = 100
    permutations: int = 199
    seed: int = 0

    def check(self, particles: int) -> None:
        """Raise InputError if a value is invalid for this number of particles."""
        is_number = isinstance(self.effect, int | float | np.number)
        if not (is_number and np.isfinite(self.effect) and self.effect != 0.0):
            raise InputError(f"effect {self.effect}: must be a number of mm other than 0")
        if not self.width > 0.0:
            raise InputError(f"width {self.width:g}: must be positive")
        if self.particle is not None and not 0 <= self.particle < particles:
            raise InputError(f"particle {self.particle}: there are particles 0 to {particles - 1}")
        if not self.per_group or min(self.per_group) < 4:
            raise InputError("numbers per group: give one or more, each at least 4")
        if not _LEVEL < self.power < 1.0:
            raise InputError(f"power {self.power:g}: must be between {_LEVEL:g} and 1")
        if self.studies < 20 or self.permutations < 19:
            raise InputError("at least 20 studies and 19 permutations are needed for a power at 5 %")


@dataclass(frozen=True, slots=True)
class Power:
    """Power of studies with a number of subjects per group.

    Attributes
    ----------
    per_group : int
    whole, place : float
        Probability that the whole shape differs, and that the effect is found at its place (corrected over
        the surface).
    size_mm : float
        Difference in size that is found with the wanted power [mm].
    place_range : (float, float)
        90 % interval of `place`, since a pilot knows the variance of a place only roughly.
    """

    per_group: int
    whole: float
    place: float
    size_mm: float
    place_range: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Stability:
    """How far parts and repetitions of the pilot agree with the whole.

    Attributes
    ----------
    over : str
        What was varied: subjects, particles or seeds.
    modes : tuple of (float, float)
        Median and least agreement of each mode above chance: the cosine between directions over subjects, and
        the correlation of scores over particles and seeds.
    map_agreement : (float, float) or None
        Median and least correlation of the map of the group difference; None without two groups.
    p_whole, p_place : (float, float) or None
        Least and largest p of the whole shape and of any place.
    repeats : int
    """

    over: str
    modes: tuple[tuple[float, float], ...]
    map_agreement: tuple[float, float] | None
    p_whole: tuple[float, float] | None
    p_place: tuple[float, float] | None
    repeats: int


@dataclass(frozen=True, slots=True)
class Plan:
    """Power, needed numbers and stability of a study that was simulated from a pilot.

    Attributes
    ----------
    settings : PlanSettings
        With the particle that was chosen.
    subjects : int
        Subjects of the pilot.
    between : tuple of str
        The pilot's groups whose means were removed; empty if it is one group.
    point : (float, float, float)
        The place on the mean shape [mm].
    spread_mm : float
        Standard deviation of the particle there, along the normal [mm].
    rows : tuple of Power
        Power for each number.
    needed_whole, needed_place : int or None
        Numbers per group for the wanted power; None if more than 1000.
    needed_place_range : (int or None, int or None)
        90 % interval of `needed_place`.
    stability : tuple of Stability
    """

    settings: PlanSettings
    subjects: int
    between: tuple[str, ...]
    point: tuple[float, float, float]
    spread_mm: float
    rows: tuple[Power, ...]
    needed_whole: int | None
    needed_place: int | None
    needed_place_range: tuple[int | None, int | None]
    stability: tuple[Stability, ...]

    @property
    def record(self) -> dict[str, Any]:
        """Return the plan as a record for JSON."""
        return asdict(self)

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> "Plan":
        """Return the plan of a `record`."""

        def pair(values: Sequence[float] | None) -> tuple[float, float] | None:
            return None if values is None else (values[0], values[1])

        settings = record["settings"]
        return cls(
            **record
            | {
                "settings": PlanSettings(
                    **settings
                    | {
                        "per_group": tuple(settings["per_group"]),
                        "alignment": Alignment(settings["alignment"]),
                    }
                ),
                "between": tuple(record["between"]),
                "point": tuple(record["point"]),
                "rows": tuple(
                    Power(**row | {"place_range": tuple(row["place_range"])}) for row in record["rows"]
                ),
                "needed_place_range": tuple(record["needed_place_range"]),
                "stability": tuple(
                    Stability(
                        item["over"],
                        tuple((mode[0], mode[1]) for mode in item["modes"]),
                        pair(item["map_agreement"]),
                        pair(item["p_whole"]),
                        pair(item["p_place"]),
                        item["repeats"],
                    )
                    for item in record["stability"]
                ),
            }
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Pilot:
    """A pilot: aligned shapes (M, N, 3), the residuals of their groups, and what was removed."""

    shapes: FloatArray
    labels: tuple[str, ...]
    groups: tuple[str, ...]
    residuals: FloatArray
    dof: int

    @classmethod
    def of(cls, shapes: FloatArray, labels: Sequence[str], alignment: Alignment) -> "_Pilot":
        own, groups = aligned(shapes, alignment), tuple(dict.fromkeys(labels))
        if len(own) - len(groups) < FEWEST:
            raise InputError(
                f"a pilot of {len(own)} subjects in {len(groups)} groups is too small to plan from; "
                f"{FEWEST} subjects beyond the groups are needed, and 20 or more are better"
            )
        return cls.of_aligned(own, labels)

    @classmethod
    def of_aligned(cls, shapes: FloatArray, labels: Sequence[str]) -> "_Pilot":
        groups, residuals = tuple(dict.fromkeys(labels)), np.array(shapes)
        for group in groups:
            members = [label == group for label in labels]
            residuals[members] -= shapes[members].mean(axis=0)
        return cls(shapes, tuple(labels), groups, residuals, len(shapes) - len(groups))


def bump(mean: FloatArray, normals: FloatArray, particle: int, height: float, width: float) -> FloatArray:
    """Return a smooth bump around a particle, as displacements (N, 3) [mm]; the opposite wall stays.

    Parameters
    ----------
    mean, normals : (N, 3) array
        Particles of the mean shape [mm], and unit normals there.
    particle : int
    height, width : float
        Height along the normals, and full width at half maximum [mm].
    """
    gaps = np.square(mean - mean[particle]).sum(axis=1)
    shape = np.exp(-4.0 * np.log(2.0) * gaps / width**2) * (normals @ normals[particle] > 0.0)
    displaced: FloatArray = height * shape[:, None] * normals
    return displaced


def plan_study(
    shapes: FloatArray,
    labels: Sequence[str],
    normals: FloatArray,
    settings: PlanSettings,
    *,
    sizes: FloatArray | None = None,
    seeds: Sequence[FloatArray] = (),
    tick: Tick = no_tick,
) -> Plan:
    """Plan a study of two groups from a pilot.

    Parameters
    ----------
    shapes : (M, N, 3) array
        Particles of the pilot [mm], in one frame.
    labels : sequence of str
        Group of each subject; their means are removed. All equal for a pilot of one group.
    normals : (N, 3) array
        Unit normals at the particles of the mean shape.
    settings : PlanSettings
    sizes : (M,) array, optional
        Sizes of the shapes [mm]; by default those of `shapes`.
    seeds : sequence of (M, n, 3) arrays
        Particles of the same subjects from other seeds.
    tick : Tick

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If the pilot is too small, or a setting invalid.
    """
    settings.check(shapes.shape[1])
    pilot = _Pilot.of(shapes, labels, settings.alignment)
    mean = pilot.shapes.mean(axis=0)
    along = np.einsum("mni,ni->mn", pilot.residuals, normals)
    spreads = np.sqrt(np.square(along).sum(axis=0) / pilot.dof)
    particle = settings.particle
    if particle is None:
        particle = int(np.argsort(spreads, kind="stable")[len(spreads) // 2])
    effect = bump(mean, normals, particle, settings.effect, settings.width)
    near = np.linalg.norm(effect, axis=1) >= 0.5 * abs(settings.effect)
    sizes = rms_radii(shapes) if sizes is None else sizes
    within = sum(float(np.square(own - own.mean()).sum()) for own in _by_group(sizes, pilot))
    size_spread = float(np.sqrt(within / pilot.dof))
    hits = _simulated(pilot, mean, effect, near, settings, part_of(tick, 0.0, 0.8))
    whole, place = (power_curve(settings.per_group, hits[:, index], settings.studies) for index in (0, 1))
    # The variance of a place has a chi-squared distribution with the pilot's degrees of freedom.
    least, most = np.sqrt(stats.chi2.ppf([0.05, 0.95], pilot.dof) / pilot.dof).tolist()
    rows = tuple(
        Power(
            number,
            whole(number),
            place(number),
            size_spread * _found_in_t_test(number, settings.power),
            (place(number, least), place(number, most)),
        )
        for number in settings.per_group
    )
    x, y, z = mean[particle].tolist()
    known = {name: getattr(settings, name) for name in PlanSettings.__dataclass_fields__}
    return Plan(
        PlanSettings(**known | {"particle": particle}),
        len(shapes),
        pilot.groups if len(pilot.groups) > 1 else (),
        (x, y, z),
        float(spreads[particle]),
        rows,
        _needed(whole, settings.power),
        _needed(place, settings.power),
        (_needed(place, settings.power, most), _needed(place, settings.power, least)),
        _stability(pilot, normals, seeds, settings, part_of(tick, 0.8, 1.0)),
    )


class _Curve(Protocol):
    """Power by the number per group, and by how much smaller the deviation is than the pilot's."""

    def __call__(self, number: int, smaller: float = 1.0) -> float: ...


def power_curve(numbers: Sequence[int], hits: Sequence[int] | FloatArray, studies: int) -> _Curve:
    """Return the power as a function of the number of subjects per group.

    It is ``0.05 + 0.95 Φ(a + b √n)``, whose most likely a and b ≥ 0 follow from all simulated studies; b is
    inversely proportional to the standard deviation.

    Parameters
    ----------
    numbers : sequence of int
        Numbers per group.
    hits : sequence of int
        Studies of each number that find the effect.
    studies : int
        Simulated studies of each number.
    """
    roots, counts = np.sqrt(np.asarray(numbers, np.float64)), np.asarray(hits, np.float64)

    def power(values: FloatArray, roots: FloatArray) -> FloatArray:
        rate: FloatArray = _LEVEL + (1.0 - _LEVEL) * stats.norm.cdf(values[0] + values[1] * roots)
        return rate

    def loss(values: FloatArray) -> float:
        rates = np.clip(power(values, roots), 1e-12, 1.0 - 1e-12)
        return -float(counts @ np.log(rates) + (studies - counts) @ np.log1p(-rates))

    fits = [
        optimize.minimize(
            loss, np.array([start, 0.5]), method="L-BFGS-B", bounds=[(-20.0, 20.0), (0.0, 20.0)]
        )
        for start in (-4.0, -2.0, 0.0)
    ]
    best = min(fits, key=lambda fit: float(fit.fun)).x

    def curve(number: int, smaller: float = 1.0) -> float:
        return float(power(best, np.array([smaller * np.sqrt(number)]))[0])

    return curve


def _needed(power: _Curve, wanted: float, smaller: float = 1.0) -> int | None:
    """Return the least number per group with a power, or None."""
    if power(_MOST_NEEDED, smaller) < wanted:
        return None
    low, high = 3, _MOST_NEEDED
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(middle, smaller) >= wanted else (middle, high)
    return high


def _found_in_t_test(per_group: int, power: float) -> float:
    """Return the difference of two groups, in standard deviations, that a t-test finds with a power."""
    dof, root = 2 * per_group - 2, np.sqrt(0.5 * per_group)
    limit = float(stats.t.ppf(1.0 - 0.5 * _LEVEL, dof))

    def lacking(difference: float) -> float:
        return float(stats.nct.sf(limit, dof, difference * root)) - power

    return float(optimize.brentq(lacking, 0.0, 20.0))


def _by_group(values: FloatArray, pilot: _Pilot) -> list[FloatArray]:
    return [values[[label == group for label in pilot.labels]] for group in pilot.groups]


def _simulated(
    pilot: _Pilot, mean: FloatArray, effect: FloatArray, near: BoolArray, settings: PlanSettings, tick: Tick
) -> FloatArray:
    """Return how many studies of each number find the effect (n, 2): in the whole shape, at its place."""
    root = pilot.residuals.reshape(len(pilot.residuals), -1) / np.sqrt(pilot.dof)
    hits = np.zeros((len(settings.per_group), 2))
    total, done = float(sum(settings.per_group) * settings.studies), 0
    for index, number in enumerate(settings.per_group):
        design = group_design(["first"] * number + ["second"] * number, ["first", "second"])
        for study in range(settings.studies):
            tick(done / total, f"simulating studies of {number} subjects per group")
            random = np.random.default_rng([settings.seed, number, study])
            drawn = random.normal(size=(2 * number, len(root))) @ root
            drawn = drawn.reshape(2 * number, *mean.shape) + mean
            drawn[number:] += effect
            p_whole, p_places = _tests(
                aligned(drawn, settings.alignment), design, settings.permutations, study
            )
            hits[index] += p_whole <= _LEVEL, p_places[near].min() <= _LEVEL
            done += number
    return hits


def _tests(shapes: FloatArray, design: Hypothesis, draws: int, seed: int) -> tuple[float, FloatArray]:
    """Return the p of the whole shape, and those of the particles, corrected over the surface (N,)."""
    rows = shapes.reshape(len(shapes), -1)
    whole = shape_test(shapes, design, draws=draws, seed=seed).p
    return whole, Randomization(design, rows, draws=draws, seed=seed).surface(shapes).p_fwe


@dataclass(frozen=True, slots=True, eq=False)
class _Model:
    """What is compared between repetitions: directions or scores of modes (K, ·), the map (N,), and p."""

    modes: FloatArray
    map: FloatArray | None = None
    p: tuple[float, float] | None = None


def _stability(
    pilot: _Pilot, normals: FloatArray, seeds: Sequence[FloatArray], settings: PlanSettings, tick: Tick
) -> tuple[Stability, ...]:
    """Return the agreement of parts of the pilot, fewer particles, and other seeds with the pilot."""
    labels = np.array(pilot.labels)
    members = [np.flatnonzero(labels == group) for group in pilot.groups]
    nuisance = np.linalg.qr(np.stack([labels == group for group in pilot.groups], axis=1).astype(float))[0]
    kept = max(parallel_analysis(pilot.shapes, nuisance=nuisance).n_retained, 1)
    random = np.random.default_rng(settings.seed)
    parts, thinned, others = [], [], []
    for number in range(_SUBSETS):
        tick(0.5 * number / _SUBSETS, "parts of the pilot")
        chosen = [random.permutation(own)[: max(round(_SHARE * len(own)), 2)] for own in members]
        rows = np.sort(np.concatenate(chosen))
        part = _Pilot.of_aligned(pilot.shapes[rows], labels[rows].tolist())
        parts.append(_Model(_directions(part, kept), _map(part, normals), _p(part)))
    mean = pilot.shapes.mean(axis=0)
    for number, share in enumerate((2, 4)):
        tick(0.5 + 0.1 * number, "fewer particles")
        if (particles := len(mean) // share) >= _FEWEST_PARTICLES:
            fewer = _Pilot.of_aligned(pilot.shapes[:, farthest_point_sampling(mean, particles)], pilot.labels)
            thinned.append(_Model(_scores(fewer, kept), None, _p(fewer)))
    for number, shapes in enumerate(seeds):
        tick(0.7 + 0.3 * number / len(seeds), "other seeds")
        again = _Pilot.of_aligned(aligned(shapes, settings.alignment), pilot.labels)
        others.append(_Model(_scores(again, kept), None, _p(again)))
    scores = _Model(_scores(pilot, kept))
    return tuple(
        _agreement(over, whole, models)
        for over, whole, models in (
            ("80 % of the subjects", _Model(_directions(pilot, kept), _map(pilot, normals)), parts),
            ("half, quarter of particles", scores, thinned),
            ("other seeds", scores, others),
        )
        if models
    )


def _directions(pilot: _Pilot, kept: int) -> FloatArray:
    """Return the directions of the leading modes of the residuals (K, 3N), of unit length."""
    directions = principal_components(pilot.residuals.reshape(len(pilot.residuals), -1), divisor=pilot.dof)[1]
    rows = directions[:kept].reshape(min(kept, len(directions)), -1)
    unit: FloatArray = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return unit


def _scores(pilot: _Pilot, kept: int) -> FloatArray:
    """Return the scores of the leading modes (K, M), of unit length."""
    rows = pilot.residuals.reshape(len(pilot.residuals), -1)
    scores = principal_components(rows, divisor=pilot.dof)[0][:, :kept].T
    unit: FloatArray = scores / np.linalg.norm(scores, axis=1, keepdims=True)
    return unit


def _map(pilot: _Pilot, normals: FloatArray) -> FloatArray | None:
    """Return the difference of two groups along the normals (N,), None without two groups."""
    if len(pilot.groups) != 2:
        return None
    first, second = (item.mean(axis=0) for item in _by_group(pilot.shapes, pilot))
    difference: FloatArray = np.einsum("ni,ni->n", second - first, normals)
    return difference


def _p(pilot: _Pilot) -> tuple[float, float] | None:
    """Return p of the whole shape and the least one of all places for the difference of two groups."""
    if len(pilot.groups) != 2:
        return None
    whole, places = _tests(pilot.shapes, group_design(pilot.labels, pilot.groups), _DRAWS, 0)
    return whole, float(places.min())


def _agreement(over: str, whole: _Model, models: Sequence[_Model]) -> Stability:
    """Summarize how repetitions agree with the whole; each mode with the one that is most like it."""
    likest = np.array([np.abs(whole.modes @ model.modes.T).max(axis=1) for model in models])
    maps = [
        float(np.corrcoef(whole.map, model.map)[0, 1])
        for model in models
        if whole.map is not None and model.map is not None
    ]
    known = np.array([model.p for model in models if model.p is not None])
    p_whole, p_place = ((float(p.min()), float(p.max())) for p in known.T) if len(known) else (None, None)
    return Stability(
        over,
        tuple((float(np.median(own)), float(own.min())) for own in likest.T),
        (float(np.median(maps)), min(maps)) if maps else None,
        p_whole,
        p_place,
        len(models),
    )


def plan_project(
    project: ProjectFolder,
    effect: float,
    *,
    width: float | None = None,
    column: str = "group",
    between: Sequence[str] = (),
    tick: Tick = no_tick,
    **given: Any,  # noqa: ANN401 - checked by PlanSettings
) -> Plan:
    """Plan a study from a project's result; the plan is stored and read again for the same question.

    Parameters
    ----------
    project : ProjectFolder
    effect : float
        Height of the effect [mm].
    width : float, optional
        Full width at half maximum [mm]; by default four spacings of the particles.
    column : str
        Column of the pilot's groups, whose means are removed; a project without its values is one group.
    between : sequence of str
        Groups of the pilot; all by default.
    tick : Tick
    **given
        Further attributes of `PlanSettings`.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If the project has no result, or the pilot is too small, or a setting is invalid.
    """
    result = read_result(project)
    sample = Sample.of(result)
    spacing = float(np.sqrt(result.mean_surface.area / result.world.shape[1]))
    settings = PlanSettings(effect, _WIDTH * spacing if width is None else width, **given)
    settings.check(result.world.shape[1])
    labels = sample.texts(column) if column in sample.columns or column != "group" else []
    chosen = list(between) or [value for value in dict.fromkeys(labels) if value]
    if missing := [value for value in between if value not in labels]:
        raise InputError(f"column {column!r}: no subject is in {missing[0]!r}")
    rows = [index for index, value in enumerate(labels) if value in chosen] or list(range(len(result.names)))
    own = [labels[index] if chosen else "" for index in rows]
    names = [result.names[index] for index in rows]
    seeds = []
    for again in results_of_seeds(project):
        if set(names) <= set(again.names):
            order = [again.names.index(name) for name in names]
            seeds.append(Sample.of(again).compared(settings.alignment)[order])
    record = project.read().result
    assert record is not None, "a result was read"
    key = [_FORMAT, record.fingerprint, asdict(settings), names, own, len(seeds)]
    path = project.folder / PLAN_FOLDER / "plan.json"
    if (stored := _stored(path, key)) is not None:
        return stored
    surface = result.mean_surface
    plan = plan_study(
        sample.compared(settings.alignment)[rows],
        own,
        normals_at(surface, result.world.mean(axis=0)),
        settings,
        sizes=rms_radii(sample.own_size[rows]),
        seeds=seeds,
        tick=tick,
    )
    path.parent.mkdir(exist_ok=True)
    write_text(path, json.dumps({"key": key, "plan": plan.record}, indent=1))
    return plan


def _stored(path: Path, key: list[Any]) -> Plan | None:
    """Return the stored plan of a key; None if there is none, or it is damaged."""
    try:
        stored = json.loads(path.read_text("utf-8"))
        return Plan.from_record(stored["plan"]) if stored["key"] == json.loads(json.dumps(key)) else None
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return None
