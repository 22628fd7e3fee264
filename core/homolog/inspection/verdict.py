"""How much of a model's variation is reproducible: a verdict in one of three words."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import ArrayLike, FloatArray, IntArray
from homolog.correspondence.entropy.weight import independent_parts
from homolog.errors import InputError
from homolog.io.atomic import write_text
from homolog.io.bounded import read_json
from homolog.io.project import ProjectFolder
from homolog.io.results import read_surface
from homolog.memory import OnDemand
from homolog.progress import Tick, no_tick, part_of
from homolog.registration.icp import ANOTHER, OrientedPoints, candidates, oriented_points
from homolog.registration.typicality import angles_from, typical_rotation
from homolog.statistics.checks import checked_particles
from homolog.statistics.evaluation import (
    description_length,
    leave_one_out_residual,
    left_out_shapes,
    modes_above_chance,
)
from homolog.surfaces.closest import distances_to, thickness
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import MIRROR, mirrors
from homolog.surfaces.nearest import nearest_particles, normals_at
from homolog.surfaces.orientation import FILES_SPREAD, INDEPENDENT, TURNED_FILES
from homolog.surfaces.topology import check_mesh

__all__ = [
    "Agreement",
    "Verdict",
    "Word",
    "agreement",
    "judge",
    "read_verdict",
    "refuse_unusable",
    "write_verdict",
]

_SEEN = 100
"""Most subjects that are judged; of more, these are drawn at random."""
_LOOKED_AT = 1024
"""Most particles that are judged; their neighbours are among all."""
_TARGETS = 25
"""Most subjects to which the particles of one are carried."""
_MEASURED = 25
"""Most surfaces that are measured."""
_POINTS = 2000
"""About how many points of a surface are measured."""
_NEIGHBOURS = 9
"""Particles from which a particle's displacement is predicted: thrice the three unknowns of a linear map."""
_RING = 6
"""Mean number of neighbours of a particle on a surface (Euler)."""
_ANY_TURN = float(np.pi**2 / 3.0)
"""Variance of a uniform angle [rad²]."""
_AS_WELL = float((1.0 / TURNED_FILES - 1.0) ** (1.0 / INDEPENDENT))
"""Ratio of distances, each the mean of 20 independent ones, at which the odds of the closer fit are those
of a file that lies as most do."""
_PERMUTATIONS = 399
"""With 399 permutations, chance exceeds them all once in 400 times."""
_EVEN = 5.0 / (18.0 * np.sqrt(3.0))
"""Mean squared distance of a plane from the nearest point of a hexagonal lattice, per area of a point."""
_SCATTERED = 1.0 / np.pi
"""The same for points placed at random."""


