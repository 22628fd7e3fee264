"""Means over the shapes: of positions, opening angles and normals, and deviations from them."""

import math
from typing import Any

import warp as wp

from homolog.arrays import DeviceArray
from homolog.correspondence.kernels import means as mean_kernels
from homolog.correspondence.kernels import step as step_kernels
from homolog.correspondence.kernels.particles import Layout
from homolog.correspondence.launcher import Launcher

__all__ = ["DeviceMeans", "Means"]

ROUNDS = 2  # of the Fréchet mean; the same number as in `kernels.step.mean_normals`


class Means:
    """Centres positions and normals over the shapes, on the CPU with one thread for each particle."""

    def __init__(self, layout: Layout, launcher: Launcher) -> None:
        self.layout, self.launch = layout, launcher
        self.shapes, self.count = int(layout.shapes), int(layout.per_shape)

    def __call__(
        self,
        poses: DeviceArray,
        surface: tuple[DeviceArray, DeviceArray, DeviceArray],
        means: DeviceArray,
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Update the mean normals, and compute deviations from the means.

        Parameters
        ----------
        poses : (M,) array of Pose
        surface : three (M n,) arrays
            Positions, normals and opening angles.
        means : (n,) array of vec3
            Mean normals of the iteration before.
        out : two (M n,) arrays of vec3
            Where aligned positions minus their means, and Logs of the normals are written.
        """
        self.launch(step_kernels.mean_normals, self.count, [self.layout, poses, *surface, means, *out])


class DeviceMeans(Means):
    """The same on a CUDA device, for which particles alone are too few threads."""

    def __init__(self, layout: Layout, launcher: Launcher) -> None:
        super().__init__(layout, launcher)
        self._per_chunk = max(8, math.isqrt(self.shapes))
        self._chunks = -(-self.shapes // self._per_chunk)
        sums, on_device = (self._chunks, self.count), {"device": launcher.device}
        self._sums: DeviceArray = wp.zeros(sums, dtype=wp.vec4, **on_device)
        self._log_sums: DeviceArray = wp.zeros(sums, dtype=wp.vec3, **on_device)
        self._middles: DeviceArray = wp.zeros(self.count, dtype=wp.vec4, **on_device)

    def __call__(
        self,
        poses: DeviceArray,
        surface: tuple[DeviceArray, DeviceArray, DeviceArray],
        means: DeviceArray,
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Update the mean normals, and compute deviations from the means (see `Means`)."""
        positions, normals, openings = surface
        centred, logs = out
        chunks = (self._chunks, self.count)
        given = [self.layout, self._per_chunk, poses]
        self._run(mean_kernels.align, chunks, [*given, positions, openings, centred, self._sums])
        self._run(mean_kernels.average, self.count, [self.layout, self._sums, self._middles])
        for _ in range(ROUNDS):
            self._run(mean_kernels.sum_logs, chunks, [*given, normals, means, self._log_sums])
            self._run(mean_kernels.karcher_step, self.count, [self.layout, self._log_sums, means])
        self._run(
            mean_kernels.compute_logs,
            self.shapes * self.count,
            [self.layout, poses, normals, openings, means, self._middles, centred, logs],
        )

    def _run(self, kernel: Any, dimensions: int | tuple[int, int], inputs: list[Any]) -> None:  # noqa: ANN401
        wp.launch(kernel, dim=dimensions, inputs=inputs, device=self.launch.device)
