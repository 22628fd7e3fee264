"""The same subject twice: identical, in another place, sampled anew; and what is not the same."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from homolog.grooming.subject import groom
from homolog.grooming.twins import twins
from homolog.io.images import Segmentation
from homolog.settings import GroomSettings
from homolog.surfaces.mesh import TriangleMesh

SETTINGS = GroomSettings(mesh_edge=1.5)
BALLS = (((-3, -4, -4), 5.3), ((3, -4, -4), 4.2), ((4, 2, -4), 3.9), ((4, 4, 2), 3.6), ((4, 4, 7), 3.1))
TURN = Rotation.from_rotvec([0.5, -0.9, 1.3]).as_matrix()


AS_IT_LIES = np.eye(3)


def body(grid, turn=AS_IT_LIES, shift=(0.1, 0.2, 0.4), size=1.0):
    """Return the voxels of an asymmetric body that was moved before it was sampled."""
    points = grid(15.0) @ turn / size + np.asarray(shift)
    inside = np.any([np.linalg.norm(points - centre, axis=-1) < radius for centre, radius in BALLS], axis=0)
    return Segmentation(inside, np.eye(3), np.ones(3), np.zeros(3))


@pytest.fixture
def noted(grid):
    """Return the notes on a second subject beside the body."""

    def find(other):
        return twins([groom(name, source, SETTINGS) for name, source in (("a", body(grid)), ("b", other))])

    return find


@pytest.mark.parametrize("turn", [np.diag([-1.0, -1.0, 1.0]), TURN])
def test_a_body_that_was_moved_and_sampled_anew_is_noted(grid, noted, turn):
    assert " a in another place" in noted(body(grid, turn, (0.3, -0.4, 0.2)))["b"]


def test_a_mesh_that_was_moved_is_noted(grid):
    points = body(grid)
    mesh = groom("a", points, SETTINGS).mesh
    moved = TriangleMesh(mesh.vertices @ TURN.T + [100.0, 3.0, 7.0], mesh.faces)
    assert "b" in twins([groom("a", mesh, SETTINGS), groom("b", moved, SETTINGS)])


@pytest.mark.parametrize(
    "other", [{"size": 1.03}, {"turn": np.diag([-1.0, 1.0, 1.0])}], ids=["larger by 3 %", "mirror image"]
)
def test_another_body_is_not_noted(grid, noted, other):
    assert noted(body(grid, **other)) == {}
