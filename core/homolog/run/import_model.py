"""Import of another program's model as a project with a result, for viewing and analysis."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.arrays import Array, FloatArray
from homolog.cluster import each_read
from homolog.cohort import MESH_SUFFIXES, Cohort, Subject, suffix_of
from homolog.errors import InputError, NumericalError
from homolog.geometry import fit_similarity, rms_radius, transform_points
from homolog.grooming import groom_subject
from homolog.grooming.distance_maps import read_distance_map
from homolog.io.markups import write_markups
from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.names import file_stems
from homolog.io.particle_array import particle_file, write_all_particles
from homolog.io.particles import read_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import IMPORTED, ProjectRecord, ResultRecord, ResultStructure, ResultSubject
from homolog.io.results import surface_file
from homolog.io.shapeworks import (
    ForeignModel,
    ForeignSubject,
    ShapeWorksProject,
    model_of_folder,
    model_of_project,
    read_shapeworks_file,
)
from homolog.io.shapeworks_export import save_source_metadata
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.run.fingerprints import versions
from homolog.run.shape_files import (
    surface_of_model,
    surface_of_structures,
    write_model,
    write_poses,
    write_surfaces,
)
from homolog.settings import GroomSettings, Method, OptimizeSettings, RunSettings
from homolog.statistics.procrustes import align
from homolog.statistics.reconstruction import MeanSurface, mean_surface, medoid
from homolog.statistics.relative_pose import relative_poses
from homolog.statistics.shape_model import ShapeModel
from homolog.surfaces.mesh import TriangleMesh, joined
from homolog.surfaces.simplify import simplified
from homolog.surfaces.surfels import surfels
from homolog.surfaces.topology import check_mesh

__all__ = ["domains_of", "import_model"]

_FEWEST = 4  # particles that define a shape


@dataclass(frozen=True, slots=True, eq=False)
class SubjectSurface:
    """A subject's surface in local coordinates, its file (None without one), and notes."""

    mesh: TriangleMesh
    path: Path | None
    notes: tuple[str, ...] = ()


def import_model(
    source: Path, project: ProjectFolder, *, domain: str | None = None, tick: Tick = no_tick
) -> list[str]:
    """Create a project with a result from a ShapeWorks project or a folder of particles.

    Parameters
    ----------
    source : Path
        A ``.swproj`` or ``.xlsx`` file, or a folder of ``.particles`` (``NAME.particles``, or
        ``NAME_local.particles`` and ``NAME_world.particles``).
    project : ProjectFolder
        The project to create; its folder is empty or missing.
    domain : str, optional
        An anatomy of several; by default all of them together.
    tick : Tick

    Returns
    -------
    list of str
        Notes, one line each.

    Raises
    ------
    InputError
        If the source can't be read, its subjects do not correspond, or the project can't be created.
    """
    source = Path(source)
    project.check_is_free()
    if project.exists:
        raise InputError(f"{project.folder}: is already a project; choose a new folder to import to")
    tick(0.0, f"reading {source.name}")
    file: ShapeWorksProject | None = None
    if source.is_dir():
        model = model_of_folder(source)
    elif source.suffix.lower() in (".swproj", ".xlsx"):
        file = read_shapeworks_file(source)
        if domain is None and len(file.domains) > 1:
            return _import_jointly(file, project, tick)
        domain = _chosen(file, domain)
        model = model_of_project(file, domain)
    else:
        raise InputError(
            f"{source}: is neither a ShapeWorks project (.swproj, .xlsx) nor a folder of particles"
        )
    _check(source, model)
    with project.locked():
        notes = _write(project, model, _prepared(model, part_of(tick, 0.1, 0.6)), part_of(tick, 0.6, 1.0))
        if file is not None and domain is not None:
            save_source_metadata(project, file, domain)
    return [*model.notes, *notes]


