"""Computations and views of the page *Check*."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog.errors import InputError
from homolog.geometry import scale_of
from homolog.io.project import ProjectFolder
from homolog.progress import Tick
from homolog_app.rendering.colours import ColourScale, viridis
from homolog_app.rendering.content import Numbers, SubjectContents, ViewContents

if TYPE_CHECKING:
    from homolog.inspection import Inspection, ParticleEnergies

__all__ = [
    "ALONG",
    "ENERGIES",
    "STRAIGHT",
    "Distances",
    "Marks",
    "checked_scene",
    "distances_on",
    "energies_of",
    "seen_from_mean",
    "textures_of",
]


ALONG, STRAIGHT = "along the surface", "straight"
ENERGIES = {"sampling": "crowding", "ensemble": "odd positions", "normals": "odd normals"}
_PALE = (168, 168, 168)
_MARK, _SECOND = (214, 30, 130), (0, 114, 178)
_LIGHT, _DARK = np.array([(236, 231, 220), (38, 110, 140)], float)
_ROUND = (1.0, 1.2, 1.6, 2.0, 2.4, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # numbers whose quarters have few digits
_SIDES = 28
_RING, _LIFT = 0.5, 0.15
"""Radius of the ring around a marked particle and its height above the surface, in particle spacings."""
_NAMED = 8
"""Largest number of marked particles with labels."""


@dataclass(frozen=True, slots=True, eq=False)
class Distances:
    """Distances [mm] of all vertices of a subject's surface from a point on it: geodesic and Euclidean.

    The point and its surface normal, (3,) each, are in aligned coordinates.
    """

    subject: int
    place: FloatArray
    normal: FloatArray
    along: FloatArray
    straight: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """Content of the views.

    Attributes
    ----------
    show : str
        ``"located"``, ``"neighbours"``, ``"distances"``, a key of `ENERGIES`, or ``"texture"``.
    particle : int or None
        The selected particle, with a ring on all shapes.
    subject : int or None
        The subject on which further particles have rings.
    others : (k,) int array
        These further particles.
    distances : Distances or None
    energies : ParticleEnergies or None
    texture : mapping of str to (V,) array
        A tone from 0 to 1 for each vertex of a subject's surface.
    """

    show: str
    particle: int | None
    subject: int | None
    others: IntArray
    distances: Distances | None = None
    energies: "ParticleEnergies | None" = None
    texture: Mapping[str, FloatArray] | None = None

    @property
    def pair(self) -> tuple[int, int] | None:
        """The two particles of a suspect, such as exchanged ones, which are marked on every shape."""
        pair = tuple(int(number) for number in self.others)
        return (pair[0], pair[1]) if len(pair) == 2 and self.particle in pair else None


def checked_scene(
    subjects: SubjectContents, inspection: "Inspection", names: Sequence[str], marks: Marks
) -> ViewContents:
    """Return the contents of the views."""
    number = {name: m for m, name in enumerate(names)}
    if marks.show == "distances" and marks.distances is not None:
        return _distances(subjects, inspection, marks.distances, names)
    contents = subjects.changed(
        lambda content: (
            replace(content, **_marked(inspection, number[content.name], marks), through=True)
            if content.name in number
            else content
        )
    )
    if marks.show == "neighbours" and marks.particle is not None:
        scale, tints = _neighbours(inspection, names, marks.particle)
        return ViewContents(contents, scale=scale, tints=tints)
    if marks.show in ENERGIES and marks.energies is not None:
        scale, tints = _energies(marks, names)
        return ViewContents(contents, scale=scale, tints=tints)
    if marks.show == "texture" and marks.texture is not None:
        texture = marks.texture
        contents = contents.changed(
            lambda content: (
                replace(content, colours=_toned(texture[content.name]))
                if content.name in texture
                else content
            )
        )
        return ViewContents(contents, particles={})
    if marks.pair is not None:
        return _in_two_colours(contents, inspection, names, marks.pair)
    return ViewContents(contents)


def _in_two_colours(
    contents: SubjectContents, inspection: "Inspection", names: Sequence[str], pair: tuple[int, int]
) -> ViewContents:
    """Colour two particles on every shape; their numbers have the same colours."""
    tint = np.full((inspection.located.world.shape[1], 3), _PALE, np.uint8)
    tint[list(pair)] = _MARK, _SECOND
    return ViewContents(contents, tints=dict.fromkeys(names, tint))


def _neighbours(
    inspection: "Inspection", names: Sequence[str], particle: int
) -> tuple[ColourScale, Mapping[str, Array]]:
    places = inspection.located
    rows = [
        matrix[[particle]].toarray()[0] * s
        for matrix, s in zip(places.distances, places.spacing, strict=True)
    ]
    limit = max(float(row.max()) for row in rows)
    title = f"Distance from particle {particle} along the surface"
    scale = _distance_scale(title, limit, "grey: beyond the range of the table")
    tints = {}
    for name, row in zip(names, rows, strict=True):
        tint = np.full((len(row), 3), _PALE, np.uint8)
        tint[row > 0.0] = scale.colours(row[row > 0.0])
        tint[particle] = _MARK
        tints[name] = tint
    return scale, tints


def _energies(marks: Marks, names: Sequence[str]) -> tuple[ColourScale, Mapping[str, Array]]:
    values: FloatArray = getattr(marks.energies, marks.show)
    low, high = (float(bound) for bound in np.percentile(values, (0.5, 99.5)))
    low = min(low, 0.0) if marks.show == "sampling" else 0.0
    title = f"{marks.show.capitalize()} energy by particle: {ENERGIES[marks.show]}"
    scale = ColourScale(title, "", low, max(high, low + 1e-9), viridis(), "low", "high")
    tints = {name: scale.colours(row) for name, row in zip(names, values, strict=True)}
    return scale, tints


def _distances(
    subjects: SubjectContents, inspection: "Inspection", distances: Distances, names: Sequence[str]
) -> ViewContents:
    name = names[distances.subject]
    own = subjects.named(name)
    if own is None:
        return ViewContents(subjects)
    limit = float(distances.along.max())
    scale = _distance_scale("Distance from the point", limit, "one scale for both")
    ring = _circles(inspection, distances.subject, distances.place[None], distances.normal[None])
    contents = [
        replace(
            own,
            name=f"{name}: {label}",
            raw=None,
            note="",
            colours=scale.colours(values),
            lines=ring,
            through=True,
        )
        for label, values in ((ALONG, distances.along), (STRAIGHT, distances.straight))
    ]
    return ViewContents(contents, columns=2, scale=scale, particles={})


def _marked(inspection: "Inspection", m: int, marks: Marks) -> dict[str, Any]:
    """Return rings and numbers of the selected particle, and of those marked on this subject only."""
    chosen = [] if marks.particle is None else [marks.particle]
    if marks.pair is not None:
        chosen = list(marks.pair)
    elif m == marks.subject:
        chosen += [int(other) for other in marks.others if other != marks.particle]
    if not chosen:
        return {}
    places = inspection.located
    points = places.world[m, chosen]
    colours = np.full((len(chosen), 3), _MARK, np.uint8)
    if marks.pair is not None:
        colours[1] = _SECOND
    beside = 1.2 * _RING * places.spacing[m] * float(scale_of(places.alignments[m]))
    named = len(chosen) if len(chosen) <= _NAMED else 1  # more numbers would overlap
    return {
        "lines": _circles(inspection, m, points, places.normals[m, chosen]),
        "numbers": Numbers(np.array(chosen[:named]), points[:named], colours[:named], beside),
    }


def _circles(inspection: "Inspection", m: int, points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return circles around points (n, 3) on a subject's surface, as segments (S, 2, 3)."""
    from homolog.inspection.neighbourhood import plane_of

    places = inspection.located
    spacing = places.spacing[m] * float(scale_of(places.alignments[m]))
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
    circle = _RING * spacing * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = (points + _LIFT * spacing * normals)[:, None] + circle @ plane_of(normals)
    return np.asarray(np.stack([rings[:, :-1], rings[:, 1:]], axis=2).reshape(-1, 2, 3))


