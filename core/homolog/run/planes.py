"""Cutting planes and painted regions: placed on one subject and carried to the others by registration."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.cluster import each_read, read_apart
from homolog.cohort import Cohort, Subject, column_of
from homolog.correspondence.initialization.registration import Registration
from homolog.errors import InputError
from homolog.geometry import fit_similarity, inverse_matrices, scale_of, transform_points
from homolog.grooming import groom_cohort
from homolog.grooming.cuts import check_cuts
from homolog.grooming.subject import COARSE_VERTICES
from homolog.io.constraints import (
    COLUMN,
    cuts_of,
    parse_cuts,
    read_constraints,
    read_flags,
    read_painted,
    text_of,
)
from homolog.io.markups import read_markups
from homolog.progress import Tick, no_tick, part_of
from homolog.registration import align_cohort
from homolog.settings import GroomSettings
from homolog.surfaces.clipping import Ball, Cut, Plane, clipped
from homolog.surfaces.closest import closest_faces
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.simplify import simplified
from homolog.surfaces.topology import rim_numbers, rim_sides

__all__ = [
    "carried",
    "carried_cuts",
    "carry_cuts",
    "common_planes",
    "cut_cohort",
    "marked",
    "plane_across",
    "plane_along",
    "plane_through",
    "with_regions",
]

_ROUNDS = 200
_MOVED = 1e-5
"""Change of a pose, relative to the size, below which it is found."""
_SHIFTS = 10


def cut_cohort(
    cohort: Cohort,
    tick: Tick = no_tick,
    *,
    plane: tuple[str, str] | None = None,
    carry: str | None = None,
    landmarks: Sequence[str] | None = None,
    keep: float | None = None,
    end: Sequence[float] | None = None,
) -> Cohort:
    """Return a cohort with a cutting plane for every subject, in its column `cut`.

    At most one way is given; without one, `common_planes` places them.

    Parameters
    ----------
    cohort : Cohort
    tick : Tick
        Progress and cancellation.
    plane : (str, str), optional
        A subject and its plane as in the column; it is carried to the others.
    carry : str, optional
        A subject whose own planes and paint are carried to the others.
    landmarks : three of str, optional
        Names of the landmarks through which the planes pass.
    keep : float, optional
        Length that is kept along the long axis [mm].
    end : (3,) sequence, optional
        Direction of the end that is then kept [LPS]; by default the end that is far from the rim.

    Returns
    -------
    Cohort

    Raises
    ------
    InputError
        If a subject is unknown or can't be groomed, or a plane can't be placed.
    """
    source = plane[0] if plane is not None else carry
    own = next((item for item in cohort.subjects if item.name == source), None)
    if source is not None and own is None:
        raise InputError(f"{source}: is not one of the subjects; give one of {cohort.subjects[0].name}, …")
    if plane is not None and own is not None:
        own = replace(own, columns={**own.columns, COLUMN: plane[1]})
    given = () if own is None else cuts_of(own)
    if own is not None and not given:
        raise InputError(f"{own.name}: has no plane and no paint to be carried; place them first")
    whole = replace(cohort, subjects=tuple(_without_planes(item) for item in cohort.subjects))
    settings = GroomSettings()
    groomed = groom_cohort(whole, settings, tick=part_of(tick, 0.0, 0.4))
    meshes = [item.mesh for item in groomed]
    names = [item.name for item in groomed]
    if landmarks is not None:
        cuts: list[tuple[Cut, ...]] = [
            (plane_through(marked(subject, landmarks), mesh),)
            for subject, mesh in zip(cohort.subjects, meshes, strict=True)
        ]
    elif keep is not None:
        towards = None if end is None else np.array(end)
        cuts = [(plane_along(mesh, keep, towards),) for mesh in meshes]
    else:
        _, alignments = align_cohort(whole, groomed, settings, part_of(tick, 0.4, 0.6))
        coarse, rest = [item.coarse_mesh for item in groomed], part_of(tick, 0.6, 1.0)
        if own is None:
            cuts = [(plane,) for plane in common_planes(coarse, alignments, names, rest)]
        else:
            cuts = carried_cuts(given, names.index(own.name), coarse, alignments, names, rest)
    for name, mesh, items in zip(names, meshes, cuts, strict=True):
        check_cuts(name, items, mesh)
    return replace(
        cohort,
        subjects=tuple(
            replace(subject, columns={**_without_planes(subject).columns, COLUMN: text_of(items)})
            for subject, items in zip(cohort.subjects, cuts, strict=True)
        ),
    )


def with_regions(cohort: Cohort, pattern: str) -> Cohort:
    """Return a cohort with what files leave out of its subjects, in its column `cut`.

    Parameters
    ----------
    cohort : Cohort
    pattern : str
        Path with ``{subject}``: constraints of ShapeWorks (.json), a surface with an array ``cut`` or
        ``ffc_paint`` (.vtp), or a text with 0 (left out) or 1 for each
        vertex of the subject's mesh. A subject without a file stays as it is.

    Raises
    ------
    InputError
        If no file exists, or with a line for each that can't be used.
    """
    if "{subject}" not in pattern:
        raise InputError(f"{pattern}: give a path with {{subject}} in place of the name of each")
    files = {item.name: Path(pattern.replace("{subject}", item.name)) for item in cohort.subjects}
    if not any(file.is_file() for file in files.values()):
        raise InputError(f"{pattern}: no such file exists, such as {next(iter(files.values()))}")
    jobs = {
        item.name: (files[item.name], item.path) for item in cohort.subjects if files[item.name].is_file()
    }
    read, faults = dict[str, tuple[Cut, ...]](), dict[str, str]()
    for name, future in each_read(_cuts_beside, jobs, files, "reading", no_tick):
        try:
            read[name] = future.result()
        except InputError as error:
            faults[name] = str(error)
    if faults:
        raise InputError("\n".join(faults[item.name] for item in cohort.subjects if item.name in faults))
    subjects = []
    for subject in cohort.subjects:
        text = text_of(read.get(subject.name, ())) or column_of(subject.columns, COLUMN)
        subjects.append(replace(subject, columns={**_without_planes(subject).columns, COLUMN: text}))
    return replace(cohort, subjects=tuple(subjects))


def _cuts_beside(job: tuple[Path, Path]) -> tuple[Cut, ...]:
    """Read a file of constraints, a painted surface, or a number for each vertex of a shape's file."""
    file, shape = job
    if file.suffix.lower() == ".vtp":
        return read_painted(file)
    return read_constraints(file) if file.suffix.lower() == ".json" else read_flags(file, shape)


