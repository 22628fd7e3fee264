"""A project's result as surfaces: VTP, PLY, STL, and binary glTF for slides, web pages and tablets."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb

from homolog.arrays import Array, FloatArray
from homolog.errors import InputError
from homolog.io.atomic import atomic_write
from homolog.io.meshes import write_mesh
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.results import Result, read_result, read_surfaces
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.procrustes import Alignment
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.mirroring import mirrors
from homolog.surfaces.nearest import nearest_particles
from homolog_app.exports.motion import Motion, group_motion, mode_motions
from homolog_app.exports.settings import MeshFormat, MeshSettings
from homolog_app.exports.tables import compare
from homolog_app.pictures import LIGHT
from homolog_app.rendering.colours import common_limit, diverging_colours, outward_displacement

__all__ = ["write_distances", "write_glb", "write_meshes"]


# glTF is in metres with y up and the viewer at +z: left is at the right, superior up, anterior in front.
_LPS_TO_GLTF = 0.001 * np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def write_glb(
    path: Path, mesh: TriangleMesh, colours: FloatArray, point_data: Mapping[str, Array] | None = None
) -> None:
    """Write a coloured surface; vertices are in LPS millimetres, and the node rotates and scales them.

    Parameters
    ----------
    path : Path
        File, replaced atomically.
    mesh : TriangleMesh
        The surface.
    colours : (3,) or (V, 3) array
        Red, green, blue in [0, 1].
    point_data : mapping of str to (V,) array, optional
        Values at the vertices, stored as attributes ``_NAME``.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    tints = np.empty((len(mesh.vertices), 4), dtype=np.uint8)
    tints[:, :3], tints[:, 3] = np.rint(255.0 * np.broadcast_to(colours, mesh.vertices.shape)), 255
    values: dict[str, Any] = {
        f"_{name.upper()}": np.asarray(item, dtype=np.float32) for name, item in (point_data or {}).items()
    }
    surface = trimesh.Trimesh(
        mesh.vertices,
        mesh.faces,
        vertex_normals=mesh.vertex_normals,
        vertex_colors=tints,
        vertex_attributes=values,
        process=False,
    )
    surface.metadata["coordinates"] = "LPS millimetres"
    placed = np.eye(4)
    placed[:3, :3] = _LPS_TO_GLTF
    scene = trimesh.Scene()
    scene.add_geometry(surface, node_name=path.stem, geom_name=path.stem, transform=placed)
    with atomic_write(path) as part:
        part.write_bytes(export_glb(scene, include_normals=True))  # type: ignore[no-untyped-call]


def write_distances(path: Path, surface: TriangleMesh, other: TriangleMesh) -> str:
    """Write a surface with the distance of each vertex from another surface, and describe both directions.

    Parameters
    ----------
    path : Path
        A ``.vtp`` or ``.ply`` file with the values ``distance_mm``, negative inside the other surface.
    surface, other : TriangleMesh
        Surfaces in the same coordinates.

    Returns
    -------
    str
        Mean, bias, root mean square, 95th percentile and maximum of both directions [mm].

    Raises
    ------
    InputError
        If the file has another suffix, or can't be written.
    """
    from homolog.surfaces.comparison import surface_distances  # loads Warp

    if path.suffix.lower() not in (".vtp", ".ply"):
        raise InputError(f"{path}: distances are written as .vtp or .ply; choose such a name")
    forward, backward = surface_distances(surface, other), surface_distances(other, surface)
    write_mesh(path, surface, {"distance_mm": forward.signed})
    both = (
        f"{name}: mean {item.mean:.4g} mm, signed mean {item.bias:.4g}, root mean square {item.rms:.4g}, "
        f"95 % {item.percentile(95.0):.4g}, maximum {item.maximum:.4g}"
        for name, item in (("distance", forward), ("backwards", backward))
    )
    return "\n".join([*both, f"Hausdorff distance {max(forward.maximum, backward.maximum):.4g} mm"])


@dataclass(frozen=True, slots=True, eq=False)
class _Named:
    """A surface with a description, and values at its vertices by name; `displacement_mm` is outward."""

    name: str
    what: str
    mesh: TriangleMesh
    values: dict[str, Array]


