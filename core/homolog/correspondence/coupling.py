"""What ties the shapes together in one iteration, on the host for the CPU and on the device for CUDA."""

from abc import ABC, abstractmethod

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, Float32Array, FloatArray
from homolog.correspondence import dual_kernels, kernels
from homolog.correspondence.dual import covariance, solve_duals
from homolog.correspondence.launcher import Launcher

__all__ = ["Coupling", "DeviceCoupling", "HostCoupling", "coupling"]


class Coupling(ABC):
    """Turns centred positions and Logs into the directions of H(Z) and H(V), and damps the step."""

    stiffness: DeviceArray

    def __init__(self, shapes: int, count: int, launcher: Launcher) -> None:
        self.shapes, self.count, self.launch = shapes, count, launcher
        self.stiffness = wp.zeros(1, dtype=float, device=launcher.device)

    @abstractmethod
    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Form and invert the regularized duals for this iteration's knobs."""

    @abstractmethod
    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs."""

    @abstractmethod
    def damp(self, steps: DeviceArray, damped: DeviceArray) -> None:
        """Apply the implicit part of the step."""

    @abstractmethod
    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""


class HostCoupling(Coupling):
    """numpy on the arrays of the CPU device, without a copy."""

    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Form and invert the regularized duals for this iteration's knobs."""
        knobs = stage.numpy()[int(iteration.numpy()[0])]
        self._duals = solve_duals(
            covariance(self._rows(centred)),
            covariance(self._rows(logs)),
            float(knobs["regularization"]),
            float(knobs["normals_regularization"]),
            float(knobs["step"] * knobs["ensemble_weight"]),
        )
        self.stiffness.numpy()[0] = np.diag(self._duals.normals).max()

    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs."""
        np.matmul(self._duals.gradient, self._rows(centred), out=self._rows(ensemble))
        np.matmul(self._duals.normals, self._rows(logs), out=self._rows(normals))

    def damp(self, steps: DeviceArray, damped: DeviceArray) -> None:
        """Apply the implicit part of the step."""
        np.matmul(self._duals.damping, self._rows(steps), out=self._rows(damped))

    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""
        return self._duals.entropies

    def _rows(self, vectors: DeviceArray) -> Float32Array:
        rows: Float32Array = vectors.numpy().reshape(self.shapes, 3 * self.count)
        return rows


class DeviceCoupling(Coupling):
    """Kernels only, so that an iteration can be captured as a CUDA graph."""

    def __init__(self, shapes: int, count: int, launcher: Launcher) -> None:
        super().__init__(shapes, count, launcher)
        make = {"device": launcher.device}
        self._covariances = [wp.zeros((shapes, shapes), dtype=wp.float64, **make) for _ in range(2)]
        size = (int(dual_kernels.MATRICES), shapes, shapes)
        self._matrices = [wp.zeros(size, dtype=wp.float64, **make) for _ in range(2)]
        self._logdets: DeviceArray = wp.zeros(size[0], dtype=wp.float64, **make)
        self._small = [wp.zeros((shapes, shapes), dtype=float, **make) for _ in range(3)]

    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Form and invert the regularized duals for this iteration's knobs."""
        device, shapes = self.launch.device, self.shapes
        divisor = float(self.count * max(shapes - 1, 1))
        for rows, out in zip((centred, logs), self._covariances, strict=True):
            wp.launch_tiled(
                dual_kernels.gram,
                dim=(shapes, shapes),
                inputs=[self.count, divisor, rows, out],
                block_dim=dual_kernels.BLOCK,
                device=device,
            )
        source: DeviceArray = self._matrices[0]
        target: DeviceArray = self._matrices[1]
        wp.launch(
            dual_kernels.regularize,
            dim=source.shape,
            inputs=[stage, iteration, *self._covariances, source, self._logdets, self.stiffness],
            device=device,
        )
        for pivot in range(shapes):
            wp.launch(
                dual_kernels.eliminate,
                dim=source.shape,
                inputs=[pivot, source, target, self._logdets],
                device=device,
            )
            source, target = target, source
        wp.launch(
            dual_kernels.finish,
            dim=(shapes, shapes),
            inputs=[stage, iteration, source, *self._small, self.stiffness],
            device=device,
        )

    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs."""
        self._mix(self._small[0], centred, ensemble)
        self._mix(self._small[2], logs, normals)

    def damp(self, steps: DeviceArray, damped: DeviceArray) -> None:
        """Apply the implicit part of the step."""
        self._mix(self._small[1], steps, damped)

    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""
        logdets = self._logdets.numpy()
        return np.array([logdets[0], logdets[2]]) * 0.5 * (self.shapes - 1) / self.shapes

    def _mix(self, matrix: DeviceArray, source: DeviceArray, target: DeviceArray) -> None:
        total = self.shapes * self.count
        self.launch(kernels.mix, total, [self.count, self.shapes, matrix, source, target])


def coupling(shapes: int, count: int, launcher: Launcher) -> Coupling:
    """Return the coupling for the launcher's device."""
    return (HostCoupling if launcher.device == "cpu" else DeviceCoupling)(shapes, count, launcher)
