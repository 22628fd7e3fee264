"""A finished project of three groups, and the command that analyzes it."""

import csv

import numpy as np
import pytest

from homolog.io.meshes import write_mesh
from homolog.io.particles import write_particles
from homolog.io.project import ProjectFolder
from homolog.io.records import ProjectRecord, ResultRecord, ResultSubject
from homolog.io.results import mean_file, particle_file
from homolog.io.tables import write_table
from homolog.settings import RunSettings
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.cli import main

HOSTILE = "<script>alert('x')</script> & co"
QUICK = ["--permutations", "199", "--progress", "none"]


@pytest.fixture(scope="session")
def make_project(unit_sphere):
    """Return a maker of projects: 18 spheres of 20 mm in three groups; those of C bulge upward by 4 mm."""

    def made(folder):
        project = ProjectFolder(folder)
        generator = np.random.default_rng(0)
        points, faces = unit_sphere(300)
        base = 20.0 * points[::5]
        subjects = []
        for index in range(18):
            group = "ABC"[index % 3]
            modes = generator.normal(size=3)
            shape = base * (1.0 + 0.05 * modes * [1.0, 0.8, 0.6]) + 0.1 * generator.normal(size=base.shape)
            if group == "C":
                shape = shape + 4.0 * np.clip(base[:, 2:] / 20.0, 0.0, 1.0) ** 2 * [0.0, 0.0, 1.0]
            name = HOSTILE if index == 4 else f"subject {index}"
            columns = {"age": str(40 + 2 * index), "sex": "mf"[index % 2], "site": "one"}
            columns["subject"] = f"p{index}"  # couples are no repeated measures
            columns |= {"twin": f"t{index // 6}", "grade": "" if index == 7 else str(index % 4)}
            columns |= {
                "dose": "30 y" if index == 3 else str(index),
                "weight": "inf" if index == 2 else str(index),
            }
            columns |= {
                "couple": f"c{index // 3}",
                "code": str(index // 2 % 3 + 1),
                "stage": "NA" if index == 7 else "1",
            }
            columns["halves"] = "" if index == 1 else columns["couple"]
            columns["scanner"] = ("1", "1.0", "2")[index // 3 % 3]
            columns["half"] = "x" if index % 3 < 2 else "xy"[index % 2]
            subjects.append(
                ResultSubject(
                    name=name,
                    file=f"s{index}",
                    group=group,
                    columns=columns,
                    content="0",
                    alignment=np.eye(4).tolist(),
                )
            )
            for frame in ("world", "local"):
                write_particles(particle_file(project, f"s{index}", frame), shape)
        project.model.mkdir()
        for table in ("scores", "eigenvalues"):
            write_table(project.model / f"{table}.csv", ["name"], [])
        write_mesh(mean_file(project), TriangleMesh(20.0 * points, faces))
        write_table(
            project.folder / "energies.csv",
            ["iteration", "sampling", "ensemble", "normals"],
            [[step, -float(step), 2.0 / (step + 1), 1.0] for step in range(20)],
        )
        result = ResultRecord(
            finished="2025-01-01T00:00:00+00:00",
            ended="converged",
            iterations=20,
            particles=60,
            metric="geodesic",
            folded_faces=0,
            settings=RunSettings(),
            device="cpu",
            versions={"homolog": "9.9"},
            seconds={},
            fingerprint="abc",
            subjects=subjects,
            excluded=["scan.nrrd: is empty"],
        )
        project.write(ProjectRecord(result=result))
        return project

    return made


@pytest.fixture
def project(tmp_path, make_project):
    """Return a finished project of three groups."""
    return make_project(tmp_path / "study")


@pytest.fixture(scope="session")
def rows_of():
    """Return a function that reads a table as dictionaries."""

    def rows(path):
        with path.open(newline="") as stream:
            return list(csv.DictReader(stream))

    return rows


@pytest.fixture(scope="session")
def analyze():
    """Return a function that runs ``homolog analyze`` with few permutations."""

    def run(project, *options):
        return main(["analyze", str(project.folder), *QUICK, *options])

    return run
