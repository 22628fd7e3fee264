"""Metrics of corresponding particles on a bean cohort with known truth."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from homolog.arrays import FloatArray
from homolog.beans.generate import Bean
from homolog.beans.surface import BeanContact, closest_on_bean, surface_areas, surface_points

__all__ = ["BeanMetrics", "evaluate"]

_NEAR = 12
_SAME_SIDE = -0.5


@dataclass(frozen=True, slots=True)
class BeanMetrics:
    """Metrics of a set of particles on a bean cohort. Shares and R² are in [0, 1].

    Attributes
    ----------
    leak : float
        Share of the total variance outside the first two modes.
    ground_truth_r2 : float
        Share of the total variance that a linear regression of all coordinates on the true slot position
        and width explains: the best single figure, as it also decreases if particles are not in
        correspondence.
    r2_position, r2_width : float
        R² of the true position and width regressed on the scores of the first two modes.
    mode_shares : tuple of float
        Shares of the total variance by mode, largest first.
    var_per_particle : float
        Total variance over the number of particles [mm²]: hundreds if arrangements differ between
        shapes, near 0 if particles never entered the slot.
    slot_fill : float
        Share of particles on the slot over the slot's share of the area, mean over shapes.
    normals_over_90_pairs : float
        Share of all (particle, pair of shapes) whose exact normals differ by more than 90°.
    wall_swap : float
        Of all (particle, pair of shapes) that are on the slot in both shapes: share that is on opposite
        walls (`homolog.beans.surface.BeanContact`; the slot's floor counts as neither wall).
    distance_mean, distance_p95, distance_max : float
        Distance of the particles to the analytic surface [mm].
    nn_cv : float
        Standard deviation over mean of the distance to the nearest particle on the same side of the
        surface, mean over shapes. See `evaluate` for the distance.
    cover_max : float
        Largest distance from a surface point to the nearest particle on the same side, over the mean
        spacing (square root of area per particle); worst shape.
    """

    leak: float
    ground_truth_r2: float
    r2_position: float
    r2_width: float
    mode_shares: tuple[float, ...]
    var_per_particle: float
    slot_fill: float
    normals_over_90_pairs: float
    wall_swap: float
    distance_mean: float
    distance_p95: float
    distance_max: float
    nn_cv: float
    cover_max: float


def evaluate(particles: FloatArray, beans: Sequence[Bean]) -> BeanMetrics:
    """Evaluate particles on a bean cohort.

    Parameters
    ----------
    particles : (M, N, 3) array
        Corresponding particles of every bean, in the beans' own frame [mm].
    beans : sequence of Bean
        The M beans in the same order, M at least 4.

    Returns
    -------
    BeanMetrics

    Notes
    -----
    Distances between points of a surface are Euclidean, and only between points whose outward normals differ
    by less than 120°: this excludes the opposite wall of the slot and includes its rim. Within two spacings
    the Euclidean distance differs from the geodesic one by a few percent.
    """
    particles = np.asarray(particles, dtype=np.float64)
    contacts = [closest_on_bean(particle, bean) for particle, bean in zip(particles, beans, strict=True)]
    areas = np.array([surface_areas(bean) for bean in beans])
    distance = np.abs([contact.distance for contact in contacts])
    on_slot = np.array([contact.on_slot for contact in contacts])
    fill = on_slot.mean(axis=1) / (areas[:, 1] / areas[:, 0])
    spacing = np.sqrt(areas[:, 0] / particles.shape[1])
    variation, cover = np.transpose(
        [
            _sampling(particle, bean, contact)
            for particle, bean, contact in zip(particles, beans, contacts, strict=True)
        ]
    )
    opposite, swapped = _disagreements(contacts)
    leak, linear, r2_position, r2_width, shares, variance = _modes(particles, beans)
    return BeanMetrics(
        leak=leak,
        ground_truth_r2=linear,
        r2_position=r2_position,
        r2_width=r2_width,
        mode_shares=shares,
        var_per_particle=variance,
        slot_fill=float(fill.mean()),
        normals_over_90_pairs=opposite,
        wall_swap=swapped,
        distance_mean=float(distance.mean()),
        distance_p95=float(np.percentile(distance, 95)),
        distance_max=float(distance.max()),
        nn_cv=float(variation.mean()),
        cover_max=float((cover / spacing).max()),
    )


def _modes(
    particles: FloatArray, beans: Sequence[Bean]
) -> tuple[float, float, float, float, tuple[float, ...], float]:
    shapes, count, _ = particles.shape
    centred = (particles - particles.mean(axis=0)).reshape(shapes, -1)
    scores, sizes, _ = np.linalg.svd(centred, full_matrices=False)
    power = sizes[: shapes - 1] ** 2
    total = power.sum()
    truth = np.array([[bean.position, bean.width] for bean in beans])
    explained = _explained(truth, centred).sum() / total
    by_scores = _explained(scores[:, :2], truth) / ((truth - truth.mean(axis=0)) ** 2).sum(axis=0)
    shares = tuple(float(share) for share in power / total)
    variance = float(total / (shapes - 1) / count)
    return 1.0 - sum(shares[:2]), float(explained), float(by_scores[0]), float(by_scores[1]), shares, variance


def _explained(factors: FloatArray, values: FloatArray) -> FloatArray:
    """Sum of squares of each column of values that a linear regression on the factors explains."""
    design = factors - factors.mean(axis=0)
    basis, _ = np.linalg.qr(design)
    return np.asarray(((basis.T @ (values - values.mean(axis=0))) ** 2).sum(axis=0))


def _disagreements(contacts: Sequence[BeanContact]) -> tuple[float, float]:
    """Shares of (particle, pair of shapes) with opposite normals, and on opposite slot walls."""
    opposite = swapped = both = 0
    for item, other in combinations(contacts, 2):
        opposite += int(np.count_nonzero((item.normals * other.normals).sum(axis=1) < 0.0))
        both += int(np.count_nonzero(item.on_slot & other.on_slot))
        swapped += int(np.count_nonzero(item.wall * other.wall < 0))
    pairs = len(contacts) * (len(contacts) - 1) // 2
    return opposite / (pairs * len(contacts[0].wall)), swapped / both if both else 0.0


def _sampling(particles: FloatArray, bean: Bean, contact: BeanContact) -> tuple[float, float]:
    """Variation of the nearest-neighbour distance, and the largest hole [mm]."""
    tree = cKDTree(particles)
    neighbours = _nearest_on_side(tree, particles, contact.normals, contact.normals, skip=1)
    surface, normals = surface_points(bean)
    holes = _nearest_on_side(tree, surface, normals, contact.normals, skip=0)
    return float(neighbours.std() / neighbours.mean()), float(holes.max())


def _nearest_on_side(
    tree: cKDTree, points: FloatArray, normals: FloatArray, tree_normals: FloatArray, skip: int
) -> FloatArray:
    """Distance from each point to the nearest one of the tree on the same side of the surface."""
    answer = tree.query(points, k=range(1 + skip, min(_NEAR + skip, tree.n) + 1))
    distance, index = np.asarray(answer[0]), np.asarray(answer[1])
    same_side = np.einsum("ni,nki->nk", normals, tree_normals[index]) > _SAME_SIDE
    nearest = np.where(same_side, distance, np.inf).min(axis=1)
    return np.where(np.isfinite(nearest), nearest, distance[:, -1])
