"""Random label maps and meshes, as hard as people's own: a seed and a family make one.

Label maps have voxels of any shape. Meshes are surfaces of such solids, clean, or damaged as exported
meshes are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from homolog.errors import InputError
from homolog.surfaces.mesh import TriangleMesh
from homolog.surfaces.topology import check_mesh, face_components

__all__ = ["LABEL_MAPS", "MESHES", "LabelMap", "label_map", "random_mesh", "write_label_map"]

_Grid = np.ndarray  # (3, I, J, K) places [mm]


@dataclass(frozen=True, slots=True, eq=False)
class LabelMap:
    """Voxels of a structure and their place.

    Attributes
    ----------
    mask : (I, J, K) bool array
        True inside.
    spacing : (3,) array
        Of voxels along the three axes [mm].
    rotation : (3, 3) array
        Directions of the axes, LPS.
    origin : (3,) array
        Place of the first voxel [mm, LPS].
    """

    mask: np.ndarray
    spacing: np.ndarray
    rotation: np.ndarray
    origin: np.ndarray


def label_map(family: str, seed: int, most: float = 1e6) -> LabelMap:
    """Return a random label map.

    Parameters
    ----------
    family : str
        A name of `LABEL_MAPS`.
    seed : int
        Same seed, same voxels.
    most : float
        About as many voxels the largest structures have; the smallest have 30.
    """
    rng = np.random.default_rng([seed, *family.encode()])
    wanted = np.exp(rng.uniform(np.log(30.0), np.log(most)))
    anisotropy = 1.0 if rng.random() < 0.4 else np.exp(rng.uniform(0.0, np.log(8.0)))
    fine = np.exp(rng.uniform(np.log(0.05), np.log(5.0 / anisotropy)))
    # Half of the shapes are as thick across slices as along them; the others are squeezed like their voxels.
    squeezed = rng.random() < 0.5
    ratio = np.ones(3)
    ratio[rng.integers(3)] = anisotropy
    mask = LABEL_MAPS[family](rng, wanted, np.ones(3) if squeezed else ratio)
    least = 40.0
    while mask.sum() < 30:  # no structure of this size and kind
        mask = _ball(rng, least, np.ones(3))
        least *= 1.5
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
    axes[:, 0] *= np.linalg.det(axes)
    return LabelMap(mask, fine * ratio, axes, rng.uniform(-300.0, 300.0, 3))


def write_label_map(made: LabelMap, path: Path) -> None:
    """Write a label map as an image of 8 bits."""
    import SimpleITK

    image = SimpleITK.GetImageFromArray(made.mask.astype(np.uint8).transpose())
    image.SetSpacing(made.spacing.tolist())
    image.SetDirection(made.rotation.ravel().tolist())
    image.SetOrigin(made.origin.tolist())
    SimpleITK.WriteImage(image, path, useCompression=True)


def _places(extent: np.ndarray, ratio: np.ndarray) -> _Grid:
    """Return the places of voxels [finest voxels] in a box around zero."""
    sides = [
        np.arange(-n, n + 1) * r
        for n, r in zip(np.ceil(0.5 * extent / ratio).astype(int), ratio, strict=True)
    ]
    return np.stack(np.meshgrid(*sides, indexing="ij"))


def _random_field(rng: np.random.Generator, shape: tuple[int, ...], lengths: np.ndarray) -> np.ndarray:
    """Return a Gaussian random field of unit variance with correlation lengths [voxels]."""
    field = ndimage.gaussian_filter(
        rng.standard_normal(shape, np.float32), lengths / np.sqrt(2.0), mode="wrap"
    )
    return (field - field.mean()) / max(float(field.std()), 1e-9)


def _field_for(rng: np.random.Generator, box: float, ratio: np.ndarray) -> np.ndarray:
    """Return a random field in a box of so many voxels, correlation length 2 to 12 finest voxels."""
    length = rng.uniform(2.0, 12.0)
    side = max((box * ratio.prod()) ** (1 / 3), 3.0 * ratio.max())
    shape = tuple(np.maximum(np.round(side / ratio).astype(int), 3).tolist())
    return _random_field(rng, shape, length / ratio)


def _blobs(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """Whatever a random field has above a threshold: the usual pieces, bridges and pits."""
    share = rng.uniform(0.1, 0.6)
    field = _field_for(rng, wanted / share, ratio)
    return field > np.quantile(field, 1.0 - share)


def _sponge(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """What lies between two values of a random field: curved walls with holes."""
    share = rng.uniform(0.15, 0.4)
    field = _field_for(rng, wanted / share, ratio)
    return np.abs(field) < np.quantile(np.abs(field), share)


def _ball(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """A solid with bumps, as most organs are."""
    axes = np.exp(rng.uniform(-0.5, 0.5, 3))
    axes *= (0.75 * wanted * ratio.prod() / np.pi / axes.prod()) ** (1 / 3)
    places = _places(2.6 * axes, ratio)
    radius = np.sqrt((places**2 / (axes**2)[:, None, None, None]).sum(axis=0))
    bumps = _random_field(rng, radius.shape, rng.uniform(2.0, 12.0) / ratio)
    return radius < 1.0 + rng.uniform(0.0, 0.2) * bumps


def _noisy(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """A solid whose border voxels flicker, as a rough classifier leaves it."""
    mask = _ball(rng, wanted, ratio)
    border = ndimage.binary_dilation(mask, iterations=1) ^ ndimage.binary_erosion(mask)
    return mask ^ (border & (rng.random(mask.shape) < rng.uniform(0.05, 0.5)))


def _path(rng: np.random.Generator, count: int, length: float, closed: bool) -> np.ndarray:
    """Return points along a smooth random curve around zero."""
    turns = np.linspace(0.0, 2.0 * np.pi if closed else np.pi, count, endpoint=not closed)
    waves = np.arange(1, 5)
    weights = rng.normal(size=(2, len(waves), 3)) / waves[:, None] ** 1.5
    points = np.cos(turns[:, None] * waves) @ weights[0] + np.sin(turns[:, None] * waves) @ weights[1]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    points = points * (length / steps)
    return points - 0.5 * (points.min(axis=0) + points.max(axis=0))


def _around(points: np.ndarray, radii: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Return the voxels within the radius of any of the points."""
    places = _places(2.0 * (np.abs(points).max(axis=0) + radii.max() + 1.5 * ratio), ratio)
    distance, nearest = cKDTree(points).query(places.reshape(3, -1).T, distance_upper_bound=radii.max() + 1.0)
    inside = distance < np.append(radii, 0.0)[nearest]
    return inside.reshape(places.shape[1:])