def _without_planes(subject: Subject) -> Subject:
    columns = {name: value for name, value in subject.columns.items() if name.strip().casefold() != COLUMN}
    return replace(subject, columns=columns)


def marked(subject: Subject, names: Sequence[str] = ()) -> FloatArray:
    """Return the positions of three landmarks of a subject, (3, 3); its first ones without names."""
    if subject.landmarks is None:
        raise InputError(f"{subject.name}: has no landmarks; save them as NAME.mrk.json next to the file")
    markups = read_apart(read_markups, subject.landmarks, subject.landmarks)
    if not names and len(markups.names) < 3:
        raise InputError(f"{subject.landmarks}: has fewer than three landmarks; place three for a plane")
    names = names or markups.names[:3]
    missing = [name for name in names if name not in markups.names]
    if missing:
        raise InputError(f"{subject.landmarks}: lacks the landmarks {', '.join(missing)}; place them")
    return np.array([markups.points[markups.names.index(name)] for name in names])


def carried_cuts(
    cuts: Sequence[Cut],
    source: int,
    meshes: Sequence[TriangleMesh],
    alignments: FloatArray,
    names: Sequence[str],
    tick: Tick = no_tick,
) -> list[tuple[Cut, ...]]:
    """Return the cuts of M surfaces that correspond to those of one of them; see `carried`."""
    result = []
    for k, mesh in enumerate(meshes):
        tick(k / len(meshes), f"carrying to {names[k]}")
        start = inverse_matrices(alignments[k][None])[0] @ alignments[source]
        result.append(tuple(cuts) if k == source else carried(cuts, meshes[source], mesh, start))
    return result


def carry_cuts(
    name: str, text: str, shapes: Mapping[str, tuple[TriangleMesh, FloatArray]], tick: Tick
) -> dict[str, str]:
    """Return the cuts of all subjects that correspond to those of one of them, as their tables have them.

    Parameters
    ----------
    name, text : str
        The subject, and its cuts.
    shapes : mapping of str to (TriangleMesh, (4, 4) array)
        The whole surface of each subject, and its alignment.
    tick : Tick
    """
    names = list(shapes)
    meshes = [simplified(mesh, COARSE_VERTICES) for mesh, _ in shapes.values()]
    places = np.stack([place for _, place in shapes.values()])
    carried = carried_cuts(parse_cuts(text, name), names.index(name), meshes, places, names, tick)
    texts = {other: text_of(cuts) for other, cuts in zip(names, carried, strict=True)}
    return texts | {name: text}


