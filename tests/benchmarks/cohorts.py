"""Any cohorts with default settings: groomed, aligned, optimized with several particle numbers and seeds.

``python tests/benchmarks/cohorts.py FOLDER… --particles 64 256 --seeds 0 1 2 [--label NUMBER] [--check]
[--truth]`` prints a line a cohort on its surfaces, and a line a run: why it ended, iterations, particles that
were repaired, the objective, and with ``--check`` how many findings of each kind `homolog check` has.
``--truth`` is for meshes that share their topology: a particle's true place on another subject is the same
point of the same face there, and the errors of all particles between all pairs of subjects are summed up.
"""

import argparse
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pyvista
from dense_truth import truth_errors

from homolog.cohort import read_cohort
from homolog.correspondence import Shape, load_kernels, optimize
from homolog.device import choose_device, describe_device
from homolog.errors import HomologError
from homolog.grooming import Problem, groom_cohort
from homolog.inspection import inspect
from homolog.registration import align_cohort
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--particles", nargs="+", type=int, default=[256])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--pattern", help="where the files are below each folder: labels/{subject}.nii.gz")
    parser.add_argument("--label", type=int, help="number of the structure in label maps")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--truth", action="store_true", help="errors against the meshes' own topology")
    options = parser.parse_args()
    device = choose_device()
    load_kernels(device)
    print(describe_device(device))
    for folder in options.folders:
        try_cohort(folder, options, device)


def try_cohort(folder, options, device):
    settings = GroomSettings(label=options.label)
    problems: list[Problem] = []
    begun = time.perf_counter()
    cohort = read_cohort(folder, options.pattern)
    groomed = groom_cohort(cohort, settings, left_out=problems)
    cohort = cohort.without({problem.subject for problem in problems})
    seconds = time.perf_counter() - begun
    fine, coarse = (
        [len(mesh.vertices) for mesh in kind]
        for kind in ([subject.mesh for subject in groomed], [subject.coarse_mesh for subject in groomed])
    )
    genus = sorted(subject.report.genus for subject in groomed)
    print(
        f"{folder.name}: {len(groomed)} groomed, {len(problems)} refused, genus {genus}, "
        f"vertices {min(fine)}-{max(fine)} and {min(coarse)}-{max(coarse)}, {seconds:.0f} s"
    )
    for problem in problems:
        print(f"    {problem.message}")
    groomed, alignments = align_cohort(cohort, groomed, settings)
    shapes = [
        Shape(subject.name, subject.field, subject.mesh, subject.coarse_mesh, alignment)
        for subject, alignment in zip(groomed, alignments, strict=True)
    ]
    for count in options.particles:
        for seed in options.seeds:
            placing = RunSettings(
                groom=settings, optimize=OptimizeSettings(particles=count, seed=seed)
            ).placing
            begun = time.perf_counter()
            try:
                result = optimize(shapes, placing, device=device)
            except HomologError as error:
                print(f"    {count:5d} seed {seed}: {type(error).__name__}: {error}")
                continue
            seconds = time.perf_counter() - begun
            kinds = ""
            if options.check:
                meshes = [subject.mesh for subject in groomed]
                names = [subject.name for subject in groomed]
                suspects = inspect(result.local, meshes, result.alignments, names=names).suspects
                kinds = ", ".join(
                    f"{n} {kind}" for kind, n in Counter(s.kind.value for s in suspects).items()
                )
            if options.truth:
                kinds += truth_of([subject.path for subject in cohort.subjects], result.local)
            print(
                f"    {count:5d} seed {seed}: {result.reason.value} after {result.iterations}, "
                f"{(result.repaired > 0).sum()} repaired, objective {result.energies[-1, 1:].sum():.3f}, "
                f"{seconds:.1f} s {kinds}"
            )


def truth_of(paths, local):
    """Return mean and 95th percentile of the errors [mm] of particles (M, N, 3), and of spacings."""
    meshes = [pyvista.read(path) for path in paths]
    errors = truth_errors(meshes, local)
    spacing = np.sqrt(np.mean([mesh.area for mesh in meshes]) / local.shape[1] * 2.0 / np.sqrt(3.0))
    return (
        f", truth: mean {np.mean(errors):.3f} mm, 95 % {np.percentile(errors, 95):.2f} mm, "
        f"{100 * np.mean(errors < spacing / 2):.1f} % within half a spacing of {spacing:.1f} mm"
    )


if __name__ == "__main__":
    main()
