import pickle

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture
def tetrahedron():
    vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]])
    return TriangleMesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


def test_area_volume_and_edges_of_a_tetrahedron(tetrahedron):
    assert tetrahedron.volume == pytest.approx(8.0 / 6.0)
    assert tetrahedron.area == pytest.approx(6.0 + np.sqrt(3.0) * 2.0)
    assert tetrahedron.face_areas == pytest.approx([2.0, 2.0, 2.0 * np.sqrt(3.0), 2.0])
    assert tetrahedron.mean_edge == pytest.approx((2.0 + np.sqrt(8.0)) / 2.0)


def test_volume_does_not_depend_on_the_place(tetrahedron):
    assert TriangleMesh(tetrahedron.vertices + 100.0, tetrahedron.faces).volume == pytest.approx(8.0 / 6.0)


def test_normals_point_outward_with_length_one(tetrahedron):
    normals = tetrahedron.vertex_normals
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)
    assert ((tetrahedron.vertices - tetrahedron.vertices.mean(axis=0)) * normals).sum(axis=1).min() > 0.0


def test_arrays_are_read_only_and_stay_so_through_pickling(tetrahedron):
    for mesh in (tetrahedron, pickle.loads(pickle.dumps(tetrahedron))):
        assert mesh.vertices.dtype == np.float64
        assert mesh.faces.dtype == np.int32
        with pytest.raises(ValueError, match="read-only"):
            mesh.vertices[0, 0] = 1.0


@pytest.mark.parametrize(("vertices", "faces"), [((4, 2), (4, 3)), ((4, 3), (4, 4)), ((12,), (4, 3))])
def test_arrays_of_other_shapes_are_refused(vertices, faces):
    with pytest.raises(InputError, match=r"\(V, 3\)"):
        TriangleMesh(np.zeros(vertices), np.zeros(faces, int))
