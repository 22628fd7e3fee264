"""What the error of landmarks carried between vertebrae consists of, besides the correspondence.

    python tests/benchmarks/landmark_floor.py mirror FOLDER    each vertebra against its own mirror image
    python tests/benchmarks/landmark_floor.py started FOLDER   first particles on the experts' landmarks

FOLDER holds the shapes that optimizer.py has groomed.
"""

import argparse
import dataclasses
import sys
from functools import partial
from pathlib import Path

import numpy as np
from optimizer import expert_landmarks, load

from homolog.correspondence import Shape, optimize
from homolog.device import choose_device
from homolog.settings import OptimizeSettings
from homolog.statistics.thin_plate import landmark_errors
from homolog.surfaces.closest import closest_points
from homolog.surfaces.distance_field import DistanceField
from homolog.surfaces.mesh import TriangleMesh

FLIP = np.diag([-1.0, 1.0, 1.0, 1.0])
PARTNERS = ["ABCDEFGHIJ".index(name) for name in "DCBAFEGHIJ"]  # A is right of what D is left of


def mirrored(shape):
    """Return a shape's mirror image, from left to right."""
    meshes = [
        TriangleMesh(mesh.vertices @ FLIP[:3, :3], mesh.faces[:, ::-1].copy())
        for mesh in (shape.mesh, shape.coarse_mesh)
    ]
    back = FLIP.copy()  # the grid's first axis runs the other way, so that it stays right-handed
    back[0, 3] = len(shape.field.values) - 1
    field = DistanceField(shape.field.values[::-1].copy(), FLIP @ shape.field.index_to_world @ back)
    return Shape(f"{shape.name} mirrored", field, *meshes, FLIP @ shape.alignment @ FLIP)


def errors_of(shapes, landmarks, settings, device):
    """Optimize and carry the landmarks between all shapes."""
    result = optimize(shapes, settings, device=device)
    return result, landmark_errors(
        result.local, landmarks, [partial(closest_points, shape.mesh) for shape in shapes]
    )


def mirror(shapes, landmarks, settings, device):
    """Print the error between each vertebra and its own image, on which the same person put the landmarks."""
    images = [*shapes, *map(mirrored, shapes)]
    placed = np.concatenate([landmarks, (landmarks @ FLIP[:3, :3])[:, PARTNERS]])
    _, errors = errors_of(images, placed, settings, device)
    count = len(shapes)
    own = np.array([[errors[k, k + count], errors[k + count, k]] for k in range(count)])
    print(
        f"a vertebra and its own mirror image {own.mean():.2f} mm, by landmark "
        f"{np.round(own.mean(axis=(0, 1)), 1)}; two vertebrae {np.nanmean(errors[:count, :count]):.2f} mm"
    )


def started(shapes, landmarks, settings, device):
    """Print the error where first particles were put on the landmarks, and how far those have gone."""
    shapes = [dataclasses.replace(shape, landmarks=own) for shape, own in zip(shapes, landmarks, strict=True)]
    result, errors = errors_of(shapes, landmarks, settings, device)
    gone = np.linalg.norm(result.local[:, : landmarks.shape[1]] - landmarks, axis=-1)
    print(
        f"started on the landmarks {np.nanmean(errors):.2f} mm; the particles that began there are "
        f"{gone.mean():.1f} mm away"
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["mirror", "started"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--particles", type=int, default=512)
    parser.add_argument("--opening-weight", type=float, default=None)
    arguments = parser.parse_args()
    shapes = load(arguments.folder / "vertebrae.npz")
    options = {} if arguments.opening_weight is None else {"opening_weight": arguments.opening_weight}
    settings = OptimizeSettings(particles=arguments.particles, **options)
    {"mirror": mirror, "started": started}[arguments.what](
        shapes, expert_landmarks(shapes), settings, choose_device(arguments.device)
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
