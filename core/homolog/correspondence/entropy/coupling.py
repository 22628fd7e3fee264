"""Coupling of the shapes in one iteration, on the host for the CPU and on the device for CUDA."""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, Float32Array, FloatArray
from homolog.correspondence.entropy.device_duals import make_duals
from homolog.correspondence.entropy.dual import solve_duals
from homolog.correspondence.kernels import particles as kernels
from homolog.correspondence.kernels import step as step_kernels
from homolog.correspondence.kernels.dual import N_MATRICES, NORMALS
from homolog.correspondence.launcher import Launcher, copy_between, push
from homolog.registration.entropy import covariance

__all__ = ["Coupling", "DeviceCoupling", "HostCoupling", "coupling"]


class Coupling(ABC):
    """The terms H(Z) and H(V): their gradients, and the implicit part of the step.

    Attributes
    ----------
    stiffness : (1,) array of float
        Largest diagonal entry of the matrix of H(V).
    kept_gradient : (M n,) array of vec3 or None
        The gradient of H(V) on another device, if it is not written where the caller wants it.
    """

    stiffness: DeviceArray
    kept_gradient: DeviceArray | None = None

    def __init__(
        self, layout: kernels.Layout, free: DeviceArray, any_fixed: bool, launcher: Launcher
    ) -> None:
        self.layout, self.free, self.any_fixed, self.launch = layout, free, any_fixed, launcher
        self.shapes, self.count = int(layout.shapes), int(layout.per_shape)
        self.stiffness = wp.zeros(1, dtype=float, device=launcher.device)

    @abstractmethod
    def join(self, others: FloatArray, share: float) -> None:
        """Let H(Z) be that of several structures together.

        Parameters
        ----------
        others : (M, M) array
            The covariances of the other structures, each times its share of all particles.
        share : float
            Share of this structure.
        """

    @abstractmethod
    def gradients(
        self,
        stage: DeviceArray,
        iteration: DeviceArray,
        vectors: tuple[DeviceArray, DeviceArray],
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Invert the regularized duals, and write the gradients of H(Z) by positions and of H(V) by Logs.

        Parameters
        ----------
        stage : array of StepParameters
            Of the stage's iterations.
        iteration : (1,) array
            The present one.
        vectors : pair of (M n,) arrays of vec3
            Aligned positions minus their mean over the shapes; logarithms of the normals at their mean, with
            the opening angles.
        out : pair of (M n,) arrays of vec3
            Where the two gradients are written.
        """

    def damp(
        self, stage: DeviceArray, iteration: DeviceArray, steps: DeviceArray, damped: DeviceArray
    ) -> None:
        """Apply the implicit part of the step.

        Parameters
        ----------
        stage, iteration : arrays
            As in `gradients`.
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
        """Apply it where no particle is fixed."""

    @abstractmethod
    def _step_matrices(self) -> tuple[DeviceArray, DeviceArray]:
        """Return W0 = (C + aI)^-1 and (I + pW0)^-1, (M, M) each."""

    @abstractmethod
    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""


class HostCoupling(Coupling):
    """numpy on the arrays of the CPU device, without a copy."""

    _others: FloatArray | None = None
    _share = 1.0

    def join(self, others: FloatArray, share: float) -> None:
        """Let H(Z) be that of several structures together."""
        self._others, self._share = others, share

    def gradients(
        self,
        stage: DeviceArray,
        iteration: DeviceArray,
        vectors: tuple[DeviceArray, DeviceArray],
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Invert the duals, and write the gradients of both entropies."""
        parameters = stage.numpy()[int(iteration.numpy()[0])]
        centred, logs = (self._rows(item) for item in vectors)
        ensemble = covariance(centred)
        if self._others is not None:
            ensemble = self._share * ensemble + self._others
        self._duals = solve_duals(
            ensemble,
            covariance(logs),
            float(parameters["regularization"]),
            float(parameters["normals_regularization"]),
            float(parameters["step"] * parameters["ensemble_weight"]),
        )
        self.stiffness.numpy()[0] = np.diag(self._duals.normals).max()
        np.matmul(self._duals.gradient, centred, out=self._rows(out[0]))
        np.matmul(self._duals.normals, logs, out=self._rows(out[1]))

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
        self._duals = make_duals(0, N_MATRICES, self.shapes, self.count, launcher.device)
        self.stiffness = self._duals.stiffness

    def join(self, others: FloatArray, share: float) -> None:
        """Let H(Z) be that of several structures together."""
        self._duals.join(others, share)

    def gradients(
        self,
        stage: DeviceArray,
        iteration: DeviceArray,
        vectors: tuple[DeviceArray, DeviceArray],
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Invert the duals, and write the gradients of both entropies."""
        self._duals.solve(stage, iteration, *vectors)
        self._duals.multiply(self._duals.inverses[0], vectors[0], out[0])
        self._duals.multiply(self._duals.inverses[int(NORMALS)], vectors[1], out[1])

    def _damp_free(self, steps: DeviceArray, damped: DeviceArray) -> None:
        self._duals.multiply(self._duals.inverses[1], steps, damped)

    def _step_matrices(self) -> tuple[DeviceArray, DeviceArray]:
        return self._duals.inverses[0], self._duals.inverses[1]

    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""
        logdets = self._duals.logdets.numpy()[[0, int(NORMALS)]]
        return _per_particle(logdets, self.shapes)


class DividedCoupling(DeviceCoupling):
    """H(Z) on the launcher's device and H(V) on a second one, each as a CUDA graph of its own."""

    def __init__(
        self, layout: kernels.Layout, free: DeviceArray, any_fixed: bool, launcher: Launcher, second: str
    ) -> None:
        Coupling.__init__(self, layout, free, any_fixed, launcher)
        normals = int(NORMALS)
        self._duals = make_duals(0, normals, self.shapes, self.count, launcher.device)
        self._second = make_duals(normals, 1, self.shapes, self.count, second)
        vectors = [wp.zeros(self.shapes * self.count, dtype=wp.vec3, device=second) for _ in range(4)]
        self._logs: DeviceArray = vectors[0]
        self.kept_gradient: DeviceArray = vectors[1]
        self._steps, self._damped = vectors[2:]
        self._damping: DeviceArray = wp.zeros_like(self._second.inverses)
        self._iteration: DeviceArray = wp.zeros(1, dtype=int, device=second)
        self._stage: DeviceArray | None = None  # of the graphs
        self._graphs: list[Any] = []

    def gradients(
        self,
        stage: DeviceArray,
        iteration: DeviceArray,
        vectors: tuple[DeviceArray, DeviceArray],
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Invert the duals, and compute the gradients of both entropies, at the same time."""
        centred, logs = vectors
        if stage is not self._stage:
            self._capture(stage, iteration, centred, out[0])
        # The first device has waited for the second one's last gradient, so that these are not in use.
        push(self._iteration, iteration)
        push(self._logs, logs)
        for graph in self._graphs:
            wp.capture_launch(graph)
        push(self._damping, self._duals.inverses[1:])
        copy_between(self.stiffness, self._second.stiffness)

    def _damp_free(self, steps: DeviceArray, damped: DeviceArray) -> None:
        """Apply it to one half of the shapes on each device."""
        half = self.shapes // 2
        push(self._steps, steps)
        self._second.multiply(self._damping[0, half:], self._steps, self._damped)
        self._duals.multiply(self._duals.inverses[1, :half], steps, damped)
        count = (self.shapes - half) * self.count
        copy_between(damped, self._damped, half * self.count, 0, count)

    def _capture(
        self, stage: DeviceArray, iteration: DeviceArray, centred: DeviceArray, ensemble: DeviceArray
    ) -> None:
        parameters = wp.clone(stage, device=self._second.device)
        with wp.ScopedCapture(device=self._second.device) as second:
            self._second.solve(parameters, self._iteration, logs=self._logs)
            self._second.multiply(self._second.inverses[0], self._logs, self.kept_gradient)
        with wp.ScopedCapture(device=self.launch.device) as first:
            self._duals.solve(stage, iteration, centred=centred)
            self._duals.multiply(self._duals.inverses[0], centred, ensemble)
        self._stage, self._parameters, self._graphs = stage, parameters, [second.graph, first.graph]

    def entropies(self) -> FloatArray:
        """Return H(Z) and H(V) per particle and shape, (2,)."""
        logdets = np.array([self._duals.logdets.numpy()[0], self._second.logdets.numpy()[0]])
        return _per_particle(logdets, self.shapes)


def _per_particle(logdets: FloatArray, shapes: int) -> FloatArray:
    return logdets * 0.5 * (shapes - 1) / shapes


def coupling(
    layout: kernels.Layout, free: DeviceArray, any_fixed: bool, launcher: Launcher, second: str | None = None
) -> Coupling:
    """Return the coupling of all particles.

    Parameters
    ----------
    layout : Layout
    free : (M n,) array of int
        Whether each particle may move.
    any_fixed : bool
        Whether any may not.
    launcher : Launcher
        Of the device.
    second : str, optional
        Another CUDA device, that computes H(V).
    """
    if launcher.device == "cpu":
        return HostCoupling(layout, free, any_fixed, launcher)
    if second is not None and second != "cpu":
        return DividedCoupling(layout, free, any_fixed, launcher, second)
    return DeviceCoupling(layout, free, any_fixed, launcher)
