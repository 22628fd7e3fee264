"""Second-order corrections of one cluster on one CPU core (see `homolog.geodesics.kernels.second_order`).

Update stencils are computed once, from the first-order distances. Corrections then follow by a few
multiplications, in passes from near to far, until they converge.
"""

import warp as wp

import homolog.device  # noqa: F401 - starts Warp
from homolog.geodesics.cpu.kernels.patch import (
    N_BUCKETS,
    LaneCounts,
    Lanes,
    Scratch,
    load_float,
    load_lanes,
    sort_into_buckets,
    store_lanes,
)
from homolog.geodesics.kernels.local_solver import UNREACHED, Corner, DistanceLimits, path_lower_bound
from homolog.geodesics.kernels.lookup import LANES
from homolog.geodesics.kernels.memory import corner_b, load_int
from homolog.geodesics.kernels.second_order import (
    CANDIDATE_TOLERANCE,
    LAST_CANDIDATE_BIT,
    MAX_ROUNDS,
    CornerAngles,
    angle_between,
    arrival_confidence,
    blend_weight,
    corner_stencil,
    correction_step,
    find_path,
    has_changed,
    initial_correction,
    wrap_angle,
)

# Lane loops must not be unrolled by Warp: the compiler then vectorizes them.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})


@wp.struct
class Corrections:
    """Second-order state of one cluster, in addition to `Scratch`."""

    arrival: wp.array(dtype=Lanes)  # (V,) arrival directions [rad]
    confidence: wp.array(dtype=Lanes)  # (V,) in arrivals; 0 out of range
    correction: wp.array(dtype=Lanes)  # (V,) 0 out of range
    unsorted: wp.array(dtype=wp.int32)  # (V,) vertices in range
    order: wp.array(dtype=wp.int32)  # (V,) vertices in range, near to far
    candidates: wp.array(dtype=wp.int32)  # (V,) corners of candidate paths, as bits
    changed_at: wp.array(dtype=wp.int32)  # (V,) clock of the last change of a vertex's corrections
    updated_at: wp.array(dtype=wp.int32)  # (V,) clock of their last update
    stencil_end: wp.array(dtype=wp.int32)  # (V,) end of each vertex's stencils, by position in order
    a: wp.array(dtype=wp.int32)  # (K,) ends of each stencil's edge
    b: wp.array(dtype=wp.int32)
    weight_b: wp.array(dtype=Lanes)
    offset: wp.array(dtype=Lanes)
    shortest_side: wp.array(dtype=float)  # (V,) [mm]


@wp.func
def sort_reached(scratch: Scratch, corrections: Corrections, limit: float) -> int:
    """List the vertices of the patch within a limit of any source, near to far; return how many."""
    for k in range(N_BUCKETS + 1):
        scratch.bucket[k] = 0
    scale = 0.9999 * float(N_BUCKETS) / limit
    n = int(0)
    for p in range(scratch.size[0]):
        v = load_int(scratch.patch, p)
        u = load_lanes(scratch.u, v)
        in_reach = int(0)
        for lane in range(LANES):
            in_reach |= wp.where(u[lane] <= limit, 1, 0)
        # Branchless: a branch would be mispredicted.
        k = int(wp.min(u[0], limit) * scale)
        corrections.unsorted[n] = v
        scratch.bucket_index[n] = k
        scratch.bucket[k + 1] += in_reach
        n += in_reach
    sort_into_buckets(scratch, n, corrections.unsorted, corrections.order)
    return n


@wp.func
def store_arrivals(
    corrections: Corrections,
    v: int,
    u: Lanes,
    shortest: Lanes,
    first: Lanes,
    total: Lanes,
    mean: Lanes,
    square: Lanes,
    cone_angle: float,
    edge: float,
):
    """Store a vertex's mean arrival directions, with their confidences and initial corrections.

    Parameters
    ----------
    shortest : Lanes
        Length of the shortest path.
    first, total, mean, square : Lanes
        Direction of the first path; sums over paths of weights, and of weighted deviations from the first
        and their squares.
    """
    for lane in range(LANES):
        inverse = 1.0 / wp.max(total[lane], 1.0e-30)
        mean[lane] *= inverse
        confidence = arrival_confidence(square[lane] * inverse, mean[lane])
        # No path, or only longer ones: a source.
        confidence = wp.where(total[lane] > 0.0, confidence, 0.0)
        square[lane] = wp.where(shortest[lane] - u[lane] < CANDIDATE_TOLERANCE * edge, confidence, 0.0)
        mean[lane] = wrap_angle(first[lane] + mean[lane], cone_angle)
    store_lanes(corrections.arrival, v, mean)
    store_lanes(
        corrections.correction, v, Lanes(initial_correction(load_float(corrections.shortest_side, v), edge))
    )
    store_lanes(corrections.confidence, v, square)