def plane_through(points: FloatArray, mesh: TriangleMesh) -> Plane:
    """Return the plane through three points that keeps the larger part of a surface.

    Raises
    ------
    InputError
        If the points lie on a line.
    """
    across = np.cross(points[1] - points[0], points[2] - points[0])
    if np.linalg.norm(across) <= 1e-6 * np.ptp(points, axis=0).max() ** 2:
        raise InputError("the three landmarks of a cutting plane lie on a line; choose others")
    plane = Plane.of(points[0], across)
    kept = mesh.vertex_areas[plane.heights(mesh.vertices) > 0.0].sum()
    return plane if kept >= 0.5 * mesh.area else Plane.of(points[0], -across)


def _axes_of(mesh: TriangleMesh) -> tuple[FloatArray, FloatArray]:
    """Return the centre (3,) of a surface and its principal axes (3, 3) as rows, the longest first."""
    weights = mesh.vertex_areas / mesh.area
    centre = weights @ mesh.vertices
    apart = mesh.vertices - centre
    return centre, np.linalg.eigh((apart * weights[:, None]).T @ apart)[1].T[::-1]


def plane_across(mesh: TriangleMesh, axis: int) -> Plane:
    """Return the plane through the centre of a surface, across its longest (0) … shortest (2) axis."""
    centre, axes = _axes_of(mesh)
    return Plane.of(centre, axes[axis])


def plane_along(mesh: TriangleMesh, length: float, towards: FloatArray | None = None) -> Plane:
    """Return the plane across a surface's long axis that keeps a length of it, measured from one end.

    Parameters
    ----------
    mesh : TriangleMesh
    length : float
        Length that is kept [mm].
    towards : (3,) array, optional
        Direction of the end that is kept [LPS]; by default the end that is far from the rims.

    Raises
    ------
    InputError
        If the surface is closed and no direction is given.
    """
    centre, (axis, *_) = _axes_of(mesh)
    if towards is None:
        rim = rim_sides(mesh.faces)[0]
        if not len(rim):
            raise InputError("is closed, so that neither end is known to be kept; give its direction")
        towards = centre - mesh.vertices[rim[:, 0]].mean(axis=0)
    axis = axis if axis @ towards > 0.0 else -axis
    end = float((mesh.vertices @ axis).max())
    return Plane.of(centre + (end - length - centre @ axis) * axis, axis)


def carried(
    cuts: Sequence[Cut], source: TriangleMesh, target: TriangleMesh, start: FloatArray
) -> tuple[Cut, ...]:
    """Return the cuts of a target that correspond to those of a source.

    Only the part that the source's planes keep is registered, which the target has as a whole: what lies
    beyond a plane decides nothing. The similarity of that part turns a plane; the surface near the cut,
    deformed onto the target, moves it on. On a smooth shaft a deformation hardly tells a tilt. Paint moves
    with the deformed surface below it.

    Parameters
    ----------
    cuts : sequence of Cut
        Of the source.
    source, target : TriangleMesh
        Surfaces.
    start : (4, 4) array
        Rough similarity from source to target.
    """
    part = source
    for cut in cuts:
        part = clipped(part, cut) if isinstance(cut, Plane) else part
    pose, size = start, float(np.ptp(part.vertices, axis=0).max())
    for _ in range(_ROUNDS):
        placed = part.placed(pose)
        matched = _matched(placed, target)
        step = fit_similarity(
            part.vertices, matched, scaling=True, mirrored=bool(np.linalg.det(start[:3, :3]) < 0.0)
        )
        moved = np.abs(transform_points(step, part.vertices) - placed.vertices).max()
        pose = step
        if moved < _MOVED * size:
            break
    placed = part.placed(pose)
    unit = 0.01 * float(np.sqrt(placed.area))
    scaled = [TriangleMesh(mesh.vertices / unit, mesh.faces) for mesh in (placed, target)]
    (deformed,) = Registration.of(scaled[0]).deform(scaled[1:], [scaled[0].vertices])
    moves = unit * deformed.mesh.vertices - placed.vertices
    return tuple(
        _moved_plane(cut, part, pose, moves, size)
        if isinstance(cut, Plane)
        else _moved_ball(cut, part, pose, moves)
        for cut in cuts
    )