def write_meshes(
    project: ProjectFolder,
    folder: Path,
    settings: MeshSettings,
    groups: tuple[str, str, str] | None = None,
    tick: Tick = no_tick,
) -> int:
    """Write surfaces in world coordinates, and ``meshes.csv`` with a description of each file.

    Parameters
    ----------
    project : ProjectFolder
        A project with a result.
    folder : Path
        An existing empty folder.
    settings : MeshSettings
        Format and selection of surfaces.
    groups : (str, str, str), optional
        Column and two groups, whose means are written with displacement, p and q.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    int
        The number of surfaces.

    Raises
    ------
    InputError
        If there is no result or group, or the folder can't be written to.
    """
    tick(0.0, "reading the result")
    result = read_result(project)
    surfaces = list(_model_surfaces(result, settings))
    if groups is not None:
        surfaces += _group_surfaces(result, groups, settings, part_of(tick, 0.1, 0.6))
    if settings.subjects:
        surfaces += _subject_surfaces(project, result)
    limit = common_limit(
        [np.zeros(1), *(surface.values["displacement_mm"] for surface in surfaces if surface.values)]
    )
    stems = file_stems([surface.name for surface in surfaces])
    rows = []
    for index, (item, stem) in enumerate(zip(surfaces, stems, strict=True)):
        tick(0.6 + 0.4 * index / len(surfaces), f"writing {item.name}")
        path = folder / f"{stem}.{settings.format}"
        _write(path, item, limit, settings.format)
        kept = () if settings.format is MeshFormat.STL else tuple(item.values)
        rows.append([path.name, item.what, "LPS mm, aligned", " ".join(kept)])
    write_table(folder / "meshes.csv", ["file", "what", "coordinates", "values_at_vertices"], rows)
    return len(surfaces)


def _model_surfaces(result: Result, settings: MeshSettings) -> Iterator[_Named]:
    yield _Named("mean", "mean shape", result.mean_surface, {})
    count = len(ShapeModel().fit(result.world, names=result.names).explained_variance_)
    modes = range(1, min(settings.modes, count) + 1)
    motions = mode_motions(result, modes, settings.deviations) if modes else []
    for number, motion in enumerate(motions, start=1):
        for amount, side in ((motion.low, "minus"), (motion.high, "plus")):
            name = f"mode_{number:02d}_{side}_{settings.deviations:g}sd"
            yield _Named(name, motion.label(amount), motion.at(amount), _moved(motion, amount))


def _group_surfaces(
    result: Result, groups: tuple[str, str, str], settings: MeshSettings, tick: Tick
) -> list[_Named]:
    """Return both means with the difference of the second from the first and its significance."""
    motion = group_motion(result, *groups)
    # The means have the alignment of the run; so have the tested shapes.
    study = compare(
        result, groups, settings.permutations, settings.seed, tick, alignment=Alignment.AS_IT_LIES
    )
    local = study.overall.pointwise
    nearest = nearest_particles(result.mean_surface, result.world.mean(axis=0))
    tests = {"p": local.p[nearest], "p_fwe": local.p_fwe[nearest], "q": local.q[nearest]}
    column, *names = groups
    return [
        _Named(
            f"{column}_{name}_mean",
            f"mean of {column} {name}; displacement from {names[0]} to {names[1]}",
            motion.at(amount),
            _moved(motion, 1.0) | tests,
        )
        for name, amount in zip(names, (0.0, 1.0), strict=True)
    ]


def _subject_surfaces(project: ProjectFolder, result: Result) -> list[_Named]:
    """Return the subjects' surfaces with the displacement of the nearest particle from the mean."""
    away = result.world - result.world.mean(axis=0)
    surfaces = []
    mirrored = mirrors(result.alignments).tolist()
    for name, mesh, particles, moved, odd in zip(
        result.names, read_surfaces(project), result.world, away, mirrored, strict=True
    ):
        nearest = nearest_particles(mesh, particles)
        values = {"displacement_mm": outward_displacement(mesh, moved[nearest])}
        surfaces.append(
            _Named(
                f"subject_{name}",
                f"subject {name}{', mirrored' if odd else ''}; displacement from the mean",
                mesh,
                values,
            )
        )
    return surfaces


def _moved(motion: Motion, amount: float) -> dict[str, Array]:
    move = amount * motion.displacement
    return {"displacement_mm": outward_displacement(motion.start, move), "displacement_vector_mm": move}


def _write(path: Path, _named: _Named, limit: float, kind: MeshFormat) -> None:
    if kind is MeshFormat.STL:
        write_mesh(path, _named.mesh)
    elif kind is MeshFormat.GLB:
        outward = _named.values.get("displacement_mm")
        colours = np.array(LIGHT.surface) if outward is None else diverging_colours(outward, limit)
        flat = {name: values for name, values in _named.values.items() if values.ndim == 1}
        write_glb(path, _named.mesh, colours, flat)
    else:
        write_mesh(path, _named.mesh, _named.values)
