import numpy as np
import pytest

from homolog import geodesic_distances
from homolog.errors import InputError
from homolog.geodesics import distances_from, plan_tables, solve_tables
from homolog.surfaces.mesh import TriangleMesh


@pytest.mark.parametrize("d_max", [0.0, -3.0, np.nan])
def test_a_length_that_is_none_is_refused(sphere, d_max):
    with pytest.raises(InputError, match=r"femur_07: d_max is .*positive length"):
        solve_tables([sphere(50)], d_max, names=["femur_07"])[0]


def test_faces_that_do_not_agree_with_their_neighbours_are_refused_by_name(sphere):
    mesh = sphere(50)
    faces = np.concatenate([mesh.faces[:1, ::-1], mesh.faces[1:]])
    with pytest.raises(InputError, match=r"femur_07: .* opposite orientation"):
        solve_tables([TriangleMesh(mesh.vertices, faces)], 5.0, names=["femur_07"])[0]
    with pytest.raises(InputError, match="opposite orientation"):
        geodesic_distances(mesh.vertices, faces, 5.0)
    with pytest.raises(InputError, match="opposite orientation"):
        distances_from(TriangleMesh(mesh.vertices, faces), [0])


def test_faces_that_only_touch_at_a_vertex_are_refused(sphere):
    mesh = sphere(50)
    around = np.flatnonzero((mesh.faces == 0).any(axis=1))
    opposite = [
        face
        for face in around
        if not np.isin(mesh.faces[face], np.setdiff1d(mesh.faces[around[0]], [0])).any()
    ]
    faces = np.delete(mesh.faces, [around[0], opposite[0]], axis=0)
    with pytest.raises(InputError, match="touches itself at 1 vertices"):
        geodesic_distances(mesh.vertices, faces, 5.0)


def test_tables_above_the_memory_limit_are_refused_with_their_size(sphere):
    with pytest.raises(InputError, match=r"2 shapes .* GB, .* 0.001 GB"):
        plan_tables([sphere(2000)] * 2, 20.0, memory_limit=1_000_000)


def test_the_size_is_foretold(sphere):
    plan = plan_tables([sphere(2000)], 10.0)
    table = solve_tables([sphere(2000)], 10.0)[0]
    assert table.nbytes == pytest.approx(plan.nbytes, rel=0.25)


def test_sources_that_are_no_vertices_are_refused(sphere):
    for sources in ([], [-1], [50]):
        with pytest.raises(InputError, match="femur_07: sources"):
            distances_from(sphere(50), sources, name="femur_07")