class Word(StrEnum):
    """The verdict in a word."""

    SOUND = "sound"
    DOUBTFUL = "doubtful"
    UNUSABLE = "not usable"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a model is good for, the numbers it follows from, and what to do.

    Lengths are those of aligned shapes.

    Attributes
    ----------
    word : Word
    cause, remedy : str
        Why the model is not sound, and what to do; empty for a sound model.
    reproducible : float
        Share of a subject's variance that all modes of the other subjects reproduce.
    chance : float
        The largest such share of 399 models in which each particle was permuted among the subjects.
    local, local_chance : float
        Share of a particle's variance that the mean of its six neighbours reproduces, and the largest such
        share of these models.
    residual, spread : float
        Root mean square distance of a left-out subject's particles from their best fit by the others' modes,
        and from the others' mean [mm].
    modes : int
        Number of modes above chance, by parallel analysis.
    local_error : float
        Mean error of a particle carried from one subject to another by its neighbours [mm], as landmarks
        are. It does not tell if all particles of a region slide together. NaN with ten particles or fewer.
    turning : float
        Distance, root mean square, by which particles of two subjects are apart since their surfaces do not
        tell how they are turned against each other [mm]; NaN without surfaces or with two subjects.
    uncertain : float
        Share of the subjects that fit a typical one about as well in another orientation, if their files do
        not tell which is right; 0 if they do. NaN without surfaces or alignments.
    exchanged : float
        That error if each particle were exchanged at random with its neighbours [mm].
    spacing : float
        Mean distance of neighbouring particles [mm].
    surface, surface_spread : float
        Distance of a left-out subject's surface from its best fit by the others' modes, and from the others'
        mean, root mean square in both directions [mm]; NaN without surfaces.
    unevenness : float
        Mean squared distance of the surface from the nearest particle: 0 as in an even layout, 1 as with
        particles scattered at random; NaN without surfaces.
    thin : float
        Share of the surface whose walls are thinner than the spacing; NaN without surfaces.
    wall : float
        Median thickness [mm]; NaN without surfaces.
    precision : float
        Least displacement that counts in `description_length`: a hundredth of the spacing [mm].
    description_length : float
        Sum over the modes, in the sense of Davies et al. (2002) [nat].
    seeds, seeds_spacing : float
        See `Agreement`; NaN if the model was not placed again.
    """

    word: Word
    cause: str
    remedy: str
    reproducible: float
    chance: float
    local: float
    local_chance: float
    residual: float
    spread: float
    modes: int
    local_error: float
    turning: float
    uncertain: float
    exchanged: float
    spacing: float
    surface: float
    surface_spread: float
    unevenness: float
    thin: float
    wall: float
    precision: float
    description_length: float
    seeds: float = np.nan
    seeds_spacing: float = np.nan

    @property
    def landmark(self) -> float:
        """Expected error of a landmark [mm], of particles among their neighbours and of turned subjects."""
        return float(np.hypot(self.local_error, np.nan_to_num(self.turning)))

    @property
    def is_sound(self) -> bool:
        """Whether the word is *sound*."""
        return self.word is Word.SOUND

    @property
    def is_usable(self) -> bool:
        """Whether the model may be analysed: the word is not *not usable*."""
        return self.word is not Word.UNUSABLE

    @property
    def line(self) -> str:
        """The verdict in one line: word, cause and remedy, numbers."""
        return " ".join(filter(None, [f"Verdict: {self.word}.", self.cause, self.remedy, self.numbers]))

    @property
    def summary(self) -> str:
        """Word and numbers."""
        return f"{self.word.capitalize()}. {self.numbers}"

    @property
    def numbers(self) -> str:
        """The numbers in sentences."""
        texts = []
        if np.isfinite(self.reproducible):
            modes = "1 mode" if self.modes == 1 else f"{self.modes} modes"
            texts.append(
                f"{_percent(self.reproducible)} of the variation is reproducible (by chance up to "
                f"{_percent(self.chance)}), {modes} above chance."
            )
        if np.isfinite(self.surface):
            texts.append(
                f"A left-out surface is reproduced to {self.surface:.2g} mm of {self.surface_spread:.2g} mm."
            )
        if np.isfinite(self.landmark):
            texts.append(
                f"Landmark error about {self.landmark:.2g} mm, particles {self.spacing:.2g} mm apart."
            )
        if np.isfinite(self.seeds):
            texts.append(
                f"Another seed differs by {self.seeds:.2g} mm (particles {self.seeds_spacing:.2g} mm apart)."
            )
        return " ".join(texts)

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Names and values of all numbers, for tables."""
        return [
            ("variation that is reproducible", _percent(self.reproducible)),
            ("the same by chance, at most", _percent(self.chance)),
            ("variation shared with neighbours", _percent(self.local)),
            ("the same by chance, at most", _percent(self.local_chance)),
            ("left-out particles, residual of spread", _of(self.residual, self.spread)),
            ("left-out surface, residual of spread", _of(self.surface, self.surface_spread)),
            ("modes above chance", str(self.modes)),
            ("landmark error, expected", _length(self.landmark)),
            ("of it, of particles among neighbours", _length(self.local_error)),
            ("if neighbours were exchanged", _length(self.exchanged)),
            ("of it, of turned subjects", _length(self.turning)),
            ("subjects that may be turned over", _percent(self.uncertain)),
            ("distance of neighbouring particles", _length(self.spacing)),
            ("surface with walls below that", _percent(self.thin)),
            ("median thickness", _length(self.wall)),
            ("unevenness (0 even, 1 random)", _plain(self.unevenness)),
            ("description length", f"{self.description_length:.1f} nat"),
            ("difference of another seed", _length(self.seeds)),
        ]


