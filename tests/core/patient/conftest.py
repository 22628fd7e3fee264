"""Controls that need no optimization: ellipsoids with waves, whose vertices correspond."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from homolog import __version__
from homolog.grooming import GroomedSubject, GroomReport
from homolog.patient import left_out
from homolog.patient.build import reference_of
from homolog.patient.coding import Coding
from homolog.patient.controls import Controls
from homolog.patient.provenance import Provenance
from homolog.settings import GroomSettings
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

AXES = np.array([30.0, 22.0, 16.0])


def sphere():
    """Return unit directions that are spread evenly, and the faces between them."""
    from scipy.spatial import ConvexHull

    index = np.arange(700) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * index / 700), np.pi * (1.0 + np.sqrt(5.0)) * index
    points = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], axis=1)
    faces = ConvexHull(points).simplices
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    turned = np.einsum("fi,fi->f", np.cross(b - a, c - a), a) < 0.0
    faces[turned] = faces[turned][:, ::-1]
    return points, faces


def shape(directions, random, age=60.0):
    """Return vertices of a control: axes vary, one end is thicker with age, and a little noise."""
    axes = AXES * np.exp(random.normal(scale=0.05, size=3))
    points = directions * axes
    points[:, 0] += 0.06 * (age - 60.0) * (directions[:, 0] > 0.5)
    for _ in range(4):
        wave = random.normal(scale=0.08, size=3)
        points += 0.15 * np.sin(points @ wave + random.uniform(0.0, 6.0))[:, None] * directions
    return points


def moved(points, random):
    """Return points turned by some degrees and shifted."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec(random.normal(scale=0.15, size=3)).as_matrix()
    return points @ turn.T + random.normal(scale=15.0, size=3)


def groomed(name, mesh, borders=()):
    """Return a mesh as grooming returns it; its field is not looked at but for its axes."""
    field = DistanceField(np.zeros((2, 2, 2), np.float32), np.eye(4))
    report = GroomReport(0, 0, bool(borders), 1.0, 1.0, 0, borders=borders)
    return GroomedSubject(name, field, mesh, mesh, report)


@pytest.fixture(scope="session")
def template():
    return sphere()


@pytest.fixture(scope="session")
def provenance():
    return Provenance(
        "study",
        "NOR",
        24,
        "2026-01-01",
        "2026-01-01",
        {"homolog": __version__},
        "abc",
        100,
        GroomSettings(mesh_edge=2.2),
        "",
    )


@pytest.fixture(scope="session")
def reference(template, provenance):
    """Return a reference of 24 ellipsoids, adjusted for age."""
    return build(template, provenance)


def build(template, provenance, count=24, make=None, later=None):
    directions, faces = template
    random = np.random.default_rng(3)
    ages = random.integers(40, 80, count)
    points = np.stack([shape(directions, random, age) if make is None else make(1.0) for age in ages])
    points -= points.mean(axis=1, keepdims=True)
    particles = points[:, ::7]
    controls = Controls(
        tuple(f"c{number}" for number in range(count)),
        np.concatenate([points, particles], axis=1),
        TriangleMesh(points.mean(axis=0), faces),
        tuple(TriangleMesh(item, faces) for item in points),
        particles,
        later={} if later is None else {index: later(points[index], faces) for index in range(count)},
    )
    table = {"age": [str(age) for age in ages]} if make is None else {}
    coding, columns = Coding.of(table, controls.names)

    @contextmanager
    def threads(_):
        with ThreadPoolExecutor(1) as executor:
            yield executor

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(left_out, "worker_processes", threads)
        about = replace(provenance, controls=count, particles=particles.shape[1])
        return reference_of(controls, coding, columns, about, between="year apart by 1", workers=1)
