"""Every kind of write, where files can't grow: the message names file and remedy, what was there stays."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import numpy as np
import pytest

from homolog.cohort import read_cohort
from homolog.errors import InputError
from homolog.geodesics import solve_tables
from homolog.grooming import groom_cohort
from homolog.io.mapped import mapped_within
from homolog.io.markups import write_markups
from homolog.io.meshes import read_mesh, write_mesh
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord
from homolog.io.results import surface_file
from homolog.io.shapeworks_export import write_shapeworks
from homolog.io.tables import write_table
from homolog.run import Phase, Run
from homolog.run.table_files import save_table
from homolog.surfaces.mesh import TriangleMesh

FULL = r"can't be written: (File too large|the disk may be full); choose a writable folder"


def surface(project):
    return read_mesh(surface_file(project, "a"))


def octahedron():
    corners = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return TriangleMesh(corners, np.array(faces))


def mapped(folder):
    with mapped_within(folder, 1.0) as store:
        store(np.ones(9))


WRITES = {
    "project.json": lambda project: project.write(ProjectRecord()),
    "a.vtp": lambda project: write_mesh(project.folder / "a.vtp", surface(project)),
    "a.vtk": lambda project: write_mesh(project.folder / "a.vtk", surface(project)),
    "a.ply": lambda project: write_mesh(project.folder / "a.ply", surface(project)),
    "a.stl": lambda project: write_mesh(project.folder / "a.stl", surface(project)),
    "a.obj": lambda project: write_mesh(project.folder / "a.obj", surface(project)),
    "a.particles": lambda project: write_particles(project.folder / "a.particles", np.ones((99, 3))),
    "a.csv": lambda project: write_table(project.folder / "a.csv", ["x"], [[1.0]] * 99),
    "a.mrk.json": lambda project: write_markups(project.folder / "a.mrk.json", np.ones((9, 3))),
    r"shapeworks[^:]*": lambda project: write_shapeworks(project, project.folder / "shapeworks"),
    "project": lambda project: mapped(project.folder),
    r"tables/a\.npz": lambda project: save_table(
        project.folder / "tables" / "a.npz", solve_tables([octahedron()], np.inf)[0]
    ),
}


@pytest.mark.parametrize("name", WRITES)
def test_a_file_that_cannot_grow_is_named_and_the_one_before_stays(name, project, contents, files_up_to):
    before = contents(project.folder)
    with files_up_to(64), pytest.raises(InputError, match=f"{name}: {FULL}"):
        WRITES[name](project)
    assert contents(project.folder) == before


def test_a_groomed_cache_that_cannot_grow_is_named(project, short_settings, files_up_to):
    (project.groomed / "a.npz").unlink()
    cohort = read_cohort(project.folder.parent / "scans")
    refused = pytest.raises(InputError, match=rf"groomed/a\.\w+: {FULL}")
    with files_up_to(2000), ThreadPoolExecutor(1) as executor, refused:
        groom_cohort(cohort, short_settings.groom, executor=executor, cache=project.groomed)


@pytest.mark.parametrize("phase", [Phase.SPLITTING, Phase.WRITING])
def test_a_run_whose_disk_fills_up_leaves_the_last_result_and_goes_on_later(
    phase, project, run_of, results, files_up_to
):
    before = results(project.folder)

    def fill_up(status):
        if status.phase is phase and status.reason is None:
            full.enter_context(files_up_to(64))

    with ExitStack() as full, pytest.raises(InputError, match=FULL):
        run_of(project).execute(fill_up)
    assert results(project.folder) == before
    run_of(project, resume=project.read().unfinished).execute()
    assert results(project.folder) == before


def test_a_disk_that_is_really_full_is_told_and_the_project_can_be_read(
    mounted, project, contents, short_settings
):
    disk = ProjectFolder(mounted("-t", "tmpfs", "-o", "size=400k", "tmpfs") / "project")
    run = Run(disk, read_cohort(project.folder.parent / "scans"), short_settings)
    with pytest.raises(InputError, match=r"No space left .* choose a writable folder"):
        run.execute()
    assert disk.read().unfinished
    with disk.locked():
        assert not [name for name in contents(disk.folder) if ".part-" in name]