def judge(
    particles: ArrayLike,
    surfaces: Sequence[TriangleMesh] | None = None,
    *,
    alignments: FloatArray | None = None,
    again: "Agreement | None" = None,
    seed: int = 0,
    tick: Tick = no_tick,
) -> Verdict:
    """Judge a model by what its subjects tell about each other.

    Limits are those of chance. A model is not usable if particles are carried no better than after exchanging
    them at random with their neighbours, or if they agree neither with those of other subjects nor with their
    neighbours better than after permuting each among the subjects. It is doubtful if they don't agree with
    other subjects, if more than half of the variation is not reproducible, or may come from turns that the
    surfaces do not tell, if neither surfaces nor files tell how a subject is turned, if carried particles are
    off by more than half the distance of their neighbours, so that the next one may be meant, or if the
    surface is covered less evenly than by chance, or if particles
    that another seed placed differ by more than half their distance.

    Parameters
    ----------
    particles : (M, N, 3) array_like
        Aligned positions of corresponding particles [mm].
    surfaces : sequence of M TriangleMesh, optional
        The subjects' surfaces in the same coordinates.
    alignments : (M, 4, 4) array, optional
        From the files' coordinates to these. By how much files are turned against each other limits how much
        the subjects are; without them any turn may be.
    again : Agreement, optional
        With particles that another seed placed.
    seed : int
        Same seed, same verdict.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If the particles are not those of two or more subjects.
    """
    shapes = checked_particles(particles)
    generator = np.random.default_rng(seed)
    if len(shapes) > _SEEN:
        chosen = np.sort(generator.choice(len(shapes), _SEEN, replace=False))
        shapes = shapes[chosen]
        if surfaces is not None:
            of_all = surfaces
            surfaces = OnDemand(len(chosen), lambda index: of_all[int(chosen[index])])
        alignments = None if alignments is None else alignments[chosen]
    tick(0.0, "judging the model")
    number = shapes.shape[1]
    some = np.sort(generator.choice(number, min(number, _LOOKED_AT), replace=False))
    error, exchanged, spacing = _carried(shapes, some)
    tick(0.2, "judging the model")
    against = _against_chance(shapes[:, some], generator, part_of(tick, 0.2, 0.5))
    tick(0.5, "judging the model")
    modes = modes_above_chance(shapes) if len(shapes) > 2 else 0
    measured = _Measured()
    if surfaces is not None:
        turns = None if alignments is None else _turns_of_files(alignments)
        measured = _measure(shapes, surfaces, spacing, turns, generator, part_of(tick, 0.6, 1.0))
    precision = 0.01 * spacing
    verdict = Verdict(
        word=Word.SOUND,
        cause="",
        remedy="",
        **dataclasses.asdict(against),
        modes=modes,
        local_error=error,
        exchanged=exchanged,
        spacing=spacing,
        **dataclasses.asdict(measured),
        precision=precision,
        description_length=description_length(shapes, precision) if precision > 0.0 else np.nan,
        **({} if again is None else dataclasses.asdict(again)),
    )
    word, cause, remedy = _word(verdict, *shapes.shape[:2])
    return dataclasses.replace(verdict, word=word, cause=cause, remedy=remedy)


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well a model agrees with particles that were placed again.

    Attributes
    ----------
    seeds : float
        Mean distance of these particles on other subjects from where the model carries them [mm].
    seeds_spacing : float
        Mean distance of neighbours among them [mm].
    """

    seeds: float
    seeds_spacing: float


def agreement(particles: FloatArray, again: FloatArray) -> Agreement:
    """Return the agreement of a model's particles (M, N, 3) with others (M, n, 3) on the same subjects [mm].

    The model carries a point from one subject to another by the displacements of its nearest particles there,
    which a linear fit along the surface predicts, as in the error of a landmark.
    """
    distances, spacing = [], []
    for index, (own, points) in enumerate(zip(particles, again, strict=True)):
        neighbours = _nearest(own, points, min(_NEIGHBOURS, len(own)))[1]
        weights = _linear_weights(points, own[neighbours])
        moved = points + np.einsum("nk,mnkj->mnj", weights, (particles - own)[:, neighbours])
        distances.append(np.delete(np.linalg.norm(moved - again, axis=2), index, axis=0))
        spacing.append(_nearest(points, points, min(_RING + 1, len(points)))[0][:, 1:].mean())
    return Agreement(float(np.mean(distances)), float(np.mean(spacing)))


def worst_of(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Return the verdict on the structure, of several by name, that is worst; its cause names it."""
    order = list(Word)
    name, verdict = max(verdicts.items(), key=lambda item: order.index(item[1].word))
    return replace(verdict, cause=f"{name}: {verdict.cause}") if verdict.cause else verdict


