"""Cohorts whose correspondence is known: ellipsoids with the same particles."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from homolog.inspection import assess, inspect, locate_particles
from homolog.surfaces.mesh import TriangleMesh

PARTICLES = 160
AXES = ((20, 16, 12), (22, 15, 12), (19, 17, 11), (20, 15, 13), (21, 16, 11), (18, 16, 12))


def spread(n):
    """Return points spread evenly over the unit sphere (Fibonacci)."""
    k = np.arange(n) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / n), np.pi * (1 + 5**0.5) * k
    return np.stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1)


def mesh_of(axes, n=2000):
    points = spread(n)
    faces = ConvexHull(points).simplices
    a, b, c = points[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    return TriangleMesh(points * axes, np.where(inward[:, None], faces[:, ::-1], faces))


@dataclass
class Known:
    """Particles (M, N, 3), surfaces and alignments; `directions` are their unit vectors."""

    local: np.ndarray
    meshes: list
    alignments: np.ndarray
    directions: np.ndarray

    @property
    def names(self):
        return [f"subject_{m}" for m in range(len(self.meshes))]

    @property
    def spacing(self):
        return np.sqrt([mesh.area / self.local.shape[1] for mesh in self.meshes])

    def inspect(self, local=None, **options):
        return inspect(
            self.local if local is None else local, self.meshes, self.alignments, names=self.names, **options
        )

    def again(self, good, local, m):
        """Look at one subject again, the others being as they were."""
        first = locate_particles(
            local[m : m + 1], self.meshes[m : m + 1], self.alignments[m : m + 1], names=["x"]
        )
        return assess(good.located.with_subject(m, first))


@pytest.fixture(scope="session")
def make_known():
    """Return the function that makes a cohort of ellipsoids, each in a pose and size of its file's own."""

    def make(axes=AXES, particles=PARTICLES, seed=0):
        from scipy.spatial.transform import Rotation

        random = np.random.default_rng(seed)
        places, meshes, local, alignments = spread(particles), [], [], []
        for item in np.asarray(axes, float):
            mesh, inverse = mesh_of(item), np.eye(4)
            size = random.uniform(0.8, 1.25)
            inverse[:3, :3] = size * Rotation.random(rng=random).as_matrix()
            inverse[:3, 3] = random.normal(scale=50.0, size=3)
            meshes.append(TriangleMesh(mesh.vertices @ inverse[:3, :3].T + inverse[:3, 3], mesh.faces))
            local.append(places * item @ inverse[:3, :3].T + inverse[:3, 3])
            alignments.append(np.linalg.inv(inverse))
        return Known(np.array(local), meshes, np.array(alignments), places)

    return make


@pytest.fixture(scope="session")
def known(make_known):
    """Return six ellipsoids."""
    return make_known()


@pytest.fixture(scope="session")
def good(known):
    """Return what the inspection says of them."""
    return known.inspect()


@pytest.fixture(scope="session")
def thin(make_known):
    """Return six discs whose walls are much nearer to each other than neighbours are."""
    return make_known([(20 + 0.3 * k, 18 - 0.2 * k, 1.0 + 0.05 * k) for k in range(6)])
