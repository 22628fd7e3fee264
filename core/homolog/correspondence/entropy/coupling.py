"""What ties the shapes together in one iteration, on the host for the CPU and on the device for CUDA."""

from abc import ABC, abstractmethod

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, Float32Array, FloatArray
from homolog.correspondence.entropy.dual import covariance, solve_duals
from homolog.correspondence.kernels import dual as dual_kernels
from homolog.correspondence.kernels import particles as kernels
from homolog.correspondence.kernels import step as step_kernels
from homolog.correspondence.launcher import Launcher

__all__ = ["Coupling", "DeviceCoupling", "HostCoupling", "coupling"]


class Coupling(ABC):
    """The terms H(Z) and H(V): their gradients, and the implicit part of the step."""

    stiffness: DeviceArray

    def __init__(
        self, layout: kernels.Layout, free: DeviceArray, any_fixed: bool, launcher: Launcher
    ) -> None:
        self.layout, self.free, self.any_fixed, self.launch = layout, free, any_fixed, launcher
        self.shapes, self.count = int(layout.shapes), int(layout.per_shape)
        self.stiffness = wp.zeros(1, dtype=float, device=launcher.device)

    @abstractmethod
    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Form and invert the regularized duals for this iteration's parameters.

        Parameters
        ----------
        stage : array of StepParameters
            Of the stage's iterations.
        iteration : (1,) array
            The present one.
        centred : (M n,) array of vec3
            Aligned positions minus their mean over the shapes.
        logs : (M n,) array of vec3
            Logarithms of the normals at their mean, with the opening angles.
        """

    @abstractmethod
    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs.

        Parameters
        ----------
        centred, logs : (M n,) arrays of vec3
            As in `solve`, which is called before.
        ensemble, normals : (M n,) arrays of vec3
            Where the gradients are written.
        """

    def damp(
        self, stage: DeviceArray, iteration: DeviceArray, steps: DeviceArray, damped: DeviceArray
    ) -> None:
        """Apply the implicit part of the step.

        Parameters
        ----------
        stage, iteration : arrays
            As in `solve`.
        steps : (M n,) array of vec3
            Explicit steps of the particles in the aligned frame.
        damped : (M n,) array of vec3
            Where the damped steps are written.
        """
        if not self.any_fixed:
            self._damp_free(steps, damped)
            return
        total = self.shapes * self.count
        inputs = [self.layout, stage, iteration, self.free, *self._step_matrices(), steps, damped]
        self.launch(step_kernels.damp_with_fixed, total, inputs)

    @abstractmethod
    def _damp_free(self, steps: DeviceArray, damped: DeviceArray) -> None:
        """Apply it where no particle is held."""

    @abstractmethod
    def _step_matrices(self) -> tuple[DeviceArray, DeviceArray]:
        """Return W0 = (C + aI)^-1 and (I + pW0)^-1, (M, M) each."""

    @abstractmethod
    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""