def _toned(tones: FloatArray) -> Array:
    mixed: Array = np.rint(_LIGHT + tones[:, None] * (_DARK - _LIGHT)).astype(np.uint8)
    return mixed


def _distance_scale(title: str, limit: float, note: str) -> ColourScale:
    """Return the scale of distances: small ones are bright, large ones dark."""
    power = 10.0 ** np.floor(np.log10(max(limit, 1e-9)))
    high = next(factor * power for factor in _ROUND if factor * power >= limit)
    return ColourScale(title, "mm", 0.0, float(high), viridis()[::-1].copy(), note=note)


def distances_on(
    inspection: "Inspection", subject: int, place: FloatArray, name: str, tick: Tick
) -> Distances:
    """Return the distances of a subject's surface from a point (3,) on it, in aligned coordinates."""
    from homolog.geodesics import distances_from
    from homolog.inspection.located_particles import closest_points_on

    located = inspection.located
    mesh, matrix = located.meshes[subject], located.alignments[subject]
    local = np.linalg.solve(matrix[:3, :3], place - matrix[:3, 3])
    normals, faces, _ = closest_points_on(mesh, local[None])
    normal = matrix[:3, :3] @ normals[0]
    corners = mesh.faces[faces[0]]
    away = np.linalg.norm(mesh.vertices[corners] - local, axis=1)
    along = distances_from(mesh, corners.tolist(), away.tolist(), name=name, tick=tick).astype(np.float64)
    straight = np.linalg.norm(mesh.vertices - local, axis=1)
    return Distances(subject, place, normal / np.linalg.norm(normal), along, straight)


def energies_of(inspection: "Inspection", project: ProjectFolder, tick: Tick) -> "ParticleEnergies":
    """Return the contribution of each particle to the energies, with the settings of the project's result."""
    from homolog.inspection import particle_energies

    tick(0.0, "energies of particles")
    record = project.read().result
    if record is None:
        raise InputError(f"{project.folder}: the result no longer exists; run again")
    return particle_energies(inspection.located, inspection.consensus, record.settings.optimize)


def textures_of(
    inspection: "Inspection", names: tuple[str, ...], tick: Tick
) -> dict[str, dict[str, FloatArray]]:
    """Return both patterns for each subject: a tone from 0 to 1 for each vertex of its surface."""
    from homolog.inspection import carried_places, checkerboard, stripes

    patterns: dict[str, dict[str, FloatArray]] = {"checkerboard": {}, "stripes": {}}
    for m, name in enumerate(names):
        tick(m / len(names), f"texture on {name}")
        carried = carried_places(inspection.located, inspection.consensus, m)
        matrix = inspection.located.alignments[m]
        blur = inspection.located.meshes[m].mean_edge * float(scale_of(matrix))
        patterns["checkerboard"][name] = checkerboard(carried, inspection.consensus.shape, blur)
        patterns["stripes"][name] = stripes(carried, inspection.consensus.shape, blur)
    return patterns


def seen_from_mean(normals: FloatArray, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return normals (M, 3) to the right, up and towards an eye above their mean (3,), and angles [°]."""
    head = np.array([0.0, 0.0, 1.0]) if abs(mean[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
    right = np.cross(head, mean)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(mean, right), mean])
    return normals @ axes.T, np.degrees(np.arccos(np.clip(normals @ mean, -1.0, 1.0)))
