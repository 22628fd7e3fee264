"""Every reader of files that others may have made, with good files to begin from."""

import csv
import json
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from dicom_files import good_contours, good_deflated_seg, good_seg, good_series
from harness import Target

from homolog.cohort import Subject, read_cohort
from homolog.errors import InputError
from homolog.io.arrays import read_arrays, write_arrays
from homolog.io.images import read_segmentation
from homolog.io.markups import read_markups, write_markups
from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.particles import read_particles, write_particles
from homolog.io.project import ProjectFolder
from homolog.io.shapeworks_export import write_shapeworks
from homolog.run.checkpoints import read_checkpoint, write_checkpoint
from homolog.run.import_model import import_model
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["NATIVE", "TARGETS"]


def octahedron() -> TriangleMesh:
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return TriangleMesh(corners, np.array(faces))


def good_project(folder: Path) -> None:
    """A project with a result of three subjects."""
    good_swproj(folder / "foreign")
    import_model(folder / "foreign" / "a.swproj", ProjectFolder(folder / "project"))
    shutil.rmtree(folder / "foreign")


def read_project(folder: Path) -> object:
    project = ProjectFolder(folder / "project")
    record = project.read()
    return record, project.cohort(), project.describe(project.cohort())


def good_swproj(folder: Path) -> None:
    """Three subjects with particles."""
    (folder / "particles").mkdir(parents=True)
    points = octahedron().vertices @ np.diag([9.0, 7.0, 5.0])
    rows = []
    for name, size in (("a", 1.0), ("b", 1.1), ("c", 0.9)):
        for frame in ("local", "world"):
            write_particles(folder / "particles" / f"{name}_{frame}.particles", size * points + (name == "b"))
        rows.append(
            {"name": name, "group_sex": "f", "age": "61"}
            | {f"{frame}_particles_1": f"particles/{name}_{frame}.particles" for frame in ("local", "world")}
        )
    content = {"data": rows, "optimize": {"number_of_particles": "6"}, "project": {"version": "2"}}
    (folder / "a.swproj").write_text(json.dumps(content, indent=4))


def good_xlsx(folder: Path) -> None:
    """The same as a workbook."""
    import openpyxl

    good_swproj(folder)
    rows = json.loads((folder / "a.swproj").read_text())["data"]
    book = openpyxl.Workbook()
    book.active.title = "data"
    for row in (list(rows[0]), *(list(item.values()) for item in rows)):
        book["data"].append(row)
    book.save(folder / "a.xlsx")


def importing(name: str) -> Callable[[Path], object]:
    def read(folder: Path) -> object:
        shutil.rmtree(folder / "made", ignore_errors=True)
        return import_model(folder / name, ProjectFolder(folder / "made"))

    return read


def good_checkpoint(folder: Path) -> None:
    from dataclasses import fields

    from homolog.correspondence import Checkpoint

    arrays = {
        "positions": np.zeros((2, 5, 3), np.float32),
        "widths": np.ones((2, 5), np.float32),
        "means": np.ones((5, 3), np.float32),
        "poses": np.stack([np.eye(4)] * 2),
        "neighbours": np.zeros((5, 2), np.int32),
        "coefficients": np.zeros((5, 2), np.float32),
        "faces": np.zeros((2, 5), np.int32),
        "repaired": np.zeros((2, 5), np.int32),
        "energies": np.zeros((1, 4)),
    }
    counts = {field.name: 1 for field in fields(Checkpoint) if field.name not in {*arrays, "others"}}
    write_checkpoint(folder / "checkpoint.npz", Checkpoint(**arrays, **counts), "f", 0.5)


def good_report(folder: Path) -> None:
    good_project(folder)
    write_table(folder / "project" / "energies.csv")


def write_table(path: Path) -> None:
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows([["iteration", "sampling", "ensemble", "normals"], [1, 2.0, 3.0, 4.0]])


def read_journal(folder: Path) -> object:
    from homolog_app.window.study_files import find_lost, study_of

    return [study_of(item.record.study, item.base) for item in find_lost(folder / "sessions")]


