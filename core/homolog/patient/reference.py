"""A frozen model of controls in one file, with the results of controls that are fitted as patients."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
from scipy import stats

from homolog import __version__
from homolog.arrays import FloatArray, frozen
from homolog.errors import InputError, path_of
from homolog.io.arrays import read_arrays, write_arrays
from homolog.patient.change import ExpectedChange
from homolog.patient.coding import Coding
from homolog.patient.local import BANDS, BEST_GAINS, KINDS, LEVEL, BandNorm, LocalNorm, gains
from homolog.patient.placed import Placing
from homolog.patient.provenance import Provenance, Quality
from homolog.patient.surface_model import SurfaceModel
from homolog.surfaces.mesh import TriangleMesh

__all__ = ["FORMAT_VERSION", "SEVERAL", "Reference", "arrays_of", "check_name"]

SUFFIX = ".npz"
FORMAT_VERSION = 3
SEVERAL = "homolog-reference-structures"
"""Format of a reference of several structures."""

_UNLIKE = 2.5
"""Ratio of a left-out control's distance from its fit to the median; above it, the control is an outlier."""

_TIMES_AS_LIKELY = 100.0
_RECOGNISED = 0.8
"""Smallest share of mirrored controls that must be recognised for a check of the side."""

_MODEL = ("mean", "components", "variances", "effects", "residual", "faces")
_NORMS = ("local", "usual", "total")
_DISTRIBUTIONS = ("mahalanobis", "outside", "size", "gap", "maxima")


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Reference for the comparison of patients, without any control's surface or file.

    Made by `make_reference` or `Reference.load`. Distributions are sorted separately, so that they do not
    reveal single controls. Scores and names are included only on request.

    Attributes
    ----------
    model : SurfaceModel
        Shape model of all controls.
    modes : int
        Number of retained modes (parallel analysis); others are fitted, but not part of the distance.
    coding : Coding
        Coding of the covariates.
    mahalanobis, outside, size, gap : (M,) arrays
        Sorted `Measures` of controls fitted as patients, read-only.
    maxima : (M,) array
        Sorted largest absolute z of these controls, read-only.
    limit : float
        Limit of absolute z, which 5 % of healthy people exceed anywhere.
    local, usual : BandNorm, LocalNorm
        Norms of these controls' maps in bands of several widths (2, B, V), and unfiltered (2, V): difference
        from the expected shape [mm], and logarithm of the wall's thickness relative to its median.
    total : LocalNorm
        Norm of their differences from the mean (V,).
    quality : Quality
    provenance : Provenance
    scores : (M, modes) array or None
        Scores of each control in the retained modes [mm], read-only.
    names : tuple of str
        Names of the controls in the order of their scores; empty if not stored.
    unlike : tuple of str
        Names of the controls in `unlike_distances`, in this order; a file contains them only if it contains
        `names`.
    placing : Placing or None
        Places a patient's particles; None if the project has no groomed volumes.
    change : ExpectedChange or None
        Expected change from controls with two times; None if unknown.
    mirrored : (M,) array or None
        Sorted ratios of the fit's distance for the controls' mirror images to that for the controls
        themselves, read-only; None in files of older versions.
    borders : (k, 3) array or None
        Unit vectors out of the images where controls touch their borders, read-only; None in files of older
        versions.
    """

    model: SurfaceModel
    modes: int
    coding: Coding
    mahalanobis: FloatArray
    outside: FloatArray
    size: FloatArray
    gap: FloatArray
    maxima: FloatArray
    limit: float
    local: BandNorm
    usual: LocalNorm
    total: LocalNorm
    quality: Quality
    provenance: Provenance
    scores: FloatArray | None = None
    names: tuple[str, ...] = ()
    unlike: tuple[str, ...] = ()
    placing: Placing | None = None
    change: ExpectedChange | None = None
    mirrored: FloatArray | None = None
    borders: FloatArray | None = None

    def __repr__(self) -> str:
        """Return a one-line summary."""
        return f"Reference({len(self.mahalanobis)} controls, {self.modes} modes)"

    def __post_init__(self) -> None:
        """Sort and freeze the distributions."""
        for name in ("scores", "borders"):
            if (array := getattr(self, name)) is not None:
                object.__setattr__(self, name, frozen(array, np.float64))
        for name in (*_DISTRIBUTIONS, *([] if self.mirrored is None else ["mirrored"])):
            object.__setattr__(self, name, frozen(np.sort(getattr(self, name)), np.float64))

    @property
    def first(self) -> "Reference":
        """The reference itself; of several structures, that of the first."""
        return self

    @property
    def surface(self) -> TriangleMesh:
        """The mean surface at the mean of the covariates."""
        return self.model.surface(self.model.mean)

    @property
    def detectable(self) -> FloatArray:
        """Smallest differences at each vertex that exceed the limit, if they are as wide as a band (2, V).

        Position [mm], and logarithm of the wall's thickness.
        """
        smallest: FloatArray = self.limit * (self.local.deviation / BEST_GAINS[:, None]).min(axis=1)
        return smallest

    def visible(self, height: float, width: float, kind: int = 0) -> FloatArray:
        """Return where a Gaussian bump would exceed the limit, on a surface as rough as the controls' (V,).

        Parameters
        ----------
        height : float
            Height [mm], or logarithm of the ratio of thicknesses.
        width : float
            Full width at half maximum [mm].
        kind : int
            0 for position, 1 for thickness.
        """
        shares = gains(width, self.surface.mean_edge)[:, None]
        seen: FloatArray = (abs(height) * shares > self.limit * self.local.deviation[kind]).any(axis=0)
        return seen

    @property
    def unlike_distances(self) -> FloatArray:
        """Distances from the fit [mm] of controls that are unlike the others, the largest first."""
        return self.outside[self.outside > _UNLIKE * float(np.median(self.outside))][::-1]

    @property
    def side_limit(self) -> float | None:
        """Largest ratio of the mirror image's fit to that of a shape of the other side.

        It is below all controls and below the 0.5 % quantile of their log-normal distribution, and at least
        100 times as likely for a mirrored control. None if too few mirrored controls would be detected.
        """
        if self.mirrored is None:
            return None
        logs, count = np.log(self.mirrored), len(self.mirrored)
        spread = logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / count)
        mean = max(float(logs.mean()), 1e-9)
        limit = min(
            logs.mean() - float(stats.t.ppf(0.995, count - 1)) * spread,
            float(logs.min()),
            -0.5 * np.log(_TIMES_AS_LIKELY) * spread**2 / mean,  # normal, about ± the mean
        )
        recognised = float(np.mean(-logs < limit))  # share of controls that would be detected if mirrored
        return float(np.exp(limit)) if recognised >= _RECOGNISED else None

    def ends_at(self, way: FloatArray) -> bool:
        """Whether images of controls end with the structure in a direction (3,) of the reference's frame.

        True if more than 5 % of the controls touch the border of their image there, as in stacks of slices.
        A border is on the side of a direction if no perpendicular border is nearer to it.
        """
        if self.borders is None:
            return False
        return int(np.sum(self.borders @ way > np.sqrt(0.5))) > LEVEL * len(self.gap)

    @property
    def fingerprint(self) -> str:
        """A hash of all data that affect patients' results."""
        digest = hashlib.blake2b(digest_size=8)
        for name, array in sorted(self._arrays().items()):
            digest.update(f"{name}{array.shape}{array.dtype}".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def nearest(self, scores: FloatArray, count: int = 3) -> list[tuple[str, float]]:
        """Return the controls that are most similar to a shape, the nearest first.

        Parameters
        ----------
        scores : (K,) array
            Scores of the shape [mm], such as ``comparison.fit.scores``; only retained modes are used.
        count : int
            Largest number of controls.

        Returns
        -------
        list of (str, float)
            Names (empty if the reference does not store them) and Mahalanobis distances [SD]. The list is
            empty if the reference stores no scores.
        """
        if self.scores is None:
            return []
        apart = (self.scores - scores[: self.modes]) / np.sqrt(self.model.variances[: self.modes])
        distances = np.linalg.norm(apart, axis=1)
        order = np.argsort(distances, kind="stable")[:count].tolist()
        return [(self.names[index] if self.names else "", float(distances[index])) for index in order]

    def anonymous(self) -> "Reference":
        """Return the reference without the controls' scores and names."""
        return replace(self, scores=None, names=(), unlike=())

    def save(self, path: str | PathLike[str]) -> None:
        """Write the reference to one file, atomically.

        Parameters
        ----------
        path : path
            File that ends in ``.npz``.

        Raises
        ------
        InputError
            If the name has another suffix, or the file can't be written.
        """
        check_name(path)
        write_arrays(path_of(path), self.stored)

    @property
    def stored(self) -> dict[str, Any]:
        """All arrays of its file, by name, with a record in JSON."""
        record = {
            "format": "homolog-reference",
            "version": FORMAT_VERSION,
            "modes": self.modes,
            "limit": self.limit,
            "coding": self.coding.record,
            "quality": {name: getattr(self.quality, name) for name in Quality.__dataclass_fields__},
            "provenance": self.provenance.record,
            "names": list(self.names),
            "unlike": list(self.unlike if self.names else ()),
            "placing": None if self.placing is None else self.placing.settings.model_dump(mode="json"),
            "change_between": None if self.change is None else self.change.between,
        }
        optional = {name: getattr(self, name) for name in ("scores", "mirrored", "borders")}
        kept = {name: array for name, array in optional.items() if array is not None}
        return {**self._arrays(), **kept, "record": np.array(json.dumps(record))}

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Reference":
        """Read a reference that `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged, not a reference, of a newer version, or of an older one that
            lacks required data.
        """
        return cls.of_stored(arrays_of(path), path)

    @classmethod
    def of_stored(cls, stored: Mapping[str, Any], path: str | PathLike[str]) -> "Reference":
        """Return the reference whose arrays were `stored` in a file; raises InputError as `load`."""
        record: dict[str, Any] = {}
        try:
            record = json.loads(str(stored["record"]))
            if record["format"] == SEVERAL:
                raise InputError(f"{path}: is of several structures; a reference of a single one is needed")
            if record["format"] != "homolog-reference":
                raise InputError(f"{path}: is not a reference; give a file that homolog reference wrote")
            if record["version"] > FORMAT_VERSION:
                raise InputError(f"{path}: was written by a newer Homolog; update Homolog to open it")
            if record["version"] < FORMAT_VERSION:
                raise InputError(
                    f"{path}: was made by an older Homolog, whose limits of local differences are others; "
                    "make it again from its project (homolog reference)"
                )
            reference = cls(
                model=SurfaceModel(**{name: stored[f"model_{name}"] for name in _MODEL}),
                modes=int(record["modes"]),
                coding=Coding.from_record(record["coding"]),
                **{name: stored[name] for name in _DISTRIBUTIONS},
                limit=float(record["limit"]),
                local=BandNorm(*(stored[f"local_{name}"] for name in BandNorm.__dataclass_fields__)),
                usual=LocalNorm(stored["usual_mean"], stored["usual_deviation"]),
                total=LocalNorm(stored["total_mean"], stored["total_deviation"]),
                quality=Quality(**record["quality"]),
                provenance=Provenance.from_record(record["provenance"]),
                scores=stored.get("scores"),
                mirrored=stored.get("mirrored"),
                borders=stored.get("borders"),
                names=tuple(map(str, record.get("names", ()))),
                unlike=tuple(map(str, record.get("unlike", ()))),
                placing=Placing.from_arrays(stored, placing) if (placing := record.get("placing")) else None,
                change=None
                if (between := record.get("change_between")) is None
                else ExpectedChange.from_arrays(stored, str(between)),
            )
        except InputError:
            raise
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: {_unreadable(record, str(error))}") from error
        if not reference._fits():
            raise InputError(f"{path}: {_unreadable(record, 'its arrays are inconsistent')}")
        return reference

    def _arrays(self) -> dict[str, Any]:
        return {
            **{f"model_{name}": getattr(self.model, name) for name in _MODEL},
            **{name: getattr(self, name) for name in _DISTRIBUTIONS},
            **{f"{name}_mean": getattr(self, name).mean for name in _NORMS},
            **{f"{name}_deviation": getattr(self, name).deviation for name in _NORMS},
            "local_roughness": self.local.roughness,
            **(self.placing.arrays if self.placing else {}),
            **(self.change.arrays if self.change else {}),
        }

    @property
    def made_by(self) -> str:
        """Version of Homolog that made the reference."""
        return str(self.provenance.versions.get("homolog", ""))

    def _fits(self) -> bool:
        """Whether the arrays are consistent."""
        model, vertices = self.model, self.model.vertices
        modes, columns = len(model.variances), len(self.coding.means)
        points = model.mean.shape
        return bool(
            len(points) == 2
            and points[1:] == (3,)
            and model.components.shape == (modes, *points)
            and model.effects.shape == (columns, *points)
            and self.modes <= modes
            and vertices + self.provenance.particles == points[0]
            and 0 <= model.faces.min() <= model.faces.max() < vertices
            and self.local.mean.shape == self.local.deviation.shape == (KINDS, len(BANDS), vertices)
            and self.local.roughness.shape == (KINDS, len(BANDS), 1)
            and self.usual.mean.shape == self.usual.deviation.shape == (KINDS, vertices)
            and self.total.mean.shape == self.total.deviation.shape == (vertices,)
            and all(getattr(self, name).shape == (self.provenance.controls,) for name in _DISTRIBUTIONS)
            and all(np.isfinite(item).all() for item in self._arrays().values())
            and (self.placing is None or self.placing.is_of(self.provenance.particles))
            and (self.change is None or self.change.is_of(vertices))
            and (self.borders is None or self.borders.shape[1:] == (3,))
            and (self.mirrored is None or _are_ratios(self.mirrored, self.provenance.controls))
            and len(self.names) in (0, self.provenance.controls)
            and len(self.unlike) in (0, len(self.unlike_distances))
            and (
                (self.scores is None and not self.names)
                or (
                    self.scores is not None
                    and self.scores.shape == (self.provenance.controls, self.modes)
                    and bool(np.isfinite(self.scores).all())
                )
            )
        )


def _unreadable(record: Mapping[str, Any], fault: str) -> str:
    """Describe why a file can't be read: it is damaged, or of another version of Homolog."""
    try:
        made_by = str(record["provenance"]["versions"]["homolog"])
    except (KeyError, TypeError):
        made_by = __version__
    if made_by == __version__:
        return f"is damaged: {fault}; make the reference again"
    return (
        f"was made by Homolog {made_by} and lacks what {__version__} needs ({fault}); make it again from its "
        f"project (homolog reference), or use Homolog {made_by}"
    )


def _are_ratios(values: FloatArray, count: int) -> bool:
    return values.shape == (count,) and bool(np.isfinite(values).all()) and float(values.min()) > 0.0


def check_name(path: str | PathLike[str]) -> None:
    """Raise InputError if a file's name is not that of a reference."""
    if path_of(path).suffix != SUFFIX:
        raise InputError(f"{path}: a reference is written as {SUFFIX}; choose such a name")


def arrays_of(path: str | PathLike[str]) -> dict[str, Any]:
    """Return all arrays of a reference's file; raises InputError if it is not one."""
    if path_of(path).is_dir():
        raise InputError(f"{path}: is a folder; give a file that homolog reference wrote")
    stored = read_arrays(path_of(path), "copy it again, or make it again (homolog reference)")
    if "record" not in stored:
        raise InputError(f"{path}: is not a reference; give a file that homolog reference wrote")
    return stored
