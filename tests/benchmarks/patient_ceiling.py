"""How far two joint runs agree about subjects that both contain: what a fit of one of them can reach at most.

    python tests/benchmarks/patient_ceiling.py PROJECT OTHER [OTHER ...]

The runs differ by a left-out subject, by seed or by the number of particles. PROJECT's particles on each
shared subject are predicted by OTHER: those of every other shared subject are carried there by the thin-plate
map of OTHER's particles, the median of these counts, and is put on the surface. The row *even, odd* is the
same within PROJECT: odd particles predicted by even ones, the error of the interpolation. Prints a table in
Markdown; spacings are PROJECT's.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from homolog.correspondence.initialization.registration import snap_to_mesh
from homolog.io.project import ProjectFolder
from homolog.io.results import read_result, read_surface
from homolog.statistics.thin_plate import warp_displacements
from homolog.surfaces.mesh import TriangleMesh

NEAR = 0.3  # spacings


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, TriangleMesh]]:
    """Return particles and surfaces of each subject, in its file's frame."""
    project = ProjectFolder(path)
    result, record = read_result(project), project.read().result
    assert record is not None
    local = dict(zip(result.names, result.local, strict=True))
    subjects = zip(result.names, record.subjects, strict=True)
    return local, {name: read_surface(project, subject) for name, subject in subjects}


def distances(
    ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray], meshes: dict[str, TriangleMesh]
) -> dict[str, np.ndarray]:
    """Return how far each particle (n,) of ours lies from where theirs predict it, by subject [spacings]."""
    names = [name for name in ours if name in theirs]
    predicted: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for name in names:
        others = [other for other in names if other != name]
        moves = np.stack([theirs[other] - theirs[name] for other in others])
        moved = ours[name] + warp_displacements(theirs[name], ours[name], moves)
        for other, points in zip(others, moved, strict=True):
            predicted[other].append(points)
    result = {}
    for name in names:
        mesh = meshes[name]
        normals = mesh.vertex_normals[cKDTree(mesh.vertices).query(ours[name])[1]]
        points = snap_to_mesh(np.median(predicted[name], axis=0), normals, mesh)
        spacing = np.sqrt(mesh.area / len(ours[name]))
        result[name] = np.linalg.norm(points - ours[name], axis=1) / spacing
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("project", type=Path)
    parser.add_argument("others", type=Path, nargs="*")
    arguments = parser.parse_args()
    ours, meshes = read(arguments.project)
    alone = [{name: points[side::2] for name, points in ours.items()} for side in (1, 0)]
    rows = [("even, odd", distances(*alone, meshes))]
    rows += [(str(other), distances(ours, read(other)[0], meshes)) for other in arguments.others]
    print(
        f"| other run | within {NEAR} spacings (%) | 95 % within (spacings) | subjects with 95 % | lowest |"
    )
    print("|---|---|---|---|---|")
    for label, apart in rows:
        every = np.concatenate(list(apart.values()))
        shares = {name: 100.0 * (values < NEAR).mean() for name, values in apart.items()}
        enough, last = sum(share >= 95.0 for share in shares.values()), min(shares, key=shares.__getitem__)
        print(
            f"| {label} | {100.0 * (every < NEAR).mean():.1f} | {np.quantile(every, 0.95):.2f} | "
            f"{enough} of {len(shares)} | {last}, {shares[last]:.1f} % |"
        )


if __name__ == "__main__":
    main()
