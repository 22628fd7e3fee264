"""Import of another program's model as a project with a result, for viewing and analysis."""

import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.cohort import Cohort, Subject
from homolog.errors import InputError, NumericalError
from homolog.exchange.model import ForeignModel, ForeignSubject, with_alignments
from homolog.exchange.shapes import SubjectSurface, surfaces_of
from homolog.exchange.shapeworks_files import ShapeWorksProject, read_shapeworks_file
from homolog.exchange.shapeworks_metadata import save_source_metadata
from homolog.exchange.shapeworks_model import model_of_folder, model_of_project
from homolog.io.markups import write_markups
from homolog.io.meshes import write_mesh
from homolog.io.names import file_stems
from homolog.io.particle_array import particle_file, write_all_particles
from homolog.io.particles import read_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import IMPORTED, ProjectRecord, ResultRecord, ResultSubject
from homolog.io.results import surface_file
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.run.fingerprints import versions
from homolog.run.shape_files import surface_of_model, write_model, write_surfaces
from homolog.settings import Method, OptimizeSettings, RunSettings
from homolog.statistics.reconstruction import MeanSurface
from homolog.statistics.shape_model import ShapeModel

__all__ = ["domains_of", "import_model"]

_FEWEST = 4  # particles that define a shape


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
        The anatomy, if the project has several.
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
        domain = _chosen(file, domain)
        model = model_of_project(file, domain)
    else:
        raise InputError(
            f"{source}: is neither a ShapeWorks project (.swproj, .xlsx) nor a folder of particles"
        )
    _check(source, model)
    with project.locked():
        notes = _write(project, model, tick)
        if file is not None and domain is not None:
            save_source_metadata(project, file, domain)
    return [*model.notes, *notes]


def domains_of(source: Path) -> list[str]:
    """Return the anatomies of a ShapeWorks project; a folder of particles has one."""
    return ["1"] if Path(source).is_dir() else read_shapeworks_file(source).domains


def _chosen(file: ShapeWorksProject, domain: str | None) -> str:
    domains = file.domains
    if domain is None and len(domains) == 1:
        return domains[0]
    if domain not in domains:
        raise InputError(
            f"{file.path}: contains the anatomies {', '.join(domains)}; choose one of them (domain)"
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


def _write(project: ProjectFolder, model: ForeignModel, tick: Tick) -> list[str]:
    """Write the project; return notes on subjects, one line each."""
    local, world, alignments = with_alignments(model.subjects)
    if len(world[0]) < _FEWEST:
        raise InputError(f"{model.source}: has {len(world[0])} particles per shape; {_FEWEST} are needed")
    stems = file_stems([subject.name for subject in model.subjects])
    surfaces = surfaces_of(model.subjects, local, world, alignments, part_of(tick, 0.1, 0.6))
    cohort = _cohort(project, model, stems, surfaces)
    shapes = ShapeModel.fit(np.array(world), names=[subject.name for subject in model.subjects])
    try:
        surface = _mean(shapes, np.array(world), surfaces, alignments, part_of(tick, 0.6, 0.7))
    except NumericalError as error:
        raise InputError(f"{model.source}: is not a shape model ({error}); export it again") from error
    with project.replacing_result() as new:
        write_all_particles(new, stems, local, world)
        for stem, item in zip(stems, surfaces, strict=True):
            write_mesh(surface_file(project, stem), item.mesh)
        write_model(new, cohort, shapes)
        write_surfaces(new, shapes, surface, part_of(tick, 0.7, 1.0))
        write_table(new.folder / "energies.csv", ["iteration", "sampling", "ensemble", "normals"], [])
        record = _record(model, cohort, stems, surfaces, alignments, np.array(world), surface)
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
) -> ResultRecord:
    method = {
        (True, True): Method.GEODESIC_NORMALS,
        (True, False): Method.GEODESIC,
        (False, True): Method.NORMALS,
    }.get((bool(model.geodesic), bool(model.normals)), Method.EUCLIDEAN)
    metric = {True: "geodesic", False: "euclidean", None: "unknown"}[model.geodesic]
    count = world.shape[1]
    return ResultRecord.model_validate(
        {
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "ended": IMPORTED,
            "iterations": 0,
            "particles": count,
            "metric": metric,
            "folded_faces": surface.folded,
            "smoothed_particles": surface.smoothed,
            "settings": RunSettings(optimize=OptimizeSettings(method=method, particles=min(count, 65536))),
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