def write_verdict(project: ProjectFolder, verdict: Verdict, world: FloatArray) -> None:
    """Store the verdict on a project's particles (M, N, 3) in aligned coordinates."""
    numbers = {
        name: None if isinstance(value, float) and not np.isfinite(value) else value
        for name, value in dataclasses.asdict(verdict).items()
    }
    content = {"particles": _digest(world), **numbers}
    write_text(_file(project), json.dumps(content, indent=2) + "\n")


def read_verdict(project: ProjectFolder, world: FloatArray, tick: Tick = no_tick) -> Verdict:
    """Return the verdict on a project's particles; older results, and changed ones, are judged now.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result; the verdict is stored if this program has it locked.
    world : (M, N, 3) array
        Its particles in aligned coordinates.
    tick : Tick
        Progress and cancellation.
    """
    stored = _stored(_file(project), _digest(world))
    if stored is not None:
        return stored
    record = project.read().result
    subjects = record.subjects if record is not None else []

    def surface(index: int) -> TriangleMesh:
        mesh = read_surface(project, subjects[index])
        check_mesh(mesh, subjects[index].name, may_open=True)
        return mesh.placed(np.array(subjects[index].alignment))

    alignments = np.array([item.alignment for item in subjects]) if subjects else None
    try:
        surfaces = OnDemand(len(subjects), surface) if subjects else None
        verdict = judge(world, surfaces, alignments=alignments, tick=tick)
    except InputError:  # imported without surfaces, or one is damaged
        verdict = judge(world, tick=tick)
    if project.is_held:
        with suppress(InputError):  # a full or read-only disk
            write_verdict(project, verdict, world)
    return verdict


def refuse_unusable(project: ProjectFolder, world: FloatArray, tick: Tick = no_tick) -> None:
    """Raise InputError if the verdict on a project's particles is that they are not usable."""
    verdict = read_verdict(project, world, tick)
    if verdict.word is Word.UNUSABLE:
        raise InputError(
            f"{project.folder}: the model is not usable. {verdict.cause} {verdict.remedy} To use it all the "
            "same, add the option anyway"
        )


def _file(project: ProjectFolder) -> Path:
    return project.model / "verdict.json"


def _digest(world: FloatArray) -> str:
    return hashlib.sha256(np.ascontiguousarray(world).tobytes()).hexdigest()


def _stored(path: Path, digest: str) -> Verdict | None:
    """Return the stored verdict; None if there is none for these particles."""
    try:
        content = read_json(path, "verdict")
        if content.pop("particles") != digest:
            return None
        word, modes = Word(content.pop("word")), int(content.pop("modes"))
        cause, remedy = str(content.pop("cause")), str(content.pop("remedy"))
        numbers = {name: np.nan if value is None else float(value) for name, value in content.items()}
        return Verdict(word=word, cause=cause, remedy=remedy, modes=modes, **numbers)
    except (InputError, KeyError, TypeError, ValueError):
        return None