def good_journal(folder: Path) -> None:
    from homolog_app.window.study_files import JournalRecord, StudyRecord

    study = StudyRecord.model_validate({"subjects": [{"name": "a", "path": "a.nrrd"}], "excluded": ["a"]})
    (folder / "sessions" / "one").mkdir(parents=True)
    record = JournalRecord(folder=None, study=study, running=True)
    (folder / "sessions" / "one" / "journal.json").write_text(record.model_dump_json())


def good_window(folder: Path) -> None:
    good_project(folder)
    study = {"subjects": [{"name": "d", "path": "../d.nrrd"}], "excluded": ["d"]}
    (folder / "project" / "window.json").write_text(json.dumps(study))


def read_window(folder: Path) -> object:
    from homolog_app.window.study_files import open_project

    return open_project(ProjectFolder(folder / "project"))


def good_preferences(folder: Path) -> None:
    from homolog_app.window.workspace import Preferences

    preferences = Preferences(folder / "preferences.ini")
    preferences.scheme = "dark"
    preferences.remember(folder)


def read_preferences(folder: Path) -> object:
    from homolog_app.window.workspace import Preferences

    first = Preferences(folder / "preferences.ini")
    return first.scheme, first.ask_on_close, first.recent, first.geometry


def good_study(folder: Path) -> None:
    from homolog.comparison.question import Question
    from homolog.comparison.stored import Provenance, write_question

    study = folder / "project" / "analysis" / "study"
    study.mkdir(parents=True)
    write_question(Question(between=("f", "m")), study, Provenance(homolog="0", date="2026-11-23"))


def read_inputs(folder: Path) -> object:
    from homolog.comparison.stored import stored_answers

    return stored_answers(ProjectFolder(folder / "project"))


def image(name: str) -> Target:
    def write(folder: Path) -> None:
        import SimpleITK

        axes = np.stack(np.meshgrid(*[np.arange(-3.0, 4.0)] * 3, indexing="ij"))
        inside = (np.square(axes).sum(axis=0) <= 6.0).astype(np.uint8)
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(inside), folder / name, "packed" in name)

    return Target(name, write, lambda folder: read_segmentation(folder / name, None))


def mesh(name: str) -> Target:
    return Target(
        name, lambda folder: write_mesh(folder / name, octahedron()), lambda folder: read_mesh(folder / name)
    )


def good_freesurfer(folder: Path) -> None:
    """A surface that names the volume that it was made of."""
    from nibabel.freesurfer import write_geometry

    ball = octahedron()
    axes = {"xras": [-1.0, 0.0, 0.0], "yras": [0.0, 0.0, -1.0], "zras": [0.0, 1.0, 0.0], "cras": [1.0, 2, 3]}
    volume = {"head": [2, 0, 20], "valid": "1", "filename": "a.mgz", "volume": [9, 9, 9]}
    about = {**volume, "voxelsize": [1.0, 1.0, 1.0], **axes}
    write_geometry(folder / "lh.pial", ball.vertices, ball.faces, "by nobody", about)


def good_gifti(folder: Path) -> None:
    """A surface of two arrays, compressed."""
    from nibabel.gifti import GiftiDataArray, GiftiImage

    ball = octahedron()
    points = GiftiDataArray(ball.vertices.astype("f4"), "NIFTI_INTENT_POINTSET")
    faces = GiftiDataArray(ball.faces.astype("i4"), "NIFTI_INTENT_TRIANGLE")
    GiftiImage(darrays=[points, faces]).to_filename(folder / "a.surf.gii")


def good_off(folder: Path) -> None:
    """A text of points and faces."""
    ball = octahedron()
    points = "".join(f"{x} {y} {z}\n" for x, y, z in ball.vertices.tolist())
    faces = "".join(f"3 {a} {b} {c}\n" for a, b, c in ball.faces.tolist())
    (folder / "a.off").write_text(f"OFF\n{len(ball.vertices)} {len(ball.faces)} 0\n{points}{faces}")


