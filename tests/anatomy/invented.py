"""Invented anatomies: solids of smoothly joined ellipsoids and tubes, with handles, thin walls or slits.

Each is a function from points (…, 3) of a cube of half side `HALF` to a level that is negative inside; solids
are about 2 wide.
"""

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation
from skimage import measure

from homolog.surfaces.mesh import TriangleMesh

NODES, HALF = 112, 1.35  # of the grid of a solid, and half its side; solids are about 2 wide


def joined(parts, width=0.04):
    """Return the smooth union of solids."""
    values = np.stack(parts)
    least = values.min(axis=0)
    return least - width * np.log(np.exp(-(values - least) / width).sum(axis=0))


def without(solid, *cavities, width=0.03):
    return -joined([-solid, *cavities], width)


def tube(p, start, end, radius, last=None):
    a, along = np.array(start, float), np.subtract(end, start)
    t = np.clip(((p - a) @ along) / (along @ along), 0.0, 1.0)
    last = radius if last is None else last
    return np.linalg.norm(p - (a + t[..., None] * along), axis=-1) - (radius + (last - radius) * t)


def path(p, points, radii, width=0.02):
    radii = np.broadcast_to(radii, len(points))
    every = range(len(points) - 1)
    return joined([tube(p, points[i], points[i + 1], radii[i], radii[i + 1]) for i in every], width)


def ball(p, centre, radii, turn=(0, 0, 0)):
    q = (p - np.array(centre, float)) @ Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    radii = np.array(radii, float)
    return (np.linalg.norm(q / radii, axis=-1) - 1.0) * radii.min()


def ring(p, centre, radius, thickness, axes=(0, 1, 2), flat=1.0):
    q = (p - np.array(centre, float))[..., list(axes)]
    return np.hypot(np.hypot(q[..., 0], q[..., 1]) - radius, q[..., 2] / flat) - thickness


def arc(first, last, rx, ry, count=15, z=0.0):
    t = np.deg2rad(np.linspace(first, last, count))
    return np.column_stack([rx * np.cos(t), ry * np.sin(t), np.broadcast_to(z, count)])


def both(p, part):
    """Return a part and its mirror image, joined."""
    return np.minimum(part(p), part(p * [-1.0, 1.0, 1.0]))


def molar(p, fused=False):
    crown = [ball(p, (0, 0, 0.4), (0.5, 0.45, 0.35))]
    crown += [ball(p, (x, y, 0.65), (0.18, 0.17, 0.15)) for x in (0.24, -0.22) for y in (0.2, -0.18)]
    spread = 0.35 if fused else 1.0
    ends = [(0.36, 0.3, -0.8), (0.32, -0.28, -0.75), (-0.45, 0.0, -0.9)]
    roots = [(0.22, 0.17, 0.15), (0.2, -0.17, 0.15), (-0.22, 0, 0.15)]
    for start, end in zip(roots, ends, strict=True):
        crown.append(tube(p, start, np.multiply(end, (spread, spread, 1)), 0.18, 0.07))
    return joined(crown, 0.06 if fused else 0.04)


def incisor(p):
    edge = ball(p, (0, 0.04, 0.75), (0.34, 0.09, 0.3))
    return joined(
        [edge, ball(p, (0, 0, 0.4), (0.3, 0.2, 0.3)), tube(p, (0, 0, 0.3), (0.05, -0.05, -0.9), 0.22, 0.06)]
    )


def skullcap(p):
    return np.maximum(np.abs(ball(p, (0, 0, -0.2), (0.75, 0.95, 0.8))) - 0.045, -p[..., 2])


def skull(p):
    shell = np.abs(ball(p, (0, 0, 0.1), (0.7, 0.9, 0.75))) - 0.06
    face = joined([shell, ball(p, (0, 0.75, -0.5), (0.4, 0.3, 0.4))], 0.05)
    orbits = both(p, lambda q: ball(q, (0.28, 0.98, -0.2), (0.19, 0.32, 0.17)))
    face = without(face, orbits, tube(p, (0, 1.2, -0.5), (0, 0.6, -0.45), 0.1))
    return without(face, tube(p, (0, -0.25, -1.0), (0, -0.25, -0.4), 0.2), width=0.02)


