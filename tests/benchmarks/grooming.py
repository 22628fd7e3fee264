"""CPU seconds of grooming one file, stage by stage, and the most memory that it took.

``python tests/benchmarks/grooming.py FILE… [--label 5] [--spacing 0.8]`` grooms label maps and meshes;
kernels are loaded before. ``--synthetic FILE.nii.gz`` writes a label map of 512 x 512 x 600 voxels to try.
"""

import argparse
import resource
import time
from pathlib import Path

import numpy as np

from homolog.cohort import Subject
from homolog.grooming.clean import cleaned
from homolog.grooming.fields import distance_field
from homolog.grooming.levels import level_of_voxels
from homolog.grooming.subject import COARSE_VERTICES, read_source
from homolog.grooming.triangles import level_of_triangles
from homolog.settings import GroomSettings
from homolog.surfaces.isosurface import coarse_isosurface, isosurface
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.redistance import redistanced
from homolog.threads import on_one_thread


def write_synthetic(path):
    """Write a label map as of a whole body: 5 is an organ of 290 x 190 x 220 voxels with two lobes."""
    import nibabel

    values = np.zeros((512, 512, 600), np.uint8)
    axes = np.ogrid[:512, :512, :600]
    for label, centre, radii in (
        (5, (180, 250, 330), (120, 95, 110)),
        (5, (270, 220, 350), (90, 60, 60)),
        (1, (380, 300, 300), (40, 60, 50)),
        (9, (250, 350, 300), (30, 30, 280)),
    ):
        places = zip(axes, centre, radii, strict=True)
        values[sum(((x - c) / r) ** 2 for x, c, r in places) < 1.0] = label
    nibabel.save(nibabel.Nifti1Image(values, np.diag([0.78, 0.78, 0.8, 1.0])), path)


def stages(path, settings):
    """Yield the name and result of each stage."""
    source = read_source(Subject(path.name, path), settings)
    yield "read", source
    if isinstance(source, TriangleMesh):
        level = level_of_triangles(source, settings).level
    else:
        result = cleaned(source, settings.pieces)
        yield "clean", result
        level = level_of_voxels(result.segmentation, settings.spacing, settings.smoothing)
    yield "level", level
    smooth = distance_field(level, settings.smoothing, settings.tunnels)
    yield "distance", smooth.field
    mesh = isosurface(smooth.field, settings.mesh_edge, settings.adaptive_mesh, smooth.surface)
    yield "mesh", mesh
    yield "coarse mesh", coarse_isosurface(smooth.field, mesh, COARSE_VERTICES)


@on_one_thread
def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--label", type=int)
    parser.add_argument("--spacing", type=float)
    parser.add_argument("--synthetic", type=Path)
    options = parser.parse_args()
    if options.synthetic:
        write_synthetic(options.synthetic)
    settings = GroomSettings(label=options.label, spacing=options.spacing)
    axes = np.arange(12.0) - 5.4
    redistanced(np.linalg.norm(np.stack(np.meshgrid(axes, axes, axes)), axis=0) - 3.0)
    for path in options.files:
        actual, before, total = {}, time.process_time(), 0.0
        arguments = []
        for name, result in stages(path, settings):
            seconds = time.process_time() - before
            actual[name], total = result, total + seconds
            arguments.append(f"{name} {seconds:.2f}")
            before = time.process_time()
        field, mesh = actual["distance"], actual["mesh"]
        size = " x ".join(map(str, field.values.shape))
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0
        print(f"{path.name}: {', '.join(arguments)}; in all {total:.2f} CPU s, {most:.0f} MB so far")
        volume = mesh.volume / 1000.0
        print(f"    grid {size}, {field.spacing:.3g} mm; {len(mesh.vertices)} vertices, {volume:.2f} ml")


if __name__ == "__main__":
    main()
