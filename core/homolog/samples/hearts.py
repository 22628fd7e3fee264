"""Left ventricles: a cup of muscle with an apex, cut at its base, without papillary muscles.

In one group an infarct has thinned a sector of the wall, which bulges outward, and the cavity is wider.
"""

from dataclasses import dataclass, replace

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.samples.study import SampleStudy, SampleSubject, Waves, step
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["make_hearts"]

_RINGS, _AROUND, _RIM = 44, 88, 4  # numbers of vertices from apex to base, around, and across the rim
_BASE = np.deg2rad(112.0)  # angle of the base from the apex, at the centre of the cavity
_SECTOR, _SECTOR_HALF = np.deg2rad(60.0), np.deg2rad(38.0)  # infarct, around the long axis
_SECTOR_HEIGHT, _SECTOR_TALL = 0.5, 0.2  # from apex (0) to base (1)
_SEPTUM = np.deg2rad(180.0)


@dataclass(frozen=True, slots=True)
class _Ventricle:
    length: float = 62.0  # mm, middle of the cavity to the apex
    radius: float = 33.0  # mm, of the outer wall
    wall: float = 10.0  # mm, in the free wall
    flat: float = 0.07  # flattening of the septum
    tilt: float = 0.12  # of the base's plane
    infarct: float = 0.0  # 1 in the second group
    widening: float = 0.0  # mm, of the cavity

    def surface(self, outer: Waves | None, inner: Waves | None) -> TriangleMesh:
        """Return the mesh; noise moves the outer and the inner wall."""
        height, around = np.linspace(0.0, 1.0, _RINGS + 1)[1:], np.linspace(0, 2 * np.pi, _AROUND, False)
        u, theta = (each.ravel() for each in np.meshgrid(height, around, indexing="ij"))
        u, theta = np.append(0.0, u), np.append(0.0, theta)
        apart = np.angle(np.exp(1j * (theta - _SECTOR)))
        scar = np.exp(-0.5 * (apart / _SECTOR_HALF) ** 2 - 0.5 * ((u - _SECTOR_HEIGHT) / _SECTOR_TALL) ** 2)
        scar *= self.infarct
        outside = self._wall(u, theta, self.radius + self.widening + 2.0 * scar, self.length)
        thick = self.wall * (0.62 + 0.38 * step(u, 0.0, 0.35)) * (1.0 - 0.45 * scar)
        thick *= 1.0 - 0.08 * np.cos(theta - _SEPTUM) * step(u, 0.1, 0.5)
        inside = self._wall(
            u, theta, self.radius + self.widening + 2.0 * scar - thick, self.length - 1.15 * thick
        )
        if outer is not None and inner is not None:
            outside, inside = outside + outer(outside), inside + inner(inside)
        rim = [
            (1.0 - share) * outside[-_AROUND:] + share * inside[-_AROUND:]
            for share in np.linspace(0.0, 1.0, _RIM + 2)[1:-1]
        ]
        return TriangleMesh(np.concatenate([outside, *rim, inside]), _faces())

    def _wall(
        self, u: FloatArray, theta: FloatArray, radius: FloatArray, length: FloatArray | float
    ) -> FloatArray:
        polar = u * _BASE
        across = radius * np.sin(polar) ** 0.92
        across = across * (1.0 - self.flat * (1.0 + np.cos(theta - _SEPTUM)) * step(u, 0.15, 0.6))
        x, y = across * np.cos(theta), across * np.sin(theta)
        z = -length * np.cos(polar)
        return np.stack([x, y, z + self.tilt * x * step(u, 0.6, 1.0)], axis=1)


def make_hearts(subjects: int, seed: int) -> SampleStudy:
    """Return left ventricles of healthy people and of patients after an infarct.

    Age thickens the wall by 0.03 mm a year; women's ventricles are 7 % smaller.

    Parameters
    ----------
    subjects : int
        Number of subjects, half of them patients.
    seed : int
        Random seed.
    """
    random = np.random.default_rng([seed, 1])
    made = []
    for number in range(subjects):
        group = ("healthy", "infarct")[number % 2]
        age, is_male = int(random.integers(38, 80)), bool(random.random() < 0.5)
        size = (1.0 if is_male else 0.93) * float(np.exp(random.normal(scale=0.04)))
        severity = float(random.uniform(0.7, 1.3)) if group == "infarct" else 0.0
        ventricle = _Ventricle(
            length=size * float(random.normal(62.0, 3.0)),
            radius=size * float(random.normal(33.0, 1.5)),
            wall=float(random.normal(10.0, 0.5) + 0.03 * (age - 60)),
            flat=float(random.uniform(0.04, 0.1)),
            tilt=float(random.uniform(0.05, 0.2)),
            infarct=severity,
            widening=1.5 * severity,
        )
        mesh = ventricle.surface(Waves(random, 30.0, 0.5), Waves(random, 25.0, 0.5))
        columns = {"group": group, "age": str(age), "sex": "male" if is_male else "female"}
        parameters = {
            "length_mm": ventricle.length,
            "radius_mm": ventricle.radius,
            "wall_mm": ventricle.wall,
            "septum_flatness": ventricle.flat,
            "base_tilt": ventricle.tilt,
            "infarct_severity": severity,
        }
        made.append(SampleSubject(f"heart_{number + 1:02d}", columns, parameters, mesh))
    average = _Ventricle()
    affected = replace(average, infarct=1.0, widening=1.5)
    return SampleStudy(
        "hearts", tuple(made), average.surface(None, None), affected.surface(None, None), voxel=1.5
    )


def _faces() -> IntArray:
    """Return the faces: outer wall from its apex, rim, inner wall to its apex."""
    outer = 1 + np.arange(_RINGS * _AROUND).reshape(_RINGS, _AROUND)
    rim = outer[-1, -1] + 1 + np.arange(_RIM * _AROUND).reshape(_RIM, _AROUND)
    apex = int(rim[-1, -1]) + 1
    inner = apex + 1 + np.arange(_RINGS * _AROUND).reshape(_RINGS, _AROUND)
    rows = np.concatenate([outer, rim, inner[::-1]])
    a, b = rows[:-1].ravel(), np.roll(rows[:-1], -1, axis=1).ravel()
    c, d = rows[1:].ravel(), np.roll(rows[1:], -1, axis=1).ravel()
    first, last = rows[0], rows[-1]
    return np.concatenate(
        [
            np.stack([np.zeros_like(first), np.roll(first, -1), first], axis=1),
            np.stack([a, b, c], axis=1),
            np.stack([b, d, c], axis=1),
            np.stack([np.full_like(last, apex), last, np.roll(last, -1)], axis=1),
        ]
    )