def aortic_arch(p):
    t = np.linspace(0.0, np.pi, 11)
    arch = np.column_stack([0.12 * np.sin(t), 0.45 * np.cos(t), 0.1 + 0.45 * np.sin(t)])
    arch = np.vstack([(0, 0.5, -0.6), arch, (0.05, -0.47, -0.5), (0, -0.42, -1.15)])
    parts = [path(p, arch, np.linspace(0.2, 0.13, len(arch)))]
    branches = [((0.1, 0.22, 0.5), (0.35, 0.35, 1.05), 0.09), ((0.12, 0, 0.55), (0.1, 0.05, 1.1), 0.07)]
    branches.append(((0.1, -0.22, 0.5), (-0.15, -0.28, 1.05), 0.075))
    return joined([*parts, *(tube(p, *item) for item in branches)], 0.025)


def airway(p):
    trunk, left = (
        tube(p, (0, 0, 1.1), (0, 0.05, 0), 0.14, 0.13),
        tube(p, (0, 0.05, 0), (0.75, 0, -0.75), 0.11, 0.09),
    )
    return joined([trunk, left, tube(p, (0, 0.05, 0), (-0.9, 0.1, -0.5), 0.1, 0.075)], 0.03)


def vessels(p):
    parts = [path(p, [(0, 0, -1.1), (0.05, 0.1, -0.4), (0, 0, 0)], [0.13, 0.12, 0.11])]
    for x in (1, -1):
        fork = (0.45 * x, 0.15, 0.35 + 0.1 * x)
        parts.append(tube(p, (0, 0, 0), fork, 0.1, 0.085))
        parts += [tube(p, fork, np.add(fork, (0.4 * x, y, 0.5)), 0.08, 0.055) for y in (0.4, -0.35)]
    return joined(parts, 0.025)


def meniscus(p):
    q = p * [1.0, 1.15, 1.0]
    radius = np.hypot(q[..., 0], q[..., 1])
    wedge = np.maximum(
        np.abs(p[..., 2]) - 0.04 - 0.3 * np.clip(radius - 0.45, 0, 1), np.abs(radius - 0.68) - 0.26
    )
    return np.maximum(wedge, -(p[..., 0] + 0.35 - 0.15 * p[..., 1])) - 0.02


def annulus(p):
    t = np.linspace(0.0, 2.0 * np.pi, 33)
    points = np.column_stack([0.95 * np.cos(t), 0.7 * np.sin(t) - 0.15 * np.cos(2 * t), 0.18 * np.cos(2 * t)])
    return path(p, points, 0.1 + 0.02 * np.cos(t), 0.01)


def pelvis(p):
    rim = ring(p, (0, 0, -0.1), 0.62, 0.15, flat=1.2)
    blades = both(
        p,
        lambda q: np.maximum(
            np.abs(q[..., 0] - 0.6 - 0.4 * q[..., 2]) - 0.06, ball(q, (0.7, -0.1, 0.35), (0.5, 0.5, 0.5))
        ),
    )
    foramina = both(p, lambda q: ring(q, (0.38, 0.5, -0.5), 0.24, 0.09, (0, 2, 1)))
    return joined([rim, blades, foramina, ball(p, (0, -0.65, 0.05), (0.3, 0.2, 0.4))], 0.03)


def rib(p):
    line = arc(100, -75, 0.95, 0.8, 18, np.linspace(0.35, -0.45, 18))
    head = [
        tube(p, line[0], line[0] + [-0.12, -0.02, 0.03], 0.08, 0.09),
        ball(p, line[2] + [0, 0.08, 0], (0.1, 0.08, 0.09)),
    ]
    return joined([path(p, line, np.linspace(0.055, 0.075, 18), 0.01), *head], 0.02)