@wp.func
def find_arrivals(
    scratch: Scratch,
    corrections: Corrections,
    v: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    angles: wp.array(dtype=CornerAngles),
    limits: DistanceLimits,
):
    """Find the arrival directions at a vertex, and the corners of its candidate paths.

    Equally long paths are averaged.
    """
    u = load_lanes(scratch.u, v)
    edge = limits.mean_edge
    k = load_int(fan, v)
    end = load_int(fan, v + 1)
    cone_angle = angles[k].cone_angle_c
    shortest = Lanes(UNREACHED)
    first = Lanes(0.0)
    total = Lanes(0.0)
    mean = Lanes(0.0)
    square = Lanes(0.0)
    along_b = LaneCounts(0)
    candidates = int(0)
    bit = int(1)
    da = load_lanes(scratch.u, corner_b(corners, end - 1))
    while k < end:
        corner = corners[k]
        db = load_lanes(scratch.u, corner.b)
        may_improve = int(0)
        for lane in range(LANES):
            may_improve |= wp.where(
                path_lower_bound(corner, da[lane], db[lane]) < u[lane] + CANDIDATE_TOLERANCE * edge, 1, 0
            )
        if may_improve > 0:
            corner_angles = angles[k]
            n_candidates = int(0)
            for lane in range(LANES):
                path = find_path(corner, corner_angles, da[lane], db[lane], edge)
                shortest[lane] = wp.min(shortest[lane], path.distance)
                weight = path.weight * blend_weight(path.distance, u[lane], edge)
                first[lane] = wp.where(total[lane] == 0.0, path.arrival, first[lane])
                deviation = angle_between(first[lane], path.arrival, cone_angle)
                total[lane] += weight
                mean[lane] += weight * deviation
                square[lane] += weight * (deviation * deviation + path.degenerate)
                in_reach = (
                    u[lane] <= limits.propagation_limit
                    and path.distance - u[lane] < CANDIDATE_TOLERANCE * edge
                )
                is_duplicate = path.along_a * along_b[lane]  # the previous corner's path along its bc
                n_candidates |= wp.where(in_reach, 1 - is_duplicate, 0)
                along_b[lane] = path.along_b
            if n_candidates > 0:
                candidates = candidates | bit
        else:
            along_b = LaneCounts(0)
        bit = wp.where(bit < 1 << LAST_CANDIDATE_BIT, bit << 1, bit)
        da = db
        k += 1
    store_arrivals(corrections, v, u, shortest, first, total, mean, square, cone_angle, edge)
    corrections.candidates[v] = candidates


@wp.func
def cache_stencils(
    scratch: Scratch,
    corrections: Corrections,
    v: int,
    n: int,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    angles: wp.array(dtype=CornerAngles),
    limits: DistanceLimits,
) -> int:
    """Write a vertex's stencils from index n on; return the next index."""
    candidates = load_int(corrections.candidates, v)
    u = load_lanes(scratch.u, v)
    first = load_int(fan, v)
    for k in range(first, load_int(fan, v + 1)):
        if (candidates & 1) != 0:
            corner = corners[k]
            corner_angles = angles[k]
            da = load_lanes(scratch.u, corner.a)
            db = load_lanes(scratch.u, corner.b)
            arrival_a = load_lanes(corrections.arrival, corner.a)
            arrival_b = load_lanes(corrections.arrival, corner.b)
            confidence_a = load_lanes(corrections.confidence, corner.a)
            confidence_b = load_lanes(corrections.confidence, corner.b)
            weight_b = Lanes(0.0)
            offset = Lanes(0.0)
            for lane in range(LANES):
                stencil = corner_stencil(
                    corner,
                    corner_angles,
                    da[lane],
                    db[lane],
                    arrival_a[lane],
                    arrival_b[lane],
                    confidence_a[lane],
                    confidence_b[lane],
                    u[lane],
                    limits.mean_edge,
                )
                weight_b[lane] = stencil.weight_b
                offset[lane] = stencil.offset
            corrections.a[n] = corner.a
            corrections.b[n] = corner.b
            store_lanes(corrections.weight_b, n, weight_b)
            store_lanes(corrections.offset, n, offset)
            n += 1
        candidates = wp.where(k - first < LAST_CANDIDATE_BIT, candidates >> 1, candidates)
    return n