def _tubes(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """A vessel of changing width with up to three branches."""
    radius = np.clip(rng.uniform(0.7, 6.0), 0.7, (wanted * ratio.prod()) ** (1 / 3) / 2.0)
    length = np.clip(wanted * ratio.prod() / (np.pi * radius**2), 2.0 * radius, 400.0)
    trunk = _path(rng, int(4 * length) + 4, length, closed=False)
    points, radii = [trunk], [radius * np.linspace(1.0, rng.uniform(0.3, 1.0), len(trunk))]
    for _ in range(rng.integers(4)):
        start = rng.integers(len(trunk))
        branch = _path(rng, int(2 * length) + 4, 0.5 * length, closed=False)
        points.append(branch - branch[0] + trunk[start])
        radii.append(np.full(len(branch), 0.7 * radii[0][start]))
    return _around(np.concatenate(points), np.concatenate(radii), ratio)


def _handles(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """Rings that hang together."""
    count = int(rng.integers(1, 6))
    radius = max(0.7, rng.uniform(0.1, 0.25) * (wanted * ratio.prod() / count) ** (1 / 3))
    length = np.clip(wanted * ratio.prod() / (np.pi * radius**2 * count), 8.0 * radius, 400.0)
    rings = [_path(rng, int(4 * length) + 4, length, closed=True) for _ in range(count)]
    for number in range(1, count):
        before = rings[number - 1]
        rings[number] += before[rng.integers(len(before))] - rings[number][0]
    points = np.concatenate(rings)
    points = points - 0.5 * (points.min(axis=0) + points.max(axis=0))
    return _around(points, np.full(len(points), radius), ratio)


def _sheets(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """A curved plate with a ragged rim, one voxel thick or a few."""
    thickness = rng.uniform(1.0, 5.0)
    side = np.clip(np.sqrt(wanted * ratio.prod() / thickness), 6.0, 250.0)
    height = np.clip(0.5 * side, 4.0, 120.0)
    places = _places(np.roll([side, side, height], rng.integers(3)), ratio)
    along = int(np.argmin(np.ptp(places, axis=(1, 2, 3))))
    others = [axis for axis in range(3) if axis != along]
    plane = places.shape[1:][others[0]], places.shape[1:][others[1]]
    lengths = np.maximum(side / rng.uniform(2.0, 5.0), 2.0) / ratio[others]
    lift = np.expand_dims(_random_field(rng, plane, lengths), along)
    hole = np.expand_dims(_random_field(rng, plane, 0.5 * lengths), along)
    radius = np.sqrt((places[others] ** 2).sum(axis=0)) / (0.5 * side)
    near = np.abs(places[along] - rng.uniform(0.0, 0.12) * height * lift) < 0.5 * thickness
    return near & (radius < 0.9 + 0.05 * hole) & (hole < rng.uniform(1.5, 4.0))


def _shells(rng: np.random.Generator, wanted: float, ratio: np.ndarray) -> np.ndarray:
    """A wall around a cavity that is closed, or open at an end or in a few places."""
    thickness = rng.uniform(1.2, 5.0)
    radius = np.clip(np.sqrt(wanted * ratio.prod() / (4.0 * np.pi * thickness)), thickness, 80.0)
    axes = radius * np.exp(rng.uniform(-0.4, 0.4, 3))
    places = _places(2.4 * axes + 2.0 * thickness, ratio)
    scaled = np.sqrt((places**2 / (axes**2)[:, None, None, None]).sum(axis=0))
    bumps = _random_field(rng, scaled.shape, 0.3 * radius / ratio)
    wall = np.abs(scaled - 1.0 - 0.05 * bumps) * radius < 0.5 * thickness
    opening = rng.integers(3)
    if opening == 1:
        wall &= places[rng.integers(3)] < rng.uniform(0.0, 0.9) * radius
    elif opening == 2:
        wall &= _random_field(rng, scaled.shape, 0.3 * radius / ratio) < rng.uniform(0.8, 2.5)
    return wall


LABEL_MAPS: dict[str, Callable[[np.random.Generator, float, np.ndarray], np.ndarray]] = {
    "blobs": _blobs,
    "sponges": _sponge,
    "bumpy solids": _ball,
    "noisy solids": _noisy,
    "tubes": _tubes,
    "handles": _handles,
    "sheets": _sheets,
    "shells": _shells,
}
"""Families of label maps by name."""


def random_mesh(family: str, seed: int, most: float = 60_000) -> TriangleMesh:
    """Return a random mesh.

    Parameters
    ----------
    family : str
        A name of `MESHES`.
    seed : int
        Same seed, same mesh.
    most : float
        About as many vertices the largest have; the smallest have 60.
    """
    rng = np.random.default_rng([seed, *family.encode()])
    vertices, faces = _closed(rng, most)
    size = np.exp(rng.uniform(np.log(2.0), np.log(500.0)))  # mm
    vertices = (vertices - vertices.mean(axis=0)) * (size / np.ptp(vertices, axis=0).max())
    vertices = vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0].T
    if TriangleMesh(vertices, faces).volume < 0.0:
        faces = faces[:, ::-1]
    vertices, faces = MESHES[family](rng, vertices, faces)
    return TriangleMesh(vertices + rng.uniform(-300.0, 300.0, 3), faces)


def _closed(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the surface of a random solid, closed and manifold, with triangles of any quality."""
    from skimage import measure

    side = int(np.clip(np.sqrt(np.exp(rng.uniform(np.log(60.0), np.log(most))) / 3.0), 5, 90))
    stretch = np.exp(rng.uniform(0.0, np.log(4.0), 3)) if rng.random() < 0.5 else np.ones(3)
    family = list(LABEL_MAPS)[rng.choice([0, 2, 4, 5, 6, 7])]
    sigma = rng.uniform(0.7, 1.5)
    for _ in range(20):
        mask = _largest(LABEL_MAPS[family](rng, side**3 / 4.0, np.ones(3)))
        smooth = ndimage.gaussian_filter(np.pad(mask, 5).astype(np.float32), sigma)
        if smooth.max() > 0.5:
            vertices, faces = measure.marching_cubes(smooth, 0.5, gradient_direction="ascent")[:2]
            mesh = _largest_piece(vertices.astype(float) * stretch, faces)
            if _is_clean(mesh):
                return mesh.vertices, mesh.faces
        family, side, sigma = "bumpy solids", side + 1, 0.9 * sigma
    raise AssertionError("no clean mesh was found")


def _largest(mask: np.ndarray) -> np.ndarray:
    labels, count = ndimage.label(mask)
    return labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]) if count else mask


def _largest_piece(vertices: np.ndarray, faces: np.ndarray) -> TriangleMesh:
    used, faces = np.unique(faces[face_components(faces) == 0], return_inverse=True)
    return TriangleMesh(vertices[used], faces.reshape(-1, 3))


def _is_clean(mesh: TriangleMesh) -> bool:
    try:
        check_mesh(mesh, "random")
    except InputError:
        return False
    return True


_Mesh = tuple[np.ndarray, np.ndarray]


def _clean(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    return vertices, faces


def _patch(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray, share: float) -> np.ndarray:
    """Return which faces lie around a random place."""
    middles = vertices[faces].mean(axis=1)
    distance = np.linalg.norm(middles - middles[rng.integers(len(faces))], axis=1)
    return distance <= np.quantile(distance, share)


def _holes(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    for _ in range(rng.integers(1, 6)):
        faces = faces[~_patch(rng, vertices, faces, rng.uniform(0.0, 0.03))]
    return vertices, faces


def _cut(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    """Cut off an end, as a bone's that leaves the image."""
    heights = (
        vertices[faces].mean(axis=1)
        @ np.linalg.svd(vertices - vertices.mean(axis=0), full_matrices=False)[2][0]
    )
    return vertices, faces[heights < np.quantile(heights, rng.uniform(0.6, 0.95))]


def _flipped(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    share = rng.choice([0.01, 0.3, 1.0])
    turned = rng.random(len(faces)) < share
    return vertices, np.where(turned[:, None], faces[:, ::-1], faces)


def _duplicates(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    """Faces with vertices of their own, some faces twice, some vertices unused, some faces without area."""
    soup = vertices[faces].reshape(-1, 3)
    corners = np.arange(len(soup)).reshape(-1, 3)
    twice = corners[rng.random(len(corners)) < 0.02]
    flat = corners[rng.random(len(corners)) < 0.02][:, [0, 1, 1]]
    return np.concatenate([soup, rng.normal(size=(5, 3)) + soup[0]]), np.concatenate([corners, twice, flat])


def _fins(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    """Edges with three faces: fins that stand off the surface."""
    chosen = faces[rng.choice(len(faces), min(len(faces), int(rng.integers(1, 20))), replace=False)]
    tips = vertices[chosen].mean(axis=1) + 0.02 * np.ptp(vertices, axis=0).max() * rng.normal(
        size=(len(chosen), 3)
    )
    fins = np.column_stack([chosen[:, :2], len(vertices) + np.arange(len(chosen))])
    return np.concatenate([vertices, tips]), np.concatenate([faces, fins])


def _pieces(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    """Small copies of the solid far from it, in it and across its surface."""
    result = vertices, faces
    for _ in range(rng.integers(1, 5)):
        at = rng.choice(vertices) + rng.normal(size=3) * rng.choice([0.0, 1.0]) * np.ptp(vertices, axis=0)
        copy = (vertices - vertices.mean(axis=0)) * rng.uniform(0.05, 0.3) + at
        result = np.concatenate([result[0], copy]), np.concatenate([result[1], faces + len(result[0])])
    return result


def _crossing(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    """Vertices that are shaken, so that the surface runs through itself."""
    edge = np.linalg.norm(vertices[faces[:, 0]] - vertices[faces[:, 1]], axis=1).mean()
    return vertices + rng.normal(scale=rng.uniform(0.1, 0.6) * edge, size=vertices.shape), faces


def _everything(rng: np.random.Generator, vertices: np.ndarray, faces: np.ndarray) -> _Mesh:
    for damage in (_pieces, _holes, _fins, _crossing, _duplicates):
        if rng.random() < 0.5:
            vertices, faces = damage(rng, vertices, faces)
    return vertices, faces


MESHES: dict[str, Callable[[np.random.Generator, np.ndarray, np.ndarray], _Mesh]] = {
    "clean": _clean,
    "holes": _holes,
    "cut off": _cut,
    "flipped faces": _flipped,
    "duplicates": _duplicates,
    "fins": _fins,
    "several pieces": _pieces,
    "crossing itself": _crossing,
    "all of these": _everything,
}
"""Families of meshes by name, by what is wrong with them."""
