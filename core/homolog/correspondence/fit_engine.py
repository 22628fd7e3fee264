"""The particles of one shape against a frozen ensemble: H(Z) and H(V) with all other shapes fixed."""

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray, Float32Array, FloatArray
from homolog.correspondence.engine import Engine, Particles
from homolog.correspondence.ensemble import Ensemble, ShapeState
from homolog.correspondence.entropy.coherence import Coherence
from homolog.correspondence.entropy.coupling import HostCoupling
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.prepared_cohort import MEAN_AREA, PreparedCohort

__all__ = ["FitEngine", "state_of"]

_ISOLATED = 2.0
"""Log densities are bounded at this difference below their median."""


class EnsembleCoupling(HostCoupling):
    """H(Z) and H(V) of one shape, all others fixed.

    Attributes
    ----------
    normals : (n, 3) array
        Of the surface at the particles, as posed.
    """

    normals: Float32Array

    def of(self, ensemble: Ensemble, *, is_in_it: bool) -> "EnsembleCoupling":
        """Set the ensemble, and whether it contains the shape."""
        self._ensemble, self._is_in_it = ensemble, is_in_it
        return self

    def gradients(
        self,
        stage: DeviceArray,
        iteration: DeviceArray,
        vectors: tuple[DeviceArray, DeviceArray],
        out: tuple[DeviceArray, DeviceArray],
    ) -> None:
        """Write the gradients of both entropies."""
        parameters = stage.numpy()[int(iteration.numpy()[0])]
        a, b = (float(parameters[name]) for name in ("regularization", "normals_regularization"))
        self._regularization = a
        positions, normals = (np.asarray(self._rows(item)[0], np.float64) for item in vectors)
        rests = (
            self._ensemble.rest_of_positions(positions, a) / a,
            self._ensemble.rest_of_normals(normals, b) / b,
        )
        leverages = [
            0.0 if self._is_in_it else float(row @ rest) / self._ensemble.scale
            for row, rest in zip((positions, normals), rests, strict=True)
        ]
        self._step = float(parameters["step"] * parameters["ensemble_weight"]) / (1.0 + leverages[0])
        for rest, h, target in zip(rests, leverages, out, strict=True):
            self._rows(target)[0] = rest / (1.0 + h)
        self._entropies = 0.5 * self._ensemble.subjects[0] * np.log1p(leverages)
        self.stiffness.numpy()[0] = 1.0 / (b * (1.0 + leverages[1]))

    def damp(
        self, stage: DeviceArray, iteration: DeviceArray, steps: DeviceArray, damped: DeviceArray
    ) -> None:
        """Apply (I + p P (S + aI)^-1 P)^-1 across the particles, P being the projection to the surface.

        Without P, particles would be moved along modes off the surface, and the remaining tangential motion
        would be no mode. The matrix is of low rank plus the identity (Woodbury).
        """
        step = np.asarray(self._rows(steps)[0], np.float64)
        a, p, ensemble = self._regularization, self._step, self._ensemble
        modes = ensemble.position_modes.reshape(-1, *self.normals.shape)
        modes = modes - np.einsum("rni,ni->rn", modes, self.normals)[..., None] * self.normals
        modes = modes.reshape(len(modes), 3 * self.count)
        inverse_weights = (1.0 + a / ensemble.position_variances) * (a + p) / p
        inner = np.diag(inverse_weights) - modes @ modes.T
        explained = np.linalg.solve(inner, modes @ step) @ modes
        self._rows(damped)[0] = (step + explained) * a / (a + p)

    def entropies(self) -> FloatArray:
        """Return the shape's contribution to H(Z) and H(V), per particle, (2,)."""
        return np.asarray(self._entropies, np.float64)


class FitEngine(Engine):
    """The particles of one shape against an ensemble."""

    def __init__(
        self,
        ensemble: Ensemble,
        cohort: PreparedCohort,
        points: Particles | FloatArray,
        launcher: Launcher,
        poses: FloatArray,
        *,
        is_in_it: bool,
    ) -> None:
        self._ensemble, self._is_in_it = ensemble, is_in_it
        count = len(ensemble.mean)
        super().__init__(
            cohort.fields,
            cohort.opening_fields,
            cohort.surface_set(count),
            points,
            geodesic=cohort.geodesic,
            area=MEAN_AREA,
            launcher=launcher,
            poses=poses,
        )
        self.means = wp.array(ensemble.normals, dtype=wp.vec3, device=launcher.device)

    def _tie(self, *, any_fixed: bool) -> None:
        self._own_coupling = EnsembleCoupling(self.layout, self.free, True, self.launch).of(
            self._ensemble, is_in_it=self._is_in_it
        )
        self.coupling, self.stiffness = self._own_coupling, self._own_coupling.stiffness
        self.coherence = Coherence(self.layout, self.free, self.launch)

    def mean_shape(self) -> tuple[FloatArray, FloatArray]:
        """Return the ensemble's mean positions and normals."""
        return np.asarray(self._ensemble.mean, np.float64), np.asarray(self._ensemble.normals, np.float64)

    def energy(self, coherence: float = 0.0) -> FloatArray:
        """Return H(P), H(Z) and H(V), (3,).

        Densities are bounded, because that at a single isolated particle could outweigh a wrong pose.
        """
        densities = self.sampling.energies.numpy().astype(np.float64)
        sampling = float(np.maximum(densities, np.median(densities) - _ISOLATED).mean())
        return np.array([sampling, *self.coupling.entropies()]) + self._coherence_part(coherence)

    def compare(self) -> None:
        """Centre positions and normals on the ensemble's means."""
        aligned, normals = self.aligned_positions()[0], self.aligned_normals()[0]
        self._own_coupling.normals = normals.astype(np.float32)
        self.centred.numpy()[:] = aligned - self._ensemble.mean
        self.logs.numpy()[:] = self._ensemble.logs(normals, self.openings.numpy()[:, 3])


def state_of(engine: Engine, local: FloatArray, placement: FloatArray) -> ShapeState:
    """Return the state of an engine's only shape."""
    return ShapeState(
        local=local,
        aligned=engine.aligned_positions()[0].astype(np.float32),
        normals=engine.aligned_normals()[0].astype(np.float32),
        openings=engine.openings.numpy()[:, 3].astype(np.float32),
        placement=placement,
    )
