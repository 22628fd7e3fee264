"""Placement of a patient's particles by the objective of the controls' run, with all controls fixed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from homolog.arrays import Array, FloatArray
from homolog.correspondence import Shape
from homolog.correspondence.ensemble import Ensemble
from homolog.correspondence.launcher import load_kernels
from homolog.correspondence.shape_fit import fit_shape_from
from homolog.geometry import fit_similarity, inverse_matrices, transform_points
from homolog.patient.fit import SurfaceFit
from homolog.progress import Tick, no_tick
from homolog.run.core_set import first_placement
from homolog.settings import OptimizeSettings

__all__ = ["Placing"]

_PREFIX = "ensemble_"


@dataclass(frozen=True, slots=True, eq=False)
class Placing:
    """Ensemble and settings that place a patient's particles.

    Attributes
    ----------
    ensemble : Ensemble
        Ensemble of the controls, without templates.
    settings : OptimizeSettings
        Settings of their run.
    """

    ensemble: Ensemble
    settings: OptimizeSettings

    def placed(self, shape: Shape, fit: SurfaceFit, turn: FloatArray, tick: Tick = no_tick) -> FloatArray:
        """Return the particles of a shape.

        The surface of a nearly axisymmetric shape hardly determines its pose. Particles are therefore placed
        from two starts: those of the surface's fit, and those of the rigidly registered mean. The result with
        the lower objective is kept.

        Parameters
        ----------
        shape : Shape
            The shape in its file's frame; its alignment is ignored.
        fit : SurfaceFit
            Fit of the shape after `turn`.
        turn : (4, 4) array
            Reflection to the side of the controls, or the identity.
        tick : Tick

        Returns
        -------
        (n, 3) array
            Particles in the frame of the fit's particles [mm].

        Raises
        ------
        NumericalError
            If a particle is lost.
        """
        load_kernels("cpu")
        mean = float(self.ensemble.unit[0]) * self.ensemble.mean
        aligned = replace(shape, alignment=fit_similarity(fit.particles, mean, scaling=False) @ turn)
        aligned = replace(aligned, alignment=first_placement(aligned, self.ensemble, self.settings))
        starts = [
            transform_points(inverse_matrices(turn), start) for start in (fit.particles, fit.registered)
        ]
        state = fit_shape_from(aligned, self.settings, self.ensemble, starts, tick=tick)
        return transform_points(turn, state.local)

    @property
    def arrays(self) -> dict[str, Array]:
        """The ensemble as arrays for a file."""
        return {f"{_PREFIX}{name}": array for name, array in self.ensemble.arrays.items()}

    @classmethod
    def from_arrays(cls, stored: Mapping[str, Array], settings: Mapping[str, Any]) -> "Placing":
        """Return the object from its `arrays` and the settings."""
        names = Ensemble.__dataclass_fields__
        ensemble = Ensemble(**{name: stored[f"{_PREFIX}{name}"] for name in names})
        return cls(ensemble, OptimizeSettings.model_validate(settings))

    def is_of(self, particles: int) -> bool:
        """Whether the arrays are consistent, also with the number of particles."""
        item = self.ensemble
        rows = 3 * particles
        return (
            all(array.shape == (1,) for array in (item.unit, item.area, item.opening_scale, item.subjects))
            and all(array.shape == (particles, 3) for array in (item.mean, item.normals))
            and all(array.shape == (particles,) for array in (item.openings, item.angles))
            and item.position_modes.shape == (len(item.position_variances), rows)
            and item.normal_modes.shape == (len(item.normal_variances), rows)
            and all(bool(np.isfinite(array).all()) for array in item.arrays.values())
        )
