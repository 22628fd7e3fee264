"""`kernels.step.mean_normals` on a CUDA device: a thread takes some shapes (a chunk) of one particle.

Sums over a chunk are written to (chunks, n) arrays, and added up by one thread for each particle, so that
results do not depend on the order in which threads end.
"""

import warp as wp

from homolog.correspondence.kernels.functions import log_map
from homolog.correspondence.kernels.particles import Layout, Pose

wp.set_module_options({"enable_backward": False, "fast_math": False})

__all__ = ["align", "average", "compute_logs", "karcher_step", "sum_logs"]


@wp.kernel
def align(
    c: Layout,
    per_chunk: int,
    poses: wp.array(dtype=Pose),
    positions: wp.array(dtype=wp.vec3),
    openings: wp.array(dtype=wp.vec4),
    centred: wp.array(dtype=wp.vec3),
    sums: wp.array2d(dtype=wp.vec4),
):
    """Write aligned positions, and the sums of them and of opening angles."""
    chunk, i = wp.tid()
    total = wp.vec4()
    for k in range(chunk * per_chunk, wp.min((chunk + 1) * per_chunk, c.shapes)):
        p = k * c.per_shape + i
        aligned = poses[k].linear * positions[p] + poses[k].shift
        centred[p] = aligned
        total += wp.vec4(aligned[0], aligned[1], aligned[2], openings[p][3])
    sums[chunk, i] = total


@wp.kernel
def average(c: Layout, sums: wp.array2d(dtype=wp.vec4), middles: wp.array(dtype=wp.vec4)):
    """Write mean positions and opening angles."""
    i = wp.tid()
    total = wp.vec4()
    for chunk in range(sums.shape[0]):
        total += sums[chunk, i]
    middles[i] = total / float(c.shapes)


@wp.kernel
def sum_logs(
    c: Layout,
    per_chunk: int,
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    means: wp.array(dtype=wp.vec3),
    sums: wp.array2d(dtype=wp.vec3),
):
    """Write the sums of the Logs of normals at their present mean."""
    chunk, i = wp.tid()
    mean = means[i]
    total = wp.vec3()
    for k in range(chunk * per_chunk, wp.min((chunk + 1) * per_chunk, c.shapes)):
        total += log_map(mean, poses[k].rotation * normals[k * c.per_shape + i])
    sums[chunk, i] = total


@wp.kernel
def karcher_step(c: Layout, sums: wp.array2d(dtype=wp.vec3), means: wp.array(dtype=wp.vec3)):
    """Move the mean normals by the mean Logs."""
    i = wp.tid()
    total = wp.vec3()
    for chunk in range(sums.shape[0]):
        total += sums[chunk, i]
    shift = total / float(c.shapes)
    angle = wp.length(shift)
    if angle > 1.0e-7:
        means[i] = wp.normalize(wp.cos(angle) * means[i] + wp.sin(angle) / angle * shift)


@wp.kernel
def compute_logs(
    c: Layout,
    poses: wp.array(dtype=Pose),
    normals: wp.array(dtype=wp.vec3),
    openings: wp.array(dtype=wp.vec4),
    means: wp.array(dtype=wp.vec3),
    middles: wp.array(dtype=wp.vec4),
    centred: wp.array(dtype=wp.vec3),
    logs: wp.array(dtype=wp.vec3),
):
    """Centre positions; write the Logs, with the centred opening angle along the mean normal."""
    p = wp.tid()
    i = p % c.per_shape
    middle = middles[i]
    centred[p] = centred[p] - wp.vec3(middle[0], middle[1], middle[2])
    log = log_map(means[i], poses[p // c.per_shape].rotation * normals[p])
    logs[p] = log + (openings[p][3] - middle[3]) * means[i]