@wp.func
def update_correction(
    scratch: Scratch, corrections: Corrections, v: int, first: int, end: int, edge: float
) -> int:
    """Compute a vertex's corrections from its stencils first … end; return 1 if any lane changed."""
    best = Lanes(UNREACHED)
    for n in range(first, end):
        of_a = load_lanes(corrections.correction, load_int(corrections.a, n))
        of_b = load_lanes(corrections.correction, load_int(corrections.b, n))
        weight_b = load_lanes(corrections.weight_b, n)
        offset = load_lanes(corrections.offset, n)
        for lane in range(LANES):
            value = offset[lane] + of_a[lane] + weight_b[lane] * (of_b[lane] - of_a[lane])
            best[lane] = wp.where(value < best[lane], value, best[lane])
    old = load_lanes(corrections.correction, v)
    u = load_lanes(scratch.u, v)
    step = correction_step(load_float(corrections.shortest_side, v), edge)
    changed = int(0)
    for lane in range(LANES):
        is_fixed = u[lane] == 0.0 or best[lane] > 0.5 * UNREACHED  # a source, or out of range
        best[lane] = wp.where(is_fixed, 0.0, best[lane])
        changed |= wp.where(has_changed(old[lane], best[lane], step), 1, 0)
    store_lanes(corrections.correction, v, best)
    return changed


@wp.func
def relax_pass(scratch: Scratch, corrections: Corrections, n_reached: int, clock: int, edge: float) -> int:
    """Update, near to far, the vertices that depend on changed corrections; return how many changed."""
    total = int(0)
    first = int(0)
    for p in range(n_reached):
        v = load_int(corrections.order, p)
        end = load_int(corrections.stencil_end, p)
        last_change = int(0)
        for n in range(first, end):
            last_change = wp.max(
                last_change,
                wp.max(
                    load_int(corrections.changed_at, load_int(corrections.a, n)),
                    load_int(corrections.changed_at, load_int(corrections.b, n)),
                ),
            )
        if clock == 0 or last_change > load_int(corrections.updated_at, v):
            corrections.updated_at[v] = clock + p + 1
            if update_correction(scratch, corrections, v, first, end, edge) > 0:
                corrections.changed_at[v] = clock + p + 1
                total += 1
        first = end
    return total


@wp.kernel
def correct_cluster(
    scratch: Scratch,
    corrections: Corrections,
    fan: wp.array(dtype=wp.int32),
    corners: wp.array(dtype=Corner),
    angles: wp.array(dtype=CornerAngles),
    limits: DistanceLimits,
):
    """Add second-order corrections to the distances that `sweep_cluster` has left in scratch."""
    n_reached = sort_reached(scratch, corrections, limits.propagation_limit)
    for p in range(n_reached):
        find_arrivals(scratch, corrections, corrections.order[p], fan, corners, angles, limits)
    n = int(0)
    for p in range(n_reached):
        n = cache_stencils(scratch, corrections, corrections.order[p], n, fan, corners, angles, limits)
        corrections.stencil_end[p] = n
    n_changed = int(1)
    round = int(0)
    while n_changed > 0 and round < MAX_ROUNDS:
        n_changed = relax_pass(scratch, corrections, n_reached, round * n_reached, limits.mean_edge)
        round += 1
    for p in range(n_reached):
        v = corrections.order[p]
        scratch.u[v] = scratch.u[v] + corrections.correction[v]
        corrections.confidence[v] = Lanes(0.0)
        corrections.correction[v] = Lanes(0.0)
        corrections.changed_at[v] = 0
