"""Lumbar vertebrae and proximal femora, built from simple solids and deformed."""

from collections.abc import Callable
from functools import cache

import numpy as np

from homolog.arrays import FloatArray
from homolog.samples.solids import cylinder, ellipsoid, rod, surface_of, united
from homolog.samples.study import SampleStudy, SampleSubject, Waves, bump, step, turned
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["make_femora", "make_vertebrae"]

_SPACING = 0.9  # mm, grid spacing of the average bones
_VERTICES = 12_000
_CUT = -95.0  # mm: height of the cut through the shaft of femora
_HEAD, _HEAD_RADIUS = np.array([44.0, -9.0, 42.0]), 23.5
_Deform = Callable[[FloatArray], FloatArray]


def _grid(low: tuple[float, ...], high: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    axes = [np.arange(start, end, _SPACING) for start, end in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), np.array(low)


@cache
def _vertebra() -> TriangleMesh:
    """Return an average lumbar vertebra: x to the left, y backward, z upward, the body around the origin."""
    points, low = _grid((-48.0, -24.0, -34.0), (48.0, 76.0, 30.0))
    across = np.abs(points)
    across[..., 1:] = points[..., 1:]  # symmetric
    waist = 1.0 + 0.1 * (np.abs(points[..., 2:]) / 13.5) ** 2
    body = (
        cylinder(points / np.concatenate([waist, waist, np.ones_like(waist)], axis=-1), (18.5, 13.0), 11.0)
        - 2.5
    )
    dish = 1.5 * np.exp(-0.5 * ((points[..., 0] / 11.0) ** 2 + (points[..., 1] / 8.0) ** 2))
    body = np.maximum(body, np.abs(points[..., 2]) - 13.5 + dish)
    pedicle = rod(across, (12.0, 9.0, 5.0), (14.5, 25.0, 3.0), (5.4, 6.2))
    lamina = rod(across, (14.0, 28.0, 0.0), (2.0, 41.0, -5.0), (6.2, 5.0))
    transverse = rod(across, (15.0, 25.0, 3.0), (41.0, 30.0, 5.0), (5.0, 3.2))
    upper = ellipsoid(across, (16.5, 29.0, 9.0), (5.0, 6.0, 10.5))
    lower = ellipsoid(across, (11.5, 36.0, -14.0), (5.5, 5.0, 11.0))
    spine = rod(points, (0.0, 42.0, 1.0), (0.0, 66.0, -6.0), (4.2, 3.2))
    for drop in (4.5, 9.0, 12.5):
        spine = united(
            spine, rod(points, (0.0, 42.0, 1.0 - drop), (0.0, 67.0, -6.0 - drop), (3.6, 3.6)), blend=5.0
        )
    bone = united(body, pedicle, blend=5.0)
    bone = united(bone, transverse, upper, lower, lamina, spine, blend=4.5)
    canal = ellipsoid(points, (0.0, 24.5, 0.0), (11.5, 9.0, 60.0))
    return surface_of(np.maximum(bone, -canal), low, _SPACING, _VERTICES)


@cache
def _femur() -> TriangleMesh:
    """Return the upper end of an average right femur: x to the left, y backward, z upward."""
    points, low = _grid((-46.0, -46.0, _CUT - 4.0), (76.0, 42.0, 74.0))
    bow = points.copy()
    bow[..., 1] += 3.0 * (points[..., 2] / _CUT) ** 2
    shaft = rod(bow, (0.0, 0.0, 0.0), (2.0, 0.0, _CUT - 30.0), (15.5, 13.0))
    flare = rod(points, (1.0, 0.0, 12.0), (2.0, 0.0, -62.0), (19.0, 3.0))
    line = rod(bow, (1.0, 9.0, -35.0), (2.0, 11.5, _CUT - 30.0), (3.0, 3.5))
    upper_neck = rod(points, (0.0, 0.0, 15.0), (38.0, -8.0, 41.5), (15.0, 13.0))
    lower_neck = rod(points, (5.0, 0.0, 6.0), (41.0, -8.5, 34.5), (15.5, 13.0))
    head = ellipsoid(points, tuple(_HEAD), (_HEAD_RADIUS,) * 3)
    pit = ellipsoid(points, tuple(_HEAD + (_HEAD_RADIUS + 3.0) * np.array([0.93, 0.33, -0.17])), (6.0,) * 3)
    greater = ellipsoid(points, (-16.0, 1.0, 12.0), (13.0, 18.0, 27.0))
    tip = ellipsoid(points, (-14.0, 9.0, 31.0), (9.0, 14.0, 13.5))
    crest = rod(points, (-11.0, 14.0, 28.0), (12.0, 13.0, -12.0), (7.0, 5.0))
    lesser = rod(points, (7.0, 6.0, -20.0), (17.5, 15.5, -16.0), (11.0, 4.5))
    fossa = ellipsoid(points, (-2.0, 13.0, 33.0), (6.0, 8.0, 9.0))
    bone = united(united(shaft, flare, blend=14.0), line, blend=6.0)
    bone = united(united(bone, upper_neck, lower_neck, blend=9.0), greater, blend=10.0)
    bone = united(united(bone, tip, crest, blend=7.0), lesser, blend=8.0)
    bone = united(_hollowed(bone, fossa, blend=6.0), head, blend=5.0)
    bone = _hollowed(bone, pit, blend=3.0)
    return surface_of(np.maximum(bone, _CUT - points[..., 2]), low, _SPACING, _VERTICES)


def _hollowed(bone: FloatArray, hollow: FloatArray, blend: float) -> FloatArray:
    """Return the difference of two solids, with a rounded edge."""
    return -united(-bone, hollow, blend=blend)


def make_vertebrae(subjects: int, seed: int) -> SampleStudy:
    """Return lumbar vertebrae of healthy people and of people with wedge fractures.

    A wedge fracture lowers the front of the body. Women's vertebrae are 8 % smaller.

    Parameters
    ----------
    subjects : int
        Number of subjects, half of them with a fracture.
    seed : int
        Random seed.
    """
    random = np.random.default_rng([seed, 2])
    made = []
    for number in range(subjects):
        group = ("healthy", "fracture")[number % 2]
        age, is_male = int(random.integers(50, 85)), bool(random.random() < 0.5)
        parameters = {
            "size": (1.0 if is_male else 0.92) * float(np.exp(random.normal(scale=0.04))),
            "body_height": float(np.exp(random.normal(scale=0.04))),
            "wedge": float(random.uniform(0.12, 0.3)) if group == "fracture" else 0.0,
            "spinous_process_mm": float(random.normal(scale=2.5)),
            "spinous_process_down": float(random.normal(scale=0.1)),
            "transverse_processes_mm": float(random.normal(scale=2.5)),
            "canal": float(random.normal(scale=0.05)),
        }
        move = _vertebra_of(parameters, Waves(random, 18.0, 0.5))
        columns = {"group": group, "age": str(age), "sex": "male" if is_male else "female"}
        made.append(_subject(f"vertebra_{number + 1:02d}", columns, parameters, _vertebra(), move))
    affected = _moved(_vertebra(), _vertebra_of({"wedge": 0.2}, None))
    return SampleStudy("vertebrae", tuple(made), _vertebra(), affected, voxel=1.0)


def _vertebra_of(values: dict[str, float], noise: Waves | None) -> _Deform:
    def deform(points: FloatArray) -> FloatArray:
        x, y, z = points.T.copy()
        in_body = 1.0 - step(y, 9.0, 22.0)
        z = z * (1.0 + (values.get("body_height", 1.0) - 1.0) * in_body)
        z = z - values.get("wedge", 0.0) * (z + 13.5) * (1.0 - step(y, -14.0, 14.0))  # the upper front sinks
        behind = step(y, 42.0, 66.0)
        y = y + values.get("spinous_process_mm", 0.0) * behind
        z = z - values.get("spinous_process_down", 0.0) * (y - 42.0) * behind
        x = x + np.sign(x) * values.get("transverse_processes_mm", 0.0) * step(np.abs(x), 20.0, 40.0)
        near = np.exp(-0.5 * ((x / 13.0) ** 2 + ((y - 24.5) / 11.0) ** 2))
        x, y = (
            x * (1.0 + values.get("canal", 0.0) * near),
            24.5 + (y - 24.5) * (1.0 + values.get("canal", 0.0) * near),
        )
        moved = values.get("size", 1.0) * np.stack([x, y, z], axis=1)
        return moved if noise is None else moved + noise(points)

    return deform


def make_femora(subjects: int, seed: int) -> SampleStudy:
    """Return upper ends of femora, left and right, cut through the shaft, some with a cam deformity.

    A cam deformity is a bump in front of and above the neck, where the head begins.

    Parameters
    ----------
    subjects : int
        Number of subjects, half of them with the deformity; half of each group are left femora.
    seed : int
        Random seed.
    """
    random = np.random.default_rng([seed, 3])
    made = []
    for number in range(subjects):
        group, side = ("healthy", "cam")[number % 2], ("right", "left")[number // 2 % 2]
        age, is_male = int(random.integers(18, 45)), bool(random.random() < 0.6)
        parameters = {
            "size": (1.0 if is_male else 0.91) * float(np.exp(random.normal(scale=0.04))),
            "neck_shaft_deg": float(random.normal(scale=4.0)),
            "anteversion_deg": float(random.normal(scale=6.0)),
            "head": float(np.exp(random.normal(scale=0.03))),
            "greater_trochanter_mm": float(random.normal(scale=1.5)),
            "cam_mm": float(random.uniform(3.5, 6.5)) if group == "cam" else 0.0,
        }
        move = _femur_of(parameters, Waves(random, 25.0, 0.6))
        columns = {"group": group, "side": side, "age": str(age), "sex": "male" if is_male else "female"}
        subject = _subject(f"femur_{number + 1:02d}", columns, parameters, _femur(), move)
        if side == "left":
            mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
            subject = SampleSubject(subject.name, columns, parameters, subject.mesh.placed(mirror))
        made.append(subject)
    affected = _moved(_femur(), _femur_of({"cam_mm": 5.0}, None))
    return SampleStudy("femora", tuple(made), _femur(), affected, voxel=None)


def _femur_of(values: dict[str, float], noise: Waves | None) -> _Deform:
    root = np.array([6.0, -1.0, 12.0])
    cam = _HEAD + _HEAD_RADIUS * np.array([-0.66, -0.52, 0.54])

    def deform(points: FloatArray) -> FloatArray:
        moved = points.copy()
        outward = points - _HEAD
        outward = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
        moved += values.get("cam_mm", 0.0) * bump(points, cam, 10.0)[:, None] * outward
        near_head = step(-np.linalg.norm(points - _HEAD, axis=1), -36.0, -24.0)
        moved += (values.get("head", 1.0) - 1.0) * near_head[:, None] * (points - _HEAD)
        above = bump(points, np.array([-14.0, 9.0, 42.0]), 13.0)
        moved[:, 2] += values.get("greater_trochanter_mm", 0.0) * above
        share = step(points[:, 0] + 0.4 * points[:, 2], 12.0, 44.0)
        moved = turned(moved, root, 1, np.deg2rad(-values.get("neck_shaft_deg", 0.0)) * share)
        moved = turned(moved, root, 2, np.deg2rad(-values.get("anteversion_deg", 0.0)) * share)
        if noise is not None:
            still = step(points[:, 2], _CUT, _CUT + 20.0)  # the cut stays flat
            moved += still[:, None] * noise(points)
        return values.get("size", 1.0) * moved

    return deform


def _moved(mesh: TriangleMesh, deform: _Deform) -> TriangleMesh:
    return TriangleMesh(deform(np.array(mesh.vertices)), mesh.faces)


def _subject(
    name: str, columns: dict[str, str], parameters: dict[str, float], mesh: TriangleMesh, deform: _Deform
) -> SampleSubject:
    return SampleSubject(name, columns, parameters, _moved(mesh, deform))