def _import_jointly(file: ShapeWorksProject, project: ProjectFolder, tick: Tick) -> list[str]:
    """Create a project of all anatomies together, with one of each within it; return notes."""
    models = {domain: model_of_project(file, domain) for domain in file.domains}
    names = [subject.name for subject in next(iter(models.values())).subjects]
    for domain, model in models.items():
        subjects = tuple(replace(item, name=name) for item, name in zip(model.subjects, names, strict=True))
        models[domain] = replace(model, subjects=subjects)
        _check(file.path, models[domain])
    count, parts = len(models), dict[str, _Prepared]()
    with project.locked():
        lines: list[str] = []
        for number, (domain, model) in enumerate(models.items()):
            own, now = (
                project.structure(domain),
                part_of(tick, number / (count + 1), (number + 1) / (count + 1)),
            )
            parts[domain] = _prepared(model, part_of(now, 0.0, 0.6))
            with own.locked():
                lines += [
                    f"{domain}: {line}" for line in _write(own, model, parts[domain], part_of(now, 0.6, 1.0))
                ]
                save_source_metadata(own, file, domain)
        lines += _write_jointly(project, models, parts, part_of(tick, count / (count + 1), 1.0))
        save_source_metadata(project, file, "")
    return [*next(iter(models.values())).notes, *lines]


def _write_jointly(
    project: ProjectFolder, models: Mapping[str, ForeignModel], parts: Mapping[str, "_Prepared"], tick: Tick
) -> list[str]:
    """Write the project of all anatomies; return notes."""
    model = next(iter(models.values()))
    names = [subject.name for subject in model.subjects]
    counts = [own.world.shape[1] for own in parts.values()]
    world, alignments, notes = _placed_jointly(list(parts.values()))
    stems = file_stems(names)
    surfaces = []
    for index in range(len(names)):
        items = [own.surfaces[index] for own in parts.values()]
        path = items[0].path if all(item.path is not None for item in items) else None
        surfaces.append(SubjectSurface(joined([item.mesh for item in items]), path))
    structures = {
        domain: _cohort(project.structure(domain), models[domain], stems, own.surfaces).subjects
        for domain, own in parts.items()
    }
    cohort = Cohort(
        tuple(
            Subject(
                subject.name,
                project.structure(next(iter(parts))).folder,
                subject.group,
                dict(subject.columns),
                structures={domain: own[index].path for domain, own in structures.items()},
            )
            for index, subject in enumerate(model.subjects)
        ),
        project.folder,
    )
    shapes = ShapeModel().fit(world, names=names)
    have = [index for index, item in enumerate(surfaces) if item.path is not None] or list(range(len(names)))
    pieces = [
        (count, [own.surfaces[index].mesh for index in have])
        for count, own in zip(counts, parts.values(), strict=True)
    ]
    surface = surface_of_structures(shapes, world[have], pieces, alignments[have], part_of(tick, 0.0, 0.3))
    record = _record(
        model, cohort, stems, surfaces, alignments, world, surface, dict(zip(parts, counts, strict=True))
    )
    ends = np.cumsum(counts)[:-1]
    with project.replacing_result() as new:
        local = np.concatenate([own.local for own in parts.values()], axis=1)
        write_all_particles(new, stems, local, world)
        for stem, item in zip(stems, surfaces, strict=True):
            write_mesh(surface_file(project, stem), item.mesh)
        write_model(new, cohort, shapes)
        write_poses(new, names, relative_poses(np.split(world, ends, axis=1), list(parts)))
        write_surfaces(new, shapes, surface, part_of(tick, 0.3, 1.0))
        write_table(new.folder / "energies.csv", ["iteration", "sampling", "ensemble", "normals"], [])
        new.write(ProjectRecord(subjects=project.describe(cohort), settings=record.settings, result=record))
    return notes


def _placed_jointly(parts: "Sequence[_Prepared]") -> tuple[FloatArray, FloatArray, list[str]]:
    """Return the particles of all anatomies as they lie to each other, aligned; the alignments; and notes.

    The other program's alignment is kept if it is one of the whole subject.
    """
    first = parts[0]
    local = np.concatenate([own.local for own in parts], axis=1)
    world = np.concatenate([own.world for own in parts], axis=1)
    size = float(rms_radius(world[0]))
    if np.abs(transform_points(first.alignments, local) - world).max() <= _FITS * size:
        return world, first.alignments, []
    world = align(local, scaling=False)
    alignments = np.array([fit_similarity(*pair, scaling=False) for pair in zip(local, world, strict=True)])
    note = "its anatomies were aligned one by one; here they lie to each other as in their files"
    return world, alignments, [note]


def domains_of(source: Path) -> list[str]:
    """Return the anatomies of a ShapeWorks project; a folder of particles has one."""
    return ["1"] if Path(source).is_dir() else read_shapeworks_file(source).domains


def _chosen(file: ShapeWorksProject, domain: str | None) -> str:
    domains = file.domains
    if domain is None and len(domains) == 1:
        return domains[0]
    if domain not in domains:
        raise InputError(
            f"{file.path}: contains the anatomies {', '.join(domains)}; choose one of them (domain), or none"
        )
    return domain