def _moved_plane(plane: Plane, part: TriangleMesh, pose: FloatArray, moves: FloatArray, size: float) -> Plane:
    """Return a plane placed by a pose, and moved on as the surface (V, 3) near the cut."""
    heights = plane.heights(part.vertices)
    section = part.vertices[np.unique(rim_sides(part.faces)[0])]
    section = section[np.abs(plane.heights(section)) < 1e-3 * size]
    width = float(np.sqrt(np.square(section - section.mean(axis=0)).sum(axis=1).mean()))
    weights = np.exp(-0.5 * np.square(heights / width))
    there = plane.placed(pose)
    moved_on = np.average(moves @ there.direction, weights=weights)
    return Plane.of(there.point + moved_on * there.direction, there.direction)


def _moved_ball(ball: Ball, part: TriangleMesh, pose: FloatArray, moves: FloatArray) -> Ball:
    """Return a dab of a brush placed by a pose, and moved on as the surface (V, 3) below it."""
    faces, weights = closest_faces(part, ball.centre[None])
    there = ball.placed(pose)
    return replace(there, centre=there.centre + weights[0] @ moves[part.faces[faces[0]]])


def _matched(moving: TriangleMesh, target: TriangleMesh) -> FloatArray:
    """Return the closest points of a target to vertices whose normals agree there; else the vertices."""
    faces, weights = closest_faces(target, moving.vertices)
    corners = target.faces[faces]
    places, normals = (
        np.einsum("nk,nkd->nd", weights, values[corners])
        for values in (target.vertices, target.vertex_normals)
    )
    agree = np.einsum("nd,nd->n", normals, moving.vertex_normals) > 0.0
    return np.where(agree[:, None], places, moving.vertices)


def common_planes(
    meshes: Sequence[TriangleMesh], alignments: FloatArray, names: Sequence[str], tick: Tick = no_tick
) -> list[Plane]:
    """Return planes at corresponding places that cut off all rims: what is left is in every subject.

    The plane is placed at the rim of the subject that lacks most, and carried to the others; it is moved
    inward until it passes no rim.

    Parameters
    ----------
    meshes : sequence of M TriangleMesh
        Surfaces, each cut off at one end.
    alignments : (M, 4, 4) array
        Similarities to a common frame.
    names : sequence of str
        Of the subjects, for messages.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If a surface is closed, or no plane is found.
    """
    rims = [_rim(mesh) for mesh in meshes]
    closed = [name for name, rim in zip(names, rims, strict=True) if not len(rim)]
    if closed:
        raise InputError(f"{', '.join(closed)}: has no rim, so that no common plane is known; give one")
    own = [_plane_of_rim(mesh, rim) for mesh, rim in zip(meshes, rims, strict=True)]
    placed = [plane.placed(matrix) for plane, matrix in zip(own, alignments, strict=True)]
    direction = np.mean([plane.direction for plane in placed], axis=0)
    source = int(np.argmax([plane.point @ direction for plane in placed]))
    plane, scales = own[source], scale_of(alignments)
    for number in range(_SHIFTS):
        part = part_of(tick, number / _SHIFTS, (number + 1) / _SHIFTS)
        cuts = carried_cuts([plane], source, meshes, alignments, names, part)
        planes = [item for (item,) in cuts if isinstance(item, Plane)]
        over = np.array([item.heights(rim).max() for item, rim in zip(planes, rims, strict=True)])
        missed = float((over * scales / scales[source]).max())
        if missed <= 0.0:
            return planes
        plane = Plane.of(plane.point + 1.01 * missed * plane.direction, plane.direction)
    raise InputError("no plane was found that cuts off the rims of all subjects; place one on a subject")


def _rim(mesh: TriangleMesh) -> FloatArray:
    """Return the vertices of the longest rim (n, 3)."""
    sides, _ = rim_sides(mesh.faces)
    if not len(sides):
        return np.empty((0, 3))
    numbers = rim_numbers(sides)
    lengths = np.linalg.norm(np.diff(mesh.vertices[sides], axis=1)[:, 0], axis=1)
    longest = int(np.bincount(numbers, lengths).argmax())
    return np.asarray(mesh.vertices[sides[numbers == longest, 0]])


def _plane_of_rim(mesh: TriangleMesh, rim: FloatArray) -> Plane:
    """Return the plane along a rim that cuts all of it off."""
    centre = rim.mean(axis=0)
    normal = np.linalg.svd(rim - centre, full_matrices=False)[2][2]
    normal = normal if (mesh.vertices.mean(axis=0) - centre) @ normal > 0.0 else -normal
    return Plane.of(centre + float(((rim - centre) @ normal).max()) * normal, normal)
