import numpy as np
import pytest

from homolog import geodesic_distances
from homolog.geodesics import distances_from
from homolog.surfaces.mesh import TriangleMesh


def sheet(side):
    """A square sheet of side² cells with a slot, 6 wide, from 8 above its lower edge to the upper one."""
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0), indexing="ij")
    vertices = np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3)
    number = np.arange(len(vertices)).reshape(side + 1, side + 1)
    a, b, c, d = (
        part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    middle = vertices[faces].mean(axis=1)
    faces = faces[~((np.abs(middle[:, 0] - 0.5 * side) < 3.0) & (middle[:, 1] > 8.0))]
    used, faces = np.unique(faces, return_inverse=True)
    return vertices[used], faces.reshape(-1, 3)


def test_the_shortest_path_leads_around_what_is_cut_away():
    vertices, faces = sheet(40)
    distances = geodesic_distances(vertices, faces, np.inf, device="cpu").toarray()
    at = {tuple(place): number for number, place in enumerate(vertices[:, :2].astype(int).tolist())}
    around = 2.0 * np.hypot(7.0, 32.0) + 6.0
    assert distances[at[10, 40], at[30, 40]] == pytest.approx(around, rel=5e-3)
    assert distances[at[0, 0], at[40, 8]] == pytest.approx(np.hypot(40.0, 8.0), rel=1e-3)
    row = distances_from(TriangleMesh(vertices, faces), [at[10, 40]])
    assert row[at[30, 40]] == pytest.approx(around, rel=1e-2)


def test_there_is_no_distance_between_pieces():
    vertices, faces = sheet(12)
    apart = np.concatenate([vertices, vertices + np.array([100.0, 0.0, 0.0])])
    distances = geodesic_distances(
        apart, np.concatenate([faces, faces + len(vertices)]), np.inf, device="cpu"
    )
    alone = geodesic_distances(vertices, faces, np.inf, device="cpu")
    assert distances.nnz == 2 * alone.nnz
    np.testing.assert_allclose(
        distances[: len(vertices), : len(vertices)].toarray(), alone.toarray(), rtol=1e-3
    )