def _word(numbers: Verdict, subjects: int, particles: int) -> tuple[Word, str, str]:
    """Return the word, its cause and its remedy."""
    if numbers.local_error >= numbers.exchanged:
        return (
            Word.UNUSABLE,
            f"Corresponding particles are as far apart as if neighbours were exchanged at random "
            f"({numbers.exchanged:.2g} mm){_walls(numbers)}.",
            _remedy_of_noise(numbers, particles),
        )
    by_chance = numbers.reproducible <= numbers.chance
    if by_chance and numbers.local <= numbers.local_chance:
        return (
            Word.UNUSABLE,
            "Particles vary as by chance: they agree neither with other subjects nor with their neighbours.",
            "Place them again, add subjects, or choose another structure: these differ by noise only.",
        )
    if numbers.local_error > 0.5 * numbers.spacing:
        return (
            Word.DOUBTFUL,
            "The error of a particle exceeds half the distance of its neighbours: the next one may "
            f"be meant{_walls(numbers)}.",
            _remedy_of_noise(numbers, particles),
        )
    if numbers.seeds > 0.5 * numbers.seeds_spacing:
        return (
            Word.DOUBTFUL,
            "Another seed places particles elsewhere, by more than half their distance.",
            "Give landmarks, add subjects, or compare the results of several seeds.",
        )
    if subjects < 3:
        return (
            Word.DOUBTFUL,
            "Two subjects don't tell what is reproducible.",
            "Add subjects.",
        )
    if by_chance or numbers.reproducible < 0.5:
        return (
            Word.DOUBTFUL,
            "The subjects reproduce each other no better than by chance."
            if by_chance
            else "Less than half of the variation is reproducible.",
            f"Add subjects: each of these {subjects} still differs in its own way.",
        )
    if numbers.uncertain > 0.0:
        return (
            Word.DOUBTFUL,
            f"The files' rotations differ, and {_percent(numbers.uncertain)} of the subjects fit as well "
            "when they are turned over.",
            "Check how these subjects lie, and give all files one orientation, or landmarks.",
        )
    if numbers.turning**2 > numbers.spread**2:  # the distance of two subjects has twice the variance of one
        return (
            Word.DOUBTFUL,
            "The surfaces do not tell how the subjects are turned against each other: more than half of the "
            "variation may come from that.",
            "Give landmarks, or take the files' rotations as they are (alignment center, Procrustes off).",
        )
    if numbers.unevenness > 1.0:
        return (
            Word.DOUBTFUL,
            f"Particles cover the surface less evenly than by chance ({numbers.unevenness:.2g} times the "
            "squared distance).",
            "Use more particles, or a smaller ensemble weight.",
        )
    return Word.SOUND, "", ""


def _walls(numbers: Verdict) -> str:
    if not numbers.thin > 0.5:
        return ""
    return f"; {_percent(numbers.thin)} of the surface has walls thinner than the distance of particles"


def _remedy_of_noise(numbers: Verdict, particles: int) -> str:
    others = "give landmarks, smooth fine details, or choose a structure without them"
    if numbers.thin > 0.5:  # spacing goes with the root of the number
        enough = particles * (numbers.spacing / numbers.wall) ** 2
        return f"Use more particles (about {float(f'{enough:.1g}'):.0f} for the walls), {others}."
    return f"{others[0].upper()}{others[1:]}."