def good_grid(folder: Path) -> None:
    """Two tetrahedra."""
    rows = "0 0 0 1 0 0 0 1 0 0 0 1 1 1 1", "0 1 2 3 1 2 3 4", "4 8", "10 10"
    points, corners, ends, types = (
        f'<DataArray type="Float64" Name="{name}" format="ascii">{row}</DataArray>'
        for name, row in zip(("Points", "connectivity", "offsets", "types"), rows, strict=True)
    )
    (folder / "a.vtu").write_text(
        '<VTKFile type="UnstructuredGrid"><UnstructuredGrid><Piece NumberOfPoints="5" NumberOfCells="2">'
        f"<Points>{points}</Points><Cells>{corners}{ends}{types}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )


def good_scene(folder: Path) -> None:
    """A surface in a scene."""
    import trimesh

    ball = octahedron()
    (folder / "a.glb").write_bytes(trimesh.Trimesh(ball.vertices, ball.faces).export(file_type="glb"))


def good_3mf(folder: Path) -> None:
    """A surface in an archive."""
    ball = octahedron()
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in ball.vertices.tolist())
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in ball.faces.tolist())
    with zipfile.ZipFile(folder / "a.3mf", "w") as archive:
        archive.writestr(
            "3D/3dmodel.model",
            f'<model><resources><object id="1"><mesh><vertices>{points}</vertices>'
            f"<triangles>{faces}</triangles>"
            '</mesh></object></resources><build><item objectid="1"/></build></model>',
        )


def good_vtk_particles(folder: Path) -> None:
    points = " ".join(f"{value:g}" for value in octahedron().vertices.ravel())
    head = "# vtk DataFile Version 5.1\nvtk output\nASCII\nDATASET POLYDATA\nPOINTS 6 float\n"
    (folder / "particles.vtk").write_text(f"{head}{points}\n")


def exporting_again(folder: Path) -> object:
    """Import a project and export it: what was kept of it is read once more."""
    shutil.rmtree(folder / "again", ignore_errors=True)
    importing("a.swproj")(folder)
    return write_shapeworks(ProjectFolder(folder / "made"), folder / "again")


def good_particles_folder(folder: Path) -> None:
    """Particles of three subjects in both frames."""
    good_swproj(folder)
    (folder / "a.swproj").unlink()


def good_table(folder: Path) -> None:
    """A geodesic table in blocks."""
    from homolog.geodesics import solve_tables
    from homolog.run.table_files import save_table

    save_table(folder / "table.npz", solve_tables([octahedron()], 1.0)[0])


def read_table(folder: Path) -> object:
    """Follow the table's arrays, which would lead a kernel anywhere if they were not checked."""
    from homolog.run.table_files import load_table

    table = load_table(folder / "table.npz", "cpu")
    if table is None:
        raise InputError("no table")
    return table.to_csr()


def good_groomed(folder: Path) -> None:
    from homolog.grooming import groom_subject
    from homolog.grooming.cache import save_groomed
    from homolog.settings import GroomSettings

    write_mesh(folder / "a.ply", TriangleMesh(10.0 * octahedron().vertices, octahedron().faces))
    save_groomed(folder, groom_subject(Subject("a", folder / "a.ply"), GroomSettings()), "key")


def read_groomed(folder: Path) -> object:
    from homolog.grooming.cache import load_groomed

    groomed = load_groomed(folder, "a", "key")
    if groomed is None:
        raise InputError("nothing groomed")
    return groomed.mesh.volume, groomed.coarse_mesh.volume


