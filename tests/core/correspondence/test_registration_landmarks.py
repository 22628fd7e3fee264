"""First particles that are put on landmarks."""

import numpy as np

from homolog.correspondence.initialization.registration import InitialRegistration
from homolog.surfaces.mesh import TriangleMesh


def initial_particles(meshes, count, landmarks=None):
    poses = np.tile(np.eye(4), (len(meshes), 1, 1))
    return InitialRegistration(meshes, count, landmarks=landmarks).particles(poses)


def test_the_first_particles_are_the_vertices_nearest_to_the_landmarks(ellipsoid_shapes):
    meshes = [shape.coarse_mesh for shape in ellipsoid_shapes]
    marked = np.stack([mesh.vertices[[5, 90, 200, 310]] for mesh in meshes])
    result = initial_particles(meshes, 40, landmarks=marked + 1e-3)
    assert np.array_equal(result[:, :4], marked)
    assert len({tuple(point) for point in result[0]}) == 40


def test_landmarks_decide_where_the_shape_alone_cannot(ellipsoid_shapes):
    """A mesh turned about by half a turn looks the same; only landmarks tell."""
    source = ellipsoid_shapes[0].coarse_mesh
    plain = TriangleMesh(source.vertices / 0.12, source.faces)
    turn = np.diag([-1.0, -1.0, 1.0])
    turned = TriangleMesh(plain.vertices @ turn, plain.faces)
    middle = plain.vertices - plain.vertices.mean(axis=0)
    chosen = [int((middle @ way).argmax()) for way in np.vstack([np.eye(3), -np.eye(3)])]
    chosen += [int((middle @ [1.0, 1.0, 1.0]).argmax()), int((middle @ [1.0, -1.0, -1.0]).argmax())]
    marked = np.stack([plain.vertices[chosen], turned.vertices[chosen]])

    def error(landmarks):
        result = initial_particles([plain, turned], 60, landmarks=landmarks)
        return np.linalg.norm(result[1] - result[0] @ turn, axis=1).mean()

    spacing = np.sqrt(plain.area / 60)
    assert error(None) > spacing
    assert error(marked) < 0.5 * spacing


def test_landmarks_that_share_a_vertex_are_taken_once(ellipsoid_shapes):
    meshes = [shape.coarse_mesh for shape in ellipsoid_shapes]
    marked = np.stack([mesh.vertices[[5, 5, 90]] for mesh in meshes])
    result = initial_particles(meshes, 20, landmarks=marked)
    assert np.array_equal(result[:, :2], marked[:, 1:])
    assert len({tuple(point) for point in result[0]}) == 20