def _carried(shapes: FloatArray, some: IntArray) -> tuple[float, float, float]:
    """Return errors of some carried particles, as they are and if neighbours were exchanged, and the spacing.

    The displacement of a particle from one subject to another is predicted by a linear fit, along the
    surface, to those of its neighbours. If the errors of neighbours are independent, that of the prediction
    is 1 + |w|² times that of a particle, w being the weights of the fit (Gasser, Sroka, Jennen-Steinmetz
    1986).
    """
    count, particles = shapes.shape[:2]
    near = min(_RING, particles - 1)
    if near < 1:
        return np.nan, np.nan, np.nan
    errors, exchanged, spacing = np.zeros(count), np.zeros(count), np.zeros(count)
    for index, own in enumerate(shapes):
        distances, neighbours = _nearest(own, own[some], min(_NEIGHBOURS + 1, particles))
        spacing[index] = distances[:, 1 : near + 1].mean()
        ring = own[neighbours[:, : near + 1]]
        exchanged[index] = np.linalg.norm(ring[:, :, None] - ring[:, None], axis=3).mean()
        if particles > _NEIGHBOURS:
            weights = _linear_weights(own[some], own[neighbours[:, 1:]])
            others = np.setdiff1d(np.arange(count), [index])
            steps = np.unique(np.linspace(0, len(others) - 1, min(_TARGETS, len(others))).astype(np.int64))
            moved = shapes[others[np.roll(np.arange(len(others)), index)[steps]]] - own
            apart = moved[:, some] - np.einsum("nk,mnkj->mnj", weights, moved[:, neighbours[:, 1:]])
            scale = np.sqrt(1.0 + np.square(weights).sum(axis=1))
            errors[index] = (np.linalg.norm(apart, axis=2) / scale).mean()
    error = float(errors.mean()) if particles > _NEIGHBOURS else np.nan
    return error, float(exchanged.mean()), float(spacing.mean())


def _nearest(points: FloatArray, places: FloatArray, count: int) -> tuple[FloatArray, IntArray]:
    """Return distances and indices of the points nearest to places, both (n, count)."""
    distances, neighbours = KDTree(points).query(places, k=np.arange(1, count + 1))
    return np.asarray(distances, np.float64), np.asarray(neighbours, np.int64)


def _linear_weights(points: FloatArray, neighbours: FloatArray) -> FloatArray:
    """Return weights (N, K) of neighbours (N, K, 3) in linear fits along the surface, at points (N, 3)."""
    apart = neighbours - points[:, None]
    axes = np.linalg.svd(apart - apart.mean(axis=1, keepdims=True), full_matrices=False)[2][:, :2]
    along = np.einsum("nkj,naj->nka", apart, axes)
    columns = np.concatenate([np.ones((*along.shape[:2], 1)), along], axis=2)
    return np.asarray(np.linalg.pinv(columns)[:, 0], np.float64)


@dataclass(frozen=True, slots=True)
class _AgainstChance:
    """Numbers of a verdict that compare subjects."""

    reproducible: float = np.nan
    chance: float = np.nan
    local: float = np.nan
    local_chance: float = np.nan
    residual: float = np.nan
    spread: float = np.nan


def _against_chance(shapes: FloatArray, generator: np.random.Generator, tick: Tick) -> _AgainstChance:
    """Compare what subjects, and neighbours, reproduce of each other with models of permuted particles."""
    count, particles = shapes.shape[:2]
    if count < 3:
        return _AgainstChance()
    mean = shapes.mean(axis=0)
    near = _nearest(mean, mean, min(_RING + 1, particles))[1][:, 1:]
    chance = local_chance = 0.0
    for repeat in range(_PERMUTATIONS):
        tick(repeat / _PERMUTATIONS, "judging the model")
        order = generator.permuted(np.tile(np.arange(count), (particles, 1)), axis=1).T
        drawn = np.take_along_axis(shapes, order[..., None], axis=0)
        chance = max(chance, leave_one_out_residual(drawn).reproducible)
        local_chance = max(local_chance, _local(drawn, near))
    own = leave_one_out_residual(shapes)
    return _AgainstChance(
        reproducible=own.reproducible,
        chance=chance,
        local=_local(shapes, near),
        local_chance=local_chance,
        residual=own.residual,
        spread=own.spread,
    )


def _local(shapes: FloatArray, near: IntArray) -> float:
    """Return the share of a particle's variance that the mean of its neighbours (N, k) reproduces."""
    apart = shapes - shapes.mean(axis=0)
    total = float(np.square(apart).sum()) * (1.0 + 1.0 / max(near.shape[1], 1))
    if near.shape[1] == 0 or total == 0.0:
        return 0.0
    return float(1.0 - np.square(apart - apart[:, near].mean(axis=2)).sum() / total)