def _check(source: Path, model: ForeignModel) -> None:
    names = [subject.name for subject in model.subjects]
    if len(names) < 2:
        raise InputError(f"{source}: contains {len(names)} usable subjects; a shape model needs two or more")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{source}: several subjects are named {', '.join(twice[:5])}; give each its own name"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Prepared:
    """Particles, alignments and surfaces of all subjects of a model."""

    local: FloatArray
    world: FloatArray
    alignments: FloatArray
    surfaces: list[SubjectSurface]


def _prepared(model: ForeignModel, tick: Tick) -> _Prepared:
    local, world, alignments = with_alignments(model.subjects)
    if len(world[0]) < _FEWEST:
        raise InputError(f"{model.source}: has {len(world[0])} particles per shape; {_FEWEST} are needed")
    surfaces = surfaces_of(model.subjects, local, world, alignments, tick)
    return _Prepared(np.array(local), np.array(world), alignments, surfaces)


def _write(project: ProjectFolder, model: ForeignModel, own: _Prepared, tick: Tick) -> list[str]:
    """Write the project; return notes on subjects, one line each."""
    world, alignments, surfaces = own.world, own.alignments, own.surfaces
    stems = file_stems([subject.name for subject in model.subjects])
    cohort = _cohort(project, model, stems, surfaces)
    shapes = ShapeModel().fit(world, names=[subject.name for subject in model.subjects])
    try:
        surface = _mean(shapes, world, surfaces, alignments, part_of(tick, 0.0, 0.3))
    except NumericalError as error:
        raise InputError(f"{model.source}: is not a shape model ({error}); export it again") from error
    with project.replacing_result() as new:
        write_all_particles(new, stems, own.local, world)
        for stem, item in zip(stems, surfaces, strict=True):
            write_mesh(surface_file(project, stem), item.mesh)
        write_model(new, cohort, shapes)
        write_surfaces(new, shapes, surface, part_of(tick, 0.3, 1.0))
        write_table(new.folder / "energies.csv", ["iteration", "sampling", "ensemble", "normals"], [])
        record = _record(model, cohort, stems, surfaces, alignments, world, surface)
        new.write(ProjectRecord(subjects=project.describe(cohort), settings=record.settings, result=record))
    return record.remarks


def _cohort(
    project: ProjectFolder, model: ForeignModel, stems: Sequence[str], surfaces: Sequence[SubjectSurface]
) -> Cohort:
    """Return the subjects for a later run, with their inputs, otherwise their surfaces or particles."""
    subjects = []
    for subject, stem, shape in zip(model.subjects, stems, surfaces, strict=True):
        path = particle_file(project, stem, "local")
        if shape.path is not None:
            path = surface_file(project, stem)
        landmarks = _landmarks(project, model, subject, stem)
        subjects.append(Subject(subject.name, path, subject.group, dict(subject.columns), landmarks))
    return Cohort(tuple(subjects), project.folder)


def _landmarks(
    project: ProjectFolder, model: ForeignModel, subject: ForeignSubject, stem: str
) -> Path | None:
    """Write a subject's landmarks as markups; None if it has none."""
    if subject.landmarks is None:
        return None
    points = read_particles(subject.landmarks)
    given = model.landmark_names
    names = given if len(given) == len(points) else [str(number) for number in range(1, len(points) + 1)]
    path = project.folder / "landmarks" / f"{stem}.mrk.json"
    write_markups(path, points, names, title="landmarks")
    return path


def _mean(
    shapes: ShapeModel,
    world: FloatArray,
    surfaces: Sequence[SubjectSurface],
    alignments: FloatArray,
    tick: Tick,
) -> MeanSurface:
    own = [index for index, surface in enumerate(surfaces) if surface.path is not None] or list(
        range(len(surfaces))
    )
    return surface_of_model(shapes, world[own], [surfaces[item].mesh for item in own], alignments[own], tick)