TARGETS = {
    "project.json": Target("project/project.json", good_project, read_project),
    "cohort.csv": Target(
        "cohort.csv",
        lambda folder: (folder / "cohort.csv").write_text(
            "name,path,group,age\na,a.nrrd,f,61\nb,b.nrrd,m,\n"
        ),
        lambda folder: read_cohort(folder / "cohort.csv"),
    ),
    ".particles": Target(
        "a.particles",
        lambda folder: write_particles(folder / "a.particles", octahedron().vertices),
        lambda folder: read_particles(folder / "a.particles"),
    ),
    "cohort.csv, UTF-16": Target(
        "cohort.csv",
        lambda folder: (folder / "cohort.csv").write_text(
            "sep=;\nName;Path;Group\na;a.nrrd;f\nb;b.nrrd;m\n", encoding="utf-16"
        ),
        lambda folder: read_cohort(folder / "cohort.csv"),
    ),
    "particles.vtk": Target(
        "particles.vtk", good_vtk_particles, lambda folder: read_particles(folder / "particles.vtk")
    ),
    ".swproj": Target("a.swproj", good_swproj, importing("a.swproj")),
    ".swproj, exported again": Target("a.swproj", good_swproj, exporting_again),
    ".xlsx": Target("a.xlsx", good_xlsx, importing("a.xlsx")),
    "folder of .particles": Target(
        "particles/b_world.particles", good_particles_folder, importing("particles")
    ),
    ".mrk.json": Target(
        "a.mrk.json",
        lambda folder: write_markups(folder / "a.mrk.json", octahedron().vertices),
        lambda folder: read_markups(folder / "a.mrk.json"),
    ),
    ".fcsv": Target(
        "a.fcsv",
        lambda folder: (folder / "a.fcsv").write_text(
            '# CoordinateSystem = LPS\n# columns = id,x,y,z,label\n1,1.5,-2,3,apex\n2,4,5,6,"base, left"\n'
        ),
        lambda folder: read_markups(folder / "a.fcsv"),
    ),
    "archive .npz": Target(
        "a.npz",
        lambda folder: write_arrays(folder / "a.npz", {"points": np.eye(3), "name": "a"}),
        lambda folder: read_arrays(folder / "a.npz"),
    ),
    "geodesic table .npz": Target("table.npz", good_table, read_table),
    "groomed subject .npz": Target("a.npz", good_groomed, read_groomed),
    "checkpoint.npz": Target(
        "checkpoint.npz", good_checkpoint, lambda folder: read_checkpoint(folder / "checkpoint.npz", "f")
    ),
    "study.json": Target("project/analysis/study/study.json", good_study, read_inputs),
    "window.json": Target("project/window.json", good_window, read_window),
    "journal.json": Target("sessions/one/journal.json", good_journal, read_journal),
    "preferences.ini": Target("preferences.ini", good_preferences, read_preferences),
}
"""Readers written in Python, or used in every session."""

NATIVE = {
    item.file: item
    for item in (
        *map(
            image,
            (
                "a.nrrd",
                "packed.nrrd",
                "a.nhdr",
                "a.nii",
                "a.nii.gz",
                "a.mha",
                "packed.mha",
                "a.mhd",
                "a.gipl",
            ),
        ),
        *map(mesh, ("a.vtp", "a.vtk", "a.ply", "a.stl", "a.obj")),
        Target("lh.pial", good_freesurfer, lambda folder: read_mesh(folder / "lh.pial")),
        Target("a.surf.gii", good_gifti, lambda folder: read_mesh(folder / "a.surf.gii")),
        Target("a.off", good_off, lambda folder: read_mesh(folder / "a.off")),
        Target("a.vtu", good_grid, lambda folder: read_mesh(folder / "a.vtu")),
        Target("a.glb", good_scene, lambda folder: read_mesh(folder / "a.glb")),
        Target("a.3mf", good_3mf, lambda folder: read_mesh(folder / "a.3mf")),
        Target("series/3.dcm", good_series, lambda folder: read_segmentation(folder / "series", None)),
        Target("a.dcm", good_seg, lambda folder: read_segmentation(folder / "a.dcm", None, "all")),
        Target(
            "contours.dcm",
            good_contours,
            lambda folder: read_segmentation(folder / "contours.dcm", None, "all"),
        ),
        Target(
            "deflated.dcm",
            good_deflated_seg,
            lambda folder: read_segmentation(folder / "deflated.dcm", None, "all"),
        ),
    )
}
"""Readers of SimpleITK, which can end the whole process: to be tried in one of their own; and of meshes."""