@dataclass(frozen=True, slots=True)
class _Measured:
    """Numbers of a verdict that need surfaces."""

    turning: float = np.nan
    uncertain: float = np.nan
    surface: float = np.nan
    surface_spread: float = np.nan
    unevenness: float = np.nan
    thin: float = np.nan
    wall: float = np.nan


def _measure(
    shapes: FloatArray,
    surfaces: Sequence[TriangleMesh],
    spacing: float,
    turns_of_files: FloatArray | None,
    generator: np.random.Generator,
    tick: Tick,
) -> _Measured:
    """Measure coverage, walls, and distances of surfaces that the other subjects reproduce."""
    count, particles = shapes.shape[:2]
    chosen = np.sort(generator.choice(count, min(count, _MEASURED), replace=False))
    mean = shapes.mean(axis=0)
    middle = int(np.square(shapes - mean).sum(axis=(1, 2)).argmin())
    template = _Template.of(surfaces[middle], shapes[middle]) if particles > _NEIGHBOURS else None
    fits = left_out_shapes(shapes) if count > 2 else None
    parts, prior, uncertain = _parts(shapes), _ANY_TURN, np.nan
    if turns_of_files is not None:
        prior = float(min(np.square(turns_of_files).mean() / 3.0 + FILES_SPREAD**2, _ANY_TURN))
        turned = turns_of_files > np.radians(ANOTHER)
        turnable = chosen[turned[chosen]] if 2 * np.count_nonzero(turned) < count else chosen
        uncertain = _uncertain(surfaces, middle, turnable, tick) / max(len(chosen) - 1, 1)
    gaps, thin, walls, apart, turns = [], [], [], [], []
    for place, index in enumerate(chosen):
        tick(place / len(chosen), "judging the model")
        mesh, own = surfaces[int(index)], shapes[index]
        owner = nearest_particles(mesh, own)
        squares = np.square(mesh.vertices - own[owner]).sum(axis=1)
        shares = mesh.vertex_areas / mesh.area
        gaps.append(float(shares @ squares) * particles / mesh.area)
        every = 1 + len(mesh.faces) // _POINTS
        depth, areas = thickness(mesh, every), mesh.face_areas[::every]
        thin.append(float(areas[depth < spacing].sum() / areas.sum()))
        walls.append(float(np.median(depth)))
        if fits is not None:
            turns.append(_turning(own, own - fits[index], normals_at(mesh, own), parts, prior))
        if template is not None and fits is not None:
            without = (count * mean - own) / (count - 1)
            apart.append([template.distance(fits[index], mesh), template.distance(without, mesh)])
    squared = np.square(apart).mean(axis=0) if apart else np.full(2, np.nan)
    return _Measured(
        turning=float(np.sqrt(2.0 * np.mean(turns))) if turns else np.nan,
        uncertain=uncertain,
        surface=float(np.sqrt(squared[0])),
        surface_spread=float(np.sqrt(squared[1])),
        unevenness=(float(np.mean(gaps)) - _EVEN) / (_SCATTERED - _EVEN),
        thin=float(np.mean(thin)),
        wall=float(np.median(walls)),
    )


def _parts(shapes: FloatArray) -> float:
    """Return how many parts of the surface vary independently."""
    apart = (shapes - shapes.mean(axis=0)).reshape(len(shapes), -1)
    return independent_parts(np.linalg.eigvalsh(apart @ apart.T), len(shapes))


def _turns_of_files(alignments: FloatArray) -> FloatArray:
    """Return by how much each file is turned against a typical one, (M,) [rad]."""
    proper = np.where(mirrors(alignments)[:, None, None], alignments @ MIRROR, alignments)
    return np.radians(angles_from(proper, typical_rotation(proper)))


def _uncertain(surfaces: Sequence[TriangleMesh], middle: int, turnable: IntArray, tick: Tick) -> int:
    """Return the number of some subjects that another orientation fits about as well as their own."""
    typical = _of_size_one(surfaces[middle])
    others = [int(index) for index in turnable if index != middle]
    count = 0
    for index in others:
        tick(0.0, "judging the model")
        given, *turned = candidates(_of_size_one(surfaces[index]), typical)
        count += any(fit.distance < _AS_WELL * given.distance for fit in turned)
    return count