class HostCoupling(Coupling):
    """numpy on the arrays of the CPU device, without a copy."""

    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Form and invert the regularized duals for this iteration's parameters."""
        parameters = stage.numpy()[int(iteration.numpy()[0])]
        self._duals = solve_duals(
            covariance(self._rows(centred)),
            covariance(self._rows(logs)),
            float(parameters["regularization"]),
            float(parameters["normals_regularization"]),
            float(parameters["step"] * parameters["ensemble_weight"]),
        )
        self.stiffness.numpy()[0] = np.diag(self._duals.normals).max()

    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs."""
        np.matmul(self._duals.gradient, self._rows(centred), out=self._rows(ensemble))
        np.matmul(self._duals.normals, self._rows(logs), out=self._rows(normals))

    def _damp_free(self, steps: DeviceArray, damped: DeviceArray) -> None:
        np.matmul(self._duals.damping, self._rows(steps), out=self._rows(damped))

    def _step_matrices(self) -> tuple[DeviceArray, DeviceArray]:
        return tuple(
            wp.array(matrix, dtype=float, device="cpu", copy=False)
            for matrix in (self._duals.gradient, self._duals.damping)
        )

    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""
        return self._duals.entropies

    def _rows(self, vectors: DeviceArray) -> Float32Array:
        rows: Float32Array = vectors.numpy().reshape(self.shapes, 3 * self.count)
        return rows


class DeviceCoupling(Coupling):
    """Kernels only, so that an iteration can be captured as a CUDA graph."""

    def __init__(
        self, layout: kernels.Layout, free: DeviceArray, any_fixed: bool, launcher: Launcher
    ) -> None:
        super().__init__(layout, free, any_fixed, launcher)
        shapes = self.shapes
        make = {"device": launcher.device}
        self._covariances = [wp.zeros((shapes, shapes), dtype=wp.float64, **make) for _ in range(2)]
        self._blocks = -(-shapes // int(dual_kernels.BLOCK_SIZE))
        size = (int(dual_kernels.N_MATRICES), self._blocks, self._blocks)
        self._matrices = [wp.zeros(size, dtype=wp.mat44d, **make) for _ in range(2)]
        few = self._blocks <= dual_kernels.ONE_PANEL
        self._panel_rows = self._blocks if few else dual_kernels.PANEL_ROWS
        panel = (size[0], self._panel_rows, self._blocks)
        self._panels = [wp.zeros(panel, dtype=wp.mat44d, **make) for _ in range(2)]
        self._logdets: DeviceArray = wp.zeros(size[0], dtype=wp.float64, **make)
        self._inverses = [wp.zeros((shapes, shapes), dtype=float, **make) for _ in range(3)]

    def solve(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, logs: DeviceArray
    ) -> None:
        """Form and invert the regularized duals for this iteration's parameters."""
        device, shapes = self.launch.device, self.shapes
        divisor = float(self.count * max(shapes - 1, 1))
        for rows, out in zip((centred, logs), self._covariances, strict=True):
            wp.launch_tiled(
                dual_kernels.gram,
                dim=(self._blocks, self._blocks),
                inputs=[shapes, self.count, divisor, rows, out],
                block_dim=dual_kernels.BLOCK_DIM,
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
        for begin in range(0, self._blocks, self._panel_rows):
            rows = min(self._panel_rows, self._blocks - begin)
            for pivot in range(begin, begin + rows):
                self._panels.reverse()
                wp.launch(
                    dual_kernels.reduce_panel,
                    dim=(source.shape[0], rows, self._blocks),
                    inputs=[begin, pivot, source, *self._panels, self._logdets],
                    device=device,
                )
            wp.launch(
                dual_kernels.eliminate,
                dim=source.shape,
                inputs=[begin, rows, source, self._panels[1], target],
                device=device,
            )
            source, target = target, source
        wp.launch(
            dual_kernels.extract_inverses,
            dim=(shapes, shapes),
            inputs=[stage, iteration, source, *self._inverses, self.stiffness],
            device=device,
        )

    def directions(
        self, centred: DeviceArray, logs: DeviceArray, ensemble: DeviceArray, normals: DeviceArray
    ) -> None:
        """Write the gradients of H(Z) by positions and of H(V) by Logs."""
        self._multiply(self._inverses[0], centred, ensemble)
        self._multiply(self._inverses[2], logs, normals)

    def _damp_free(self, steps: DeviceArray, damped: DeviceArray) -> None:
        self._multiply(self._inverses[1], steps, damped)

    def _step_matrices(self) -> tuple[DeviceArray, DeviceArray]:
        return self._inverses[0], self._inverses[1]

    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""
        logdets = self._logdets.numpy()
        return np.array([logdets[0], logdets[2]]) * 0.5 * (self.shapes - 1) / self.shapes

    def _multiply(self, matrix: DeviceArray, source: DeviceArray, target: DeviceArray) -> None:
        wp.launch(
            dual_kernels.multiply,
            dim=(self._blocks, self.count),
            inputs=[self.shapes, self.count, matrix, source, target],
            device=self.launch.device,
        )


def coupling(layout: kernels.Layout, free: DeviceArray, any_fixed: bool, launcher: Launcher) -> Coupling:
    """Return the coupling for the launcher's device; `any_fixed` says whether any particle is fixed."""
    kind = HostCoupling if launcher.device == "cpu" else DeviceCoupling
    return kind(layout, free, any_fixed, launcher)