def kidney(p):
    return without(
        ball(p, (0, 0, 0), (0.45, 0.38, 0.8)), ball(p, (0.48, 0, 0.05), (0.25, 0.22, 0.28)), width=0.06
    )


def liver(p):
    right, left = (
        ball(p, (-0.35, 0, 0), (0.6, 0.5, 0.6)),
        ball(p, (0.45, 0.15, 0.2), (0.62, 0.33, 0.25), (0, -8, 0)),
    )
    lobes = joined([right, left, ball(p, (-0.05, -0.35, -0.05), (0.2, 0.22, 0.25))], 0.08)
    return without(
        lobes,
        ball(p, (-0.15, 0.45, -0.55), (0.3, 0.35, 0.35)),
        tube(p, (0.08, 0.7, 0), (0.08, 0.3, 0.1), 0.07),
    )


def mandible(p):
    body = path(p * [1, 1, 0.6], arc(-10, 190, 0.62, 0.8, 17) * [1, 1, 0.6] - [0, 0.25, 0], 0.09)

    def ramus(q):
        parts = [
            tube(q, (0.6, -0.38, 0), (0.63, -0.52, 0.5), 0.11, 0.09),
            tube(q, (0.63, -0.52, 0.5), (0.66, -0.62, 0.82), 0.08, 0.095),
        ]
        return joined([*parts, tube(q, (0.61, -0.4, 0.3), (0.58, -0.3, 0.8), 0.09, 0.045)], 0.03)

    return joined([body, both(p, ramus)], 0.04)


def tibia(p):
    plateau = [ball(p, (x, 0, 1.0), (0.2, 0.19, 0.12)) for x in (0.13, -0.13)]
    shaft = path(
        p,
        [(0, 0, 1.0), (0, 0.03, 0.6), (0.02, 0, 0), (0, 0, -0.8), (0, 0, -1.05)],
        [0.2, 0.12, 0.09, 0.085, 0.13],
    )
    return joined(
        [
            *plateau,
            shaft,
            ball(p, (0, 0.14, 0.8), (0.07, 0.08, 0.12)),
            tube(p, (-0.1, 0, -1.0), (-0.13, 0, -1.2), 0.06, 0.05),
        ],
        0.03,
    )


def fibula(p):
    line = [
        (0, 0, 1.2),
        (0.02, 0, 0.95),
        (0.05, 0.02, 0.2),
        (0.02, 0.03, -0.6),
        (0, 0, -0.95),
        (-0.02, 0, -1.2),
    ]
    return path(p, line, [0.07, 0.075, 0.045, 0.045, 0.08, 0.045])


def patella(p):
    whole = joined(
        [ball(p, (0, 0, 0.1), (0.6, 0.27, 0.5)), ball(p, (0.02, 0, -0.4), (0.25, 0.17, 0.35))], 0.05
    )
    facets = np.minimum(-p[..., 1] - 0.12 + 0.2 * p[..., 0], -p[..., 1] - 0.12 - 0.3 * p[..., 0])
    return np.maximum(whole, facets)


def folds(p, depth, count):
    return depth * np.sin(count * np.arctan2(p[..., 2] + 0.1, p[..., 1] + 0.9) + 0.8 * p[..., 0] ** 2)


def cerebellum(p):
    lobes = joined(
        [both(p, lambda q: ball(q, (0.45, 0, 0), (0.5, 0.5, 0.4))), ball(p, (0, -0.05, 0), (0.3, 0.45, 0.4))],
        0.06,
    )
    return 0.7 * (lobes + folds(p, 0.045, 22))


def cortex(p):
    """A folded sheet of constant thickness."""
    sheet = (
        p[..., 2]
        - 0.16 * np.sin(4.2 * p[..., 0] + 0.6 * p[..., 1])
        - 0.07 * np.sin(5.0 * p[..., 1])
        + 0.15 * p[..., 0] ** 2
    )
    outline = ball(p, (0, 0, 0), (1.05, 0.8, 1.0))
    return joined([np.maximum(np.abs(0.72 * sheet) - 0.055, outline)], 0.01)


