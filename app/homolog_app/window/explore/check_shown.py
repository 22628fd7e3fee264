"""What the views show while correspondence is checked."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.arrays import Array, FloatArray, IntArray
from homolog_app.window.scene.colour_scale import ColourScale
from homolog_app.window.scene.content import Content, Shown

if TYPE_CHECKING:
    from homolog.inspection import Inspection, ParticleEnergies

__all__ = ["ALONG", "ENERGIES", "STRAIGHT", "Distances", "Marks", "checked_scene"]

ALONG, STRAIGHT = "along the surface", "straight"
ENERGIES = {"sampling": "crowding", "ensemble": "positions unlike", "normals": "normals unlike"}
_PALE = (168, 168, 168)
_MARK = (214, 30, 130)
_TONES = np.array([(236, 231, 220), (38, 110, 140)], np.uint8)
# Viridis (Smith and van der Walt 2015) at nine places.
_VIRIDIS = np.array(
    [(68, 1, 84), (71, 44, 122), (59, 81, 139), (44, 113, 142), (33, 144, 141), (39, 173, 129),
     (92, 200, 99), (170, 220, 50), (253, 231, 37)], float,
)  # fmt: skip
_SIDES = 28
_RING, _LIFT = 0.5, 0.08
"""Radius of the ring around a marked particle and its height over the surface, in spacings."""


@dataclass(frozen=True, slots=True, eq=False)
class Distances:
    """Distances [mm] of every vertex of a subject's surface from a place on it: along it, and straight."""

    subject: int
    place: FloatArray
    along: FloatArray
    straight: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """What is to be seen.

    Attributes
    ----------
    show : str
        ``"places"``, ``"neighbours"``, ``"distances"``, a key of `ENERGIES`, or ``"texture"``.
    particle : int or None
        The chosen one; ringed on all shapes.
    subject : int or None
        Where further particles are ringed …
    others : (k,) int array
        … these.
    distances : Distances or None
    energies : ParticleEnergies or None
    texture : mapping of str to (V,) int array
        0 or 1 for each vertex of a subject's surface.
    """

    show: str
    particle: int | None
    subject: int | None
    others: IntArray
    distances: Distances | None = None
    energies: "ParticleEnergies | None" = None
    texture: Mapping[str, IntArray] | None = None


def checked_scene(
    subjects: Sequence[Content], inspection: "Inspection", names: Sequence[str], marks: Marks
) -> Shown:
    """Return what the views show."""
    number = {name: m for m, name in enumerate(names)}
    world = inspection.places.world
    if marks.show == "distances" and marks.distances is not None:
        return _distances(subjects, marks.distances, names)
    contents = [
        replace(one, lines=_rings(inspection, number[one.name], marks)) if one.name in number else one
        for one in subjects
    ]
    particles = {name: world[m] for m, name in enumerate(names)}
    if marks.show == "neighbours" and marks.particle is not None:
        return Shown(contents, None, *_neighbours(inspection, names, marks.particle, particles))
    if marks.show in ENERGIES and marks.energies is not None:
        return Shown(contents, None, *_energies(marks, names, particles))
    if marks.show == "texture" and marks.texture is not None:
        texture = marks.texture
        contents = [
            replace(one, colours=_TONES[texture[one.name]]) if one.name in texture else one
            for one in contents
        ]
        return Shown(contents)
    return Shown(contents)


def _neighbours(
    inspection: "Inspection", names: Sequence[str], particle: int, particles: Mapping[str, FloatArray]
) -> tuple[ColourScale, Mapping[str, FloatArray], Mapping[str, Array]]:
    places = inspection.places
    rows = [one[[particle]].toarray()[0] * s for one, s in zip(places.distances, places.spacing, strict=True)]
    limit = max(float(row.max()) for row in rows)
    scale = _scale(f"Distance from particle {particle} along the surface", "mm", 0.0, limit,
                   note="grey: farther than the table reaches")  # fmt: skip
    tints = {}
    for name, row in zip(names, rows, strict=True):
        tint = np.full((len(row), 3), _PALE, np.uint8)
        tint[row > 0.0] = scale.colours(row[row > 0.0])
        tint[particle] = _MARK
        tints[name] = tint
    return scale, particles, tints


def _energies(
    marks: Marks, names: Sequence[str], particles: Mapping[str, FloatArray]
) -> tuple[ColourScale, Mapping[str, FloatArray], Mapping[str, Array]]:
    values: FloatArray = getattr(marks.energies, marks.show)
    low, high = (float(one) for one in np.percentile(values, (1.0, 99.0)))
    title = f"{marks.show.capitalize()} energy of each particle"
    scale = _scale(title, "", low, max(high, low + 1e-9), "low", f"high: {ENERGIES[marks.show]}")
    tints = {name: scale.colours(row) for name, row in zip(names, values, strict=True)}
    return scale, particles, tints


def _distances(subjects: Sequence[Content], distances: Distances, names: Sequence[str]) -> Shown:
    name = names[distances.subject]
    own = next((one for one in subjects if one.name == name), None)
    if own is None:
        return Shown(subjects)
    scale = _scale(
        "Distance from the place", "mm", 0.0, float(distances.along.max()), note="one scale for both"
    )
    contents = [
        replace(own, name=f"{name}: {words}", raw=None, note="", colours=scale.colours(values), lines=None)
        for words, values in ((ALONG, distances.along), (STRAIGHT, distances.straight))
    ]
    place = {one.name: distances.place[None] for one in contents}
    return Shown(contents, 2, scale, place, np.array([_MARK], np.uint8))


def _rings(inspection: "Inspection", m: int, marks: Marks) -> FloatArray | None:
    """Return circles around the chosen particle, and around those that are marked on this subject only."""
    chosen = [] if marks.particle is None else [marks.particle]
    if m == marks.subject:
        chosen += [int(one) for one in marks.others if one != marks.particle]
    if not chosen:
        return None
    from homolog.inspection.neighbourhood import plane_of

    places = inspection.places
    scale = float(np.cbrt(np.linalg.det(places.alignments[m, :3, :3])))
    spacing = places.spacing[m] * scale
    angles = np.linspace(0.0, 2.0 * np.pi, _SIDES + 1)
    circle = _RING * spacing * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points, normals = places.world[m, chosen], places.normals[m, chosen]
    rings = (points + 2.0 * _LIFT * spacing * normals)[:, None] + circle @ plane_of(normals)
    return np.asarray(np.stack([rings[:, :-1], rings[:, 1:]], axis=2).reshape(-1, 2, 3))


def _scale(
    title: str, unit: str, low: float, high: float, low_words: str = "", high_words: str = "", note: str = ""
) -> ColourScale:
    stops = np.linspace(0.0, 1.0, len(_VIRIDIS))
    table = np.stack(
        [np.interp(np.linspace(0.0, 1.0, 256), stops, channel) for channel in _VIRIDIS.T], axis=1
    )
    return ColourScale(title, unit, low, high, np.rint(table).astype(np.uint8), low_words, high_words, note)