def _record(
    model: ForeignModel,
    cohort: Cohort,
    stems: Sequence[str],
    surfaces: Sequence[SubjectSurface],
    alignments: FloatArray,
    world: FloatArray,
    surface: MeanSurface,
    structures: Mapping[str, int] | None = None,
) -> ResultRecord:
    method = {
        (True, True): Method.GEODESIC_NORMALS,
        (True, False): Method.GEODESIC,
        (False, True): Method.NORMALS,
    }.get((bool(model.geodesic), bool(model.normals)), Method.EUCLIDEAN)
    metric = {True: "geodesic", False: "euclidean", None: "unknown"}[model.geodesic]
    count = max((structures or {"": world.shape[1]}).values())
    groom = GroomSettings(structures=",".join(structures)) if structures else GroomSettings()
    return ResultRecord.model_validate(
        {
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "ended": IMPORTED,
            "iterations": 0,
            "particles": world.shape[1],
            "metric": metric,
            "folded_faces": surface.folded,
            "smoothed_particles": surface.smoothed,
            "settings": RunSettings(
                groom=groom, optimize=OptimizeSettings(method=method, particles=min(count, 65536))
            ),
            "structures": [
                ResultStructure(name=name, particles=number, vertices=near.stop - near.start)
                for (name, number), (_, near) in zip((structures or {}).items(), surface.parts, strict=False)
            ],
            "device": "none",
            "versions": versions(),
            "seconds": {},
            "fingerprint": _hash(world),
            "source": model.source,
            "subjects": [
                ResultSubject(
                    name=subject.name,
                    file=stem,
                    group=subject.group,
                    columns=dict(subject.columns),
                    content=_hash(item.mesh.vertices, item.mesh.faces),
                    alignment=alignment.tolist(),
                    notes=list(item.notes),
                )
                for subject, stem, item, alignment in zip(
                    cohort.subjects, stems, surfaces, alignments, strict=True
                )
            ],
        }
    )