def caudate(p):
    t = np.linspace(0.0, 1.0, 24)
    turn = np.deg2rad(200.0 - 300.0 * t)
    return path(
        p, np.column_stack([0.15 * t, 0.8 * np.cos(turn), 0.7 * np.sin(turn)]), 0.27 * (1 - t) ** 1.3 + 0.05
    )


def callosum(p):
    t = np.linspace(0.05, np.pi * 0.95, 15)
    line = np.column_stack([np.zeros(15), 0.95 * np.cos(t), 0.45 * np.sin(t)])
    line = np.vstack([line[:1] - [0, 0.15, 0.15], line])
    return path(
        p * [0.35, 1, 1], line, np.r_[0.07, 0.13, np.full(6, 0.08), np.full(4, 0.07), 0.08, 0.1, 0.13, 0.15]
    )


def lung(p):
    whole = without(
        ball(p, (0, 0, 0), (0.5, 0.65, 1.0)), ball(p, (0.6, 0.1, -0.25), (0.35, 0.4, 0.5)), width=0.05
    )
    return without(whole, ball(p, (0, 0, -1.2), (0.6, 0.7, 0.5)), width=0.03)


def lungs(p):
    return both(p, lambda q: lung((q - [0.66, 0, 0]) * [-1.3, 1.3, 1.3]) / 1.3)


def cochlea(p):
    t = np.linspace(0.0, 2.4 * 2.0 * np.pi, 60)
    radius = 0.8 * np.exp(-t / 13.0)
    return path(
        p,
        np.column_stack([radius * np.cos(t), radius * np.sin(t), 0.06 * t - 0.35]),
        np.linspace(0.16, 0.08, 60),
        0.01,
    )


def phalanx(p):
    ends = [
        both(p, lambda q: ball(q, (0.1, -0.02, -0.9), (0.13, 0.16, 0.13))),
        ball(p, (0, 0, 0.85), (0.26, 0.2, 0.18)),
    ]
    return joined(
        [
            *ends,
            path(p, [(0, 0, 0.9), (0, 0.04, 0.2), (0, 0.02, -0.5), (0, 0, -0.85)], [0.2, 0.14, 0.11, 0.14]),
        ],
        0.03,
    )


def atrium(p):
    veins = [
        tube(p, (0.4 * x, -0.2, z), (0.95 * x, -0.45, z + 0.1), 0.11, 0.1)
        for x in (1, -1)
        for z in (0.25, -0.15)
    ]
    appendage = path(
        p, [(0.35, 0.35, 0.1), (0.65, 0.6, 0.2), (0.75, 0.85, 0), (0.6, 1.0, -0.2)], [0.16, 0.12, 0.13, 0.07]
    )
    return joined([ball(p, (0, 0, 0), (0.6, 0.5, 0.5)), *veins, appendage], 0.04)


def right_ventricle(p):
    """A thin wall around a crescent, open at the base."""
    outer = without(
        ball(p, (0, 0, 0), (0.85, 0.8, 1.05)), ball(p, (-0.5, 0, 0.1), (0.75, 0.85, 1.4)), width=0.05
    )
    return np.maximum(np.abs(outer + 0.06) - 0.05, p[..., 2] - 0.4 - 0.1 * p[..., 1])


def template(solid):
    """Return the largest piece of a solid as a mesh in its own frame."""
    axis = np.linspace(-HALF, HALF, NODES)
    plane = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    levels = [solid(np.concatenate([np.full((NODES, NODES, 1), x), plane], axis=-1)) for x in axis]
    level = ndimage.gaussian_filter(np.array(levels), 0.6)
    vertices, faces, _, _ = measure.marching_cubes(level, 0.0)
    mesh = TriangleMesh(vertices * (axis[1] - axis[0]) - HALF, np.ascontiguousarray(faces, np.int32))
    return mesh if mesh.volume > 0.0 else flipped(mesh)


def flipped(mesh):
    return TriangleMesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]))
