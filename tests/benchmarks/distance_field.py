"""Signed distances on a grid: the fast iterative method beside exact transforms of the binary volume.

``python tests/benchmarks/distance_field.py --sizes 64 96 128`` prints error against the analytic distance to
a sphere, within 3 voxels of it and everywhere, and CPU and wall seconds, the median of five.
"""

import argparse
import time

import numpy as np
import SimpleITK
from scipy import ndimage

from homolog.surfaces.redistance import redistanced


def scipy_exact(inside):
    return np.where(
        inside, 0.5 - ndimage.distance_transform_edt(inside), ndimage.distance_transform_edt(~inside) - 0.5
    )


def simpleitk_maurer(inside):
    image = SimpleITK.GetImageFromArray(inside.astype(np.uint8))
    signed = SimpleITK.SignedMaurerDistanceMap(image, squaredDistance=False, useImageSpacing=False)
    return SimpleITK.GetArrayFromImage(signed)


def median_times(function, argument):
    """Return the result and the median CPU and wall seconds of five calls after a warm one."""
    function(argument)
    cpu, wall = [], []
    for _ in range(5):
        started = time.process_time(), time.perf_counter()
        result = function(argument)
        cpu.append(time.process_time() - started[0])
        wall.append(time.perf_counter() - started[1])
    return result, float(np.median(cpu)), float(np.median(wall))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[64, 96, 128])
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args()
    print("nodes  method                  near mean  near max  mean    max     CPU s   wall s")
    for size in options.sizes:
        axes = [np.arange(size) - 0.5 * size + shift for shift in (0.13, 0.27, 0.41)]
        radius = np.linalg.norm(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), axis=-1)
        exact = radius - 0.35 * size
        quadric = (radius / (0.35 * size)) ** 2 - 1.0
        rows = {
            "FIM, second order": (lambda level: redistanced(level, device=options.device), quadric),
            "FIM, first order": (
                lambda level: redistanced(level, device=options.device, second_order=False),
                quadric,
            ),
            "scipy exact EDT": (scipy_exact, exact < 0.0),
            "SimpleITK SignedMaurer": (simpleitk_maurer, exact < 0.0),
        }
        for name, (function, argument) in rows.items():
            result, cpu, wall = median_times(function, argument)
            error = np.abs(result - exact)
            near = error[np.abs(exact) < 3.0]
            print(
                f"{size}³".ljust(6),
                name.ljust(23),
                f"{near.mean():.4f}     {near.max():.3f}     "
                f"{error.mean():.4f}  {error.max():.3f}   {cpu:.3f}   {wall:.3f}",
            )


if __name__ == "__main__":
    main()