def _of_size_one(surface: TriangleMesh) -> OrientedPoints:
    points = oriented_points(surface)
    return points.scaled(1.0 / points.size)


def _turning(
    particles: FloatArray, rest: FloatArray, normals: FloatArray, parts: float, prior: float
) -> float:
    """Return the mean squared displacement of particles (N, 3) by turns that their surface does not tell.

    A similarity fits a surface to the others by least squares of the distances along its normals. What others
    do not reproduce of these distances, `rest` (N, 3), is their error, in as many independent `parts`; the
    covariance of the turn follows from the normal equations, with the variance `prior` about each axis of a
    turn that nothing tells.
    """
    arms = particles - particles.mean(axis=0)
    growth = np.einsum("ni,ni->n", arms, normals)
    moves = np.column_stack([np.cross(arms, normals), normals, growth])
    matrix = moves.T @ moves / len(moves)
    turn, both, others = matrix[:3, :3], matrix[:3, 3:], matrix[3:, 3:]
    stiffness = turn - both @ np.linalg.pinv(others, hermitian=True) @ both.T
    variance = float(np.square(np.einsum("ni,ni->n", rest, normals)).mean()) / parts
    covariance = variance * np.linalg.pinv(stiffness + variance / prior * np.eye(3), hermitian=True)
    squares = arms.T @ arms / len(arms)
    return float(np.trace(covariance) * np.trace(squares) - np.trace(covariance @ squares))


@dataclass(frozen=True, slots=True, eq=False)
class _Template:
    """A surface that follows its particles, linearly around each.

    Attributes
    ----------
    mesh : TriangleMesh
    particles : (N, 3) array
    near : (V, K) int array
        The particles that move a vertex.
    weights : (V, K) array
    """

    mesh: TriangleMesh
    particles: FloatArray
    near: IntArray
    weights: FloatArray

    @classmethod
    def of(cls, mesh: TriangleMesh, particles: FloatArray) -> "_Template":
        """Return the template of a subject's surface and particles."""
        owner = nearest_particles(mesh, particles)
        near = _nearest(particles, particles, _NEIGHBOURS)[1][owner]
        centre = particles[owner]
        apart = particles[near] - centre[:, None]
        axes = np.linalg.svd(apart - apart.mean(axis=1, keepdims=True), full_matrices=False)[2][:, :2]
        columns = np.concatenate([np.ones((*near.shape, 1)), np.einsum("vkj,vaj->vka", apart, axes)], axis=2)
        at = np.concatenate(
            [np.ones((len(owner), 1)), np.einsum("vj,vaj->va", mesh.vertices - centre, axes)], axis=1
        )
        weights = np.einsum("va,vak->vk", at, np.linalg.pinv(columns))
        return cls(mesh, particles, near, weights)

    def distance(self, particles: FloatArray, mesh: TriangleMesh) -> float:
        """Return the distance of the surface moved to other particles from a mesh, both ways [mm]."""
        moved = particles - self.particles
        vertices = self.mesh.vertices + np.einsum("vk,vkj->vj", self.weights, moved[self.near])
        squares = 0.0
        for surface, other in (
            (TriangleMesh(vertices, self.mesh.faces), mesh),
            (mesh, TriangleMesh(vertices, self.mesh.faces)),
        ):
            some = slice(None, None, 1 + len(surface.vertices) // _POINTS)
            areas = surface.vertex_areas[some]
            squares += float(areas @ np.square(distances_to(other, surface.vertices[some])) / areas.sum())
        return float(np.sqrt(0.5 * squares))


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if np.isfinite(share) else "-"


def _length(value: float) -> str:
    return f"{value:.2g} mm" if np.isfinite(value) else "-"


def _of(rest: float, whole: float) -> str:
    return f"{rest:.2g} of {whole:.2g} mm ({_percent(rest / whole)})" if whole > 0.0 else "-"


def _plain(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "-"
