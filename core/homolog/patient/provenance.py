"""Source and quality of a reference."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from homolog.settings import GroomSettings

__all__ = ["Provenance", "Quality"]


@dataclass(frozen=True, slots=True)
class Provenance:
    """Source of a reference.

    Attributes
    ----------
    project : str
        Name of the project's folder.
    group : str
        Group of the controls; empty if all subjects are controls.
    controls : int
        Number of controls.
    made, finished : str
        Times at which the reference and its project's result were made.
    versions : mapping of str to str
        Versions of all packages that affect the reference.
    result : str
        Fingerprint of the project's result.
    particles : int
        Number of particles on each shape.
    groom : GroomSettings
        Settings of grooming, for controls and patients.
    side : str
        Side of the body, if all controls have the same: ``"left"``, ``"right"`` or empty.
    mixture : str
        Groups of the controls with their numbers, if they are several; else empty.
    """

    project: str
    group: str
    controls: int
    made: str
    finished: str
    versions: Mapping[str, str]
    result: str
    particles: int
    groom: GroomSettings
    side: str
    mixture: str = ""

    @property
    def record(self) -> dict[str, Any]:
        """Return the record for JSON."""
        return {
            **{name: getattr(self, name) for name in self.__dataclass_fields__ if name != "groom"},
            "versions": dict(self.versions),
            "groom": self.groom.model_dump(mode="json"),
        }

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "Provenance":
        """Return the object of a `record`."""
        return cls(**{**record, "groom": GroomSettings.model_validate(record["groom"])})


@dataclass(frozen=True, slots=True)
class Quality:
    """Quality of the fits of controls without the joint run.

    Attributes
    ----------
    near : float
        Share of particles within 0.3 spacings of their positions in the joint run.
    error_95 : float
        95th percentile of that distance [spacings].
    outside : float
        Mean over controls of the root mean square distance from the fitted model [mm].
    limit_mm : float
        Mean over the surface of the wide difference at which absolute z reaches the limit [mm].
    """

    near: float
    error_95: float
    outside: float
    limit_mm: float
