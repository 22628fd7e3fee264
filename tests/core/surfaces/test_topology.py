import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from homolog.errors import InputError
from homolog.geodesics.plan import plan_tables
from homolog.surfaces import topology
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.sides import MeshSides
from homolog.surfaces.topology import (
    check_mesh,
    edges,
    euler_number,
    face_components,
    first_of_twins,
    longest_edge,
    unpinched,
)

VERTICES = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
FACES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


def test_a_tetrahedron_is_in_order():
    check_mesh(TriangleMesh(VERTICES, FACES), "s01")
    assert len(edges(FACES)) == 6
    assert euler_number(FACES) == 2
    assert longest_edge(TriangleMesh(VERTICES, FACES)) == pytest.approx(np.sqrt(8))


def test_components_are_counted_largest_first():
    two = np.concatenate([FACES[:2] + 4, FACES])
    assert face_components(two).tolist() == [1, 1, 0, 0, 0, 0]


def test_the_euler_number_of_a_torus_is_zero():
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(5), np.arange(4), indexing="ij"))

    def at(di, dj):
        return (i + di) % 5 * 4 + (j + dj) % 4

    faces = np.concatenate(
        [np.stack([at(0, 0), at(1, 0), at(1, 1)], 1), np.stack([at(0, 0), at(1, 1), at(0, 1)], 1)]
    )
    angle, around = 2 * np.pi * i / 5, 2 * np.pi * j / 4
    radius = 3 + np.cos(around)
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sin(around)], axis=1)
    assert euler_number(faces) == 0
    check_mesh(TriangleMesh(vertices, faces), "torus")


def with_vertex(row, value):
    vertices = VERTICES.copy()
    vertices[row] = value
    return vertices


BOW_TIE = np.where(FACES == 0, 0, FACES + 3)


FAULTS = [
    (VERTICES, FACES[:0], "has no faces"),
    (with_vertex(2, np.nan), FACES, "1 vertices that are not finite"),
    (VERTICES, FACES + 1, "vertices outside 0 … 3"),
    (VERTICES, FACES - 1, "vertices outside 0 … 3"),
    (with_vertex(2, (VERTICES[0] + VERTICES[1]) / 2), FACES, "1 faces without area"),
    (VERTICES, np.concatenate([FACES, [[0, 0, 1]]]), "1 faces without area (the first is face 4)"),
    (np.concatenate([VERTICES, [[9, 9, 9]]]), FACES, "1 vertices that belong to no face"),
    (
        np.concatenate([VERTICES, VERTICES]),
        np.concatenate([FACES, FACES + 4]),
        "is not welded: 4 vertices",
    ),
    (VERTICES, FACES[1:], "is not closed: 3 edges"),
    (VERTICES, np.concatenate([FACES, FACES[:1]]), "is not manifold: 3 edges have more than two"),
    (VERTICES, np.concatenate([FACES[:1, ::-1], FACES[1:]]), "opposite orientation"),
    (
        np.concatenate([VERTICES, VERTICES + 9]),
        np.concatenate([FACES, FACES + 4]),
        "has 2 separate pieces",
    ),
    (
        np.concatenate([VERTICES, VERTICES[1:] * [-1, -1, 1] + [2, 2, 0]]),
        np.concatenate([FACES, BOW_TIE]),
        "touches itself at 1 vertices",
    ),
]


def test_a_surface_may_have_rims_and_pieces_but_no_other_fault():
    check_mesh(TriangleMesh(VERTICES, FACES[1:]), "sheet", may_open=True)
    check_mesh(
        TriangleMesh(np.concatenate([VERTICES, VERTICES + 9]), np.concatenate([FACES, FACES + 4])),
        "two",
        may_open=True,
    )
    for vertices, faces, fault in FAULTS:
        if "not closed" not in fault and "pieces" not in fault:
            with pytest.raises(InputError, match="hip_12: the mesh "):
                check_mesh(TriangleMesh(vertices, faces), "hip_12", may_open=True)


def test_fans_that_touch_at_a_vertex_get_a_vertex_each():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    apart = unpinched(TriangleMesh(vertices, [[0, 1, 2], [0, 3, 4]]))
    check_mesh(apart, "wings", may_open=True)
    assert len(apart.vertices) == 6
    assert np.abs(apart.vertices[apart.faces] - vertices[[[0, 1, 2], [0, 3, 4]]]).max() < 1e-3


@pytest.mark.parametrize(("vertices", "faces", "fault"), FAULTS)
def test_a_fault_is_named_with_the_subject_and_a_remedy(vertices, faces, fault):
    with pytest.raises(InputError) as caught:
        check_mesh(TriangleMesh(vertices, faces), "hip_12")
    assert str(caught.value).startswith("hip_12: the mesh ")
    assert fault in str(caught.value)


def test_sides_of_many_meshes_have_the_twins_of_each(unit_sphere):
    meshes = [TriangleMesh(*unit_sphere(300)), TriangleMesh(VERTICES, FACES), TriangleMesh(*unit_sphere(500))]
    sides = MeshSides.of(meshes)
    number = np.arange(len(sides.tail))
    head = sides.tail[3 * (number // 3) + (number + 1) % 3]
    assert (sides.tail[sides.twin] == head).all()
    assert (head[sides.twin] == sides.tail).all()


def test_distances_are_bounded_by_twice_the_longest_of_the_shortest_paths_along_edges(unit_sphere):
    meshes = [TriangleMesh(*unit_sphere(300)), TriangleMesh(VERTICES, FACES)]
    expected = []
    for mesh in meshes:
        a, b = edges(mesh.faces).T
        lengths = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
        graph = coo_array((lengths, (a, b)), shape=(len(mesh.vertices),) * 2)
        expected.append(dijkstra(graph.tocsr(), directed=False, indices=0).max())
    assert [task.max_distance for task in plan_tables(meshes, 1e6).tasks] == [2.0 * item for item in expected]


@pytest.mark.parametrize("exact", [True, False])
def test_coinciding_vertices_have_the_first_at_their_place(exact, monkeypatch):
    places = np.random.default_rng(0).integers(0, 6, size=(600, 3)).astype(float)
    if not exact:  # two places with one key
        monkeypatch.setattr(topology, "_keys_of_places", lambda vertices: vertices.sum(axis=1))
    expected = [int(np.flatnonzero((places == place).all(axis=1))[0]) for place in places]
    assert first_of_twins(places).tolist() == expected