def _hash(*arrays: Array) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for array in arrays:
        digest.update(f"{array.shape}{array.dtype}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


_FARTHEST = 1e6  # mm
_FITS = 1e-3  # tolerance relative to the size: rounding to six digits, but no other transform


def with_alignments(
    subjects: tuple[ForeignSubject, ...],
) -> tuple[list[FloatArray], list[FloatArray], FloatArray]:
    """Return local and world particles and the alignments between them; missing ones are computed.

    Raises
    ------
    InputError
        If subjects have different numbers of particles, or a subject's local and world particles differ in
        shape.
    """
    given = [
        (subject.name, points)
        for subject in subjects
        for points in (subject.local, subject.world)
        if points is not None
    ]
    for name, points in given:
        if len(points) != len(given[0][1]):
            raise InputError(
                f"{name}: has {len(points)} particles, and {given[0][0]} has {len(given[0][1])}; import a "
                "model whose particles correspond"
            )
        _check_near(name, points)
    with np.errstate(all="ignore"):  # for invalid matrices
        world = _world(subjects)
    for item, points in zip(subjects, world, strict=True):
        _check_near(item.name, points)
    local = [
        points if subject.local is None else subject.local
        for subject, points in zip(subjects, world, strict=True)
    ]
    alignments = [
        _alignment(subject, near, common)
        for subject, near, common in zip(subjects, local, world, strict=True)
    ]
    return local, world, np.array(alignments)


def _check_near(name: str, points: FloatArray) -> None:
    if not np.abs(points).max() <= _FARTHEST:
        raise InputError(f"{name}: has particles more than a kilometre away; export the model again in mm")


def _world(subjects: tuple[ForeignSubject, ...]) -> list[FloatArray]:
    if all(subject.world is not None or subject.alignment is not None for subject in subjects):
        return [
            transform_points(subject.alignment, subject.local) if subject.world is None else subject.world  # type: ignore[arg-type]
            for subject in subjects
        ]
    if any(subject.local is None for subject in subjects):
        missing = next(subject.name for subject in subjects if subject.local is None)
        raise InputError(f"{missing}: has no local particles, and others no world particles; export both")
    return list(align(np.array([subject.local for subject in subjects]), scaling=False))


def _alignment(subject: ForeignSubject, local: FloatArray, world: FloatArray) -> FloatArray:
    """Return the similarity from local to world: the other program's if consistent, else a fitted one."""
    size = float(rms_radius(world))
    candidates = [] if subject.alignment is None else [subject.alignment]
    fitted = (fit_similarity(local, world, scaling=True, mirrored=mirrored) for mirrored in (False, True))
    for matrix in (*candidates, *fitted):
        matrix[3] = [0.0, 0.0, 0.0, 1.0]
        with np.errstate(all="ignore"):  # for invalid matrices
            fits = np.abs(transform_points(matrix, local) - world).max() <= _FITS * size
        if fits:
            return matrix
    raise InputError(
        f"{subject.name}: its local and world particles differ in shape; export the model again, or "
        "import its world particles alone"
    )


_NEAR = 0.05  # of the size, plus half an edge: largest distance to vertices and face centres
_MOST = 0.95  # least fraction of particles within that distance
_VERTICES = 8000  # enough for display, and few enough for warping


def surfaces_of(
    subjects: Sequence[ForeignSubject],
    local: Sequence[FloatArray],
    world: Sequence[FloatArray],
    alignments: FloatArray,
    tick: Tick = no_tick,
) -> list[SubjectSurface]:
    """Return a surface for every subject.

    A file's surface is used if the subject's particles lie on it. A subject without one gets the surface of
    the most typical subject that has one, warped by the particles; if no subject has one, it gets discs at
    its particles. Notes describe the choice.

    Parameters
    ----------
    subjects : sequence of M ForeignSubject
    local, world : sequences of M (N, 3) arrays
        Particles [mm].
    alignments : (M, 4, 4) array
        From local to world.
    tick : Tick
    """
    surfaces: list[SubjectSurface | None] = [None] * len(subjects)
    refused = ["has no surface"] * len(subjects)
    row = {subject.name: index for index, subject in enumerate(subjects)}
    files = {subject.name: subject.shapes[0] for subject in subjects if subject.shapes}
    jobs = {name: (subjects[row[name]], local[row[name]]) for name in files}
    for name, future in each_read(_own, jobs, files, "reading the surface of", tick):
        try:
            surfaces[row[name]], refused[row[name]] = future.result()
        except InputError as error:
            refused[row[name]] = _refusal(name, error)
    have = [index for index, surface in enumerate(surfaces) if surface is not None]
    if not have:
        return [
            SubjectSurface(
                surfels(points),
                None,
                (f"{reason}; shown as discs at its particles, can't be groomed or optimized",),
            )
            for points, reason in zip(local, refused, strict=True)
        ]
    positions = np.array(world)
    template = have[medoid(positions[have], positions.mean(axis=0))]
    mesh = surfaces[template]
    assert mesh is not None, "the template has a surface"
    template_mesh = mesh.mesh.placed(alignments[template])
    result = []
    for index, surface in enumerate(surfaces):
        if surface is None:
            warped = mean_surface(
                positions[index], positions[template], template_mesh.vertices, template_mesh.faces
            )
            back = TriangleMesh(warped.vertices, template_mesh.faces).placed(np.linalg.inv(alignments[index]))
            template_name = subjects[template].name
            note = f"{refused[index]}; shown with the surface of {template_name}, warped by the particles"
            surface = SubjectSurface(back, None, (note,))
        result.append(surface)
    return result


def _own(job: tuple[ForeignSubject, FloatArray]) -> tuple[SubjectSurface | None, str]:
    """Return the surface of the first usable file, or the reason why there is none; in a worker."""
    subject, points = job
    reason = ""
    for path in subject.shapes:
        try:
            mesh = _read(subject.name, path)
            gap = _gap(mesh, points)
        except (InputError, NumericalError) as error:
            reason = _refusal(subject.name, error)
            continue
        if gap <= 0.0:
            return SubjectSurface(mesh, path), ""
        reason = f"its particles are not on the surface in {path.name}"
    return None, reason


def _refusal(name: str, error: Exception) -> str:
    return f"its surface can't be used ({str(error).removeprefix(f'{name}: ')})"


def _read(name: str, path: Path) -> TriangleMesh:
    if suffix_of(path) in MESH_SUFFIXES:
        mesh = read_mesh(path)
        check_mesh(mesh, str(path))
        mesh = mesh if mesh.volume > 0.0 else TriangleMesh(mesh.vertices, mesh.faces[:, ::-1])
        return simplified(mesh, _VERTICES)
    try:
        return groom_subject(Subject(name, path), GroomSettings()).mesh
    except InputError:
        return read_distance_map(path)


def _gap(mesh: TriangleMesh, points: FloatArray) -> float:
    """Return the excess of most particles' distance from the surface over the tolerance [mm]."""
    positions = np.concatenate([mesh.vertices, mesh.vertices[mesh.faces].mean(axis=1)])
    distances = np.asarray(KDTree(positions).query(points)[0])
    size = rms_radius(points)
    return float(np.quantile(distances, _MOST) - _NEAR * size - 0.5 * mesh.mean_edge)
