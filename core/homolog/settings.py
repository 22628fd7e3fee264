"""All parameters of a run, with units, bounds, defaults and help for files, command line and forms.

Quantities that depend on the size of the shapes are relative: regularization and weights have no unit and are
valid for a mouse femur and a pelvis alike (see docs/method.md).
"""

import re
from enum import StrEnum
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic_core import PydanticCustomError

from homolog.errors import InputError

__all__ = [
    "OWN",
    "Alignment",
    "GroomSettings",
    "Method",
    "Mirror",
    "Openings",
    "OptimizeSettings",
    "OwnGrooming",
    "Pieces",
    "Procrustes",
    "RunSettings",
    "Turn",
    "Values",
    "wall_of",
]


OWN = "grooming"
"""Column of the cohort's table, case-insensitive: see `OwnGrooming`."""
FEWEST, MOST = 4, 65536
"""Particles of a structure."""


class Method(StrEnum):
    """Terms of the objective."""

    GEODESIC_NORMALS = "geodesic-normals"
    GEODESIC = "geodesic"
    NORMALS = "normals"
    EUCLIDEAN = "euclidean"

    @property
    def uses_geodesics(self) -> bool:
        """Whether particles on one shape repel by geodesic distance."""
        return self in (Method.GEODESIC_NORMALS, Method.GEODESIC)

    @property
    def uses_normals(self) -> bool:
        """Whether the entropy of surface normals H(V) is part of the objective."""
        return self in (Method.GEODESIC_NORMALS, Method.NORMALS)


class Alignment(StrEnum):
    """Alignment of the groomed shapes."""

    NONE = "none"
    CENTER = "center"
    AXES = "axes"
    ICP = "icp"


class Mirror(StrEnum):
    """Side of the body that is mirrored, so that left and right shapes can be compared."""

    AUTO = "auto"
    LEFT = "left"
    RIGHT = "right"
    OFF = "off"


class Pieces(StrEnum):
    """Separate pieces of a structure that are kept."""

    LARGEST = "largest"
    ALL = "all"


class Openings(StrEnum):
    """Openings of meshes that are closed."""

    AUTO = "auto"
    OPEN = "open"
    CLOSE = "close"


class Values(StrEnum):
    """What the voxels of the files are."""

    LABELS = "labels"
    DISTANCE = "distance"
    PROBABILITY = "probability"


class Turn(StrEnum):
    """Principal axis of a shape about which it is turned by 180°."""

    LONG = "long"
    MIDDLE = "middle"
    SHORT = "short"


class Procrustes(StrEnum):
    """Alignment of shapes by their particles during the optimization and in results."""

    AUTO = "auto"
    OFF = "off"
    RIGID = "rigid"
    FORM = "form"
    SHAPE = "shape"

    @classmethod
    def _missing_(cls, value: object) -> "Procrustes | None":
        """Read what projects of earlier versions say."""
        return cls.SHAPE if value == "similarity" else None

    @property
    def takes_size_out(self) -> bool:
        """Whether shapes are compared at one size."""
        return self in (Procrustes.FORM, Procrustes.SHAPE)


def _form(pattern: str, expected: str) -> AfterValidator:
    """Return a validator of a text's format."""

    def check(value: str | None) -> str | None:
        if value is not None and not re.fullmatch(pattern, value):
            raise PydanticCustomError("form", "{expected}", {"expected": expected})
        return value

    return AfterValidator(check)


def _shown(unit: str = "", if_none: str = "automatic") -> dict[str, Any]:
    """Return a setting's unit, and the text for None."""
    return {"unit": unit, "if_none": if_none}


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _structures(value: str | None) -> str | None:
    """Refuse a text that does not name two or more structures."""
    if value is not None:
        names = [name.casefold() for name, _ in _named_sources(value)]
        if len(names) < 2 or not all(names) or len(set(names)) < len(names):
            expected = "must name two or more structures once, such as femur,tibia or wall=2+3,cavity=1"
            raise PydanticCustomError("form", "{expected}", {"expected": expected})
    return value


def _pairs(value: str, sign: str) -> dict[str, str]:
    """Return what a text such as ``femur=512,patella=128`` says, by what comes before the sign."""
    pairs = (item.partition(sign) for item in value.split(",") if item.strip())
    return {name.strip(): text.strip() for name, _, text in pairs}


def _counts(value: str | None) -> str | None:
    """Refuse a text that does not give structures their numbers of particles."""
    given = _pairs(value or "", "=").values()
    if not all(count.isdecimal() and FEWEST <= int(count) <= MOST for count in given):
        expected = f"must give structures {FEWEST} to {MOST} particles, such as femur=512,patella=128"
        raise PydanticCustomError("form", "{expected}", {"expected": expected})
    return value


def _grooming(value: str | None) -> str | None:
    """Refuse a text that does not give structures settings of grooming."""
    try:
        _own_grooming(value)
    except (ValidationError, InputError) as error:
        expected = (
            f"must give structures settings of grooming ({', '.join(_OF_STRUCTURES)}), such as "
            "patella:smoothing=0.5,cartilage:openings=open"
        )
        raise PydanticCustomError("form", "{expected}", {"expected": expected}) from error
    return value


def _own_grooming(value: str | None) -> "dict[str, OwnGrooming]":
    """Return the settings of structures, by name: ``patella:smoothing=0.5,patella:pieces=all``."""
    fields: dict[str, dict[str, str]] = {}
    for item in filter(None, map(str.strip, (value or "").split(","))):
        name, _, setting = item.partition(":")
        key, _, chosen = setting.partition("=")
        if key.strip() not in _OF_STRUCTURES:
            raise InputError(f"{item}: is not a setting of a structure")
        fields.setdefault(name.strip(), {})[key.strip()] = chosen.strip()
    own = {name: OwnGrooming.model_validate(texts) for name, texts in fields.items()}
    for given in own.values():
        given.applied(GroomSettings())
    return own


def _named_sources(text: str) -> list[tuple[str, str]]:
    """Return names of structures and where they come from: ``femur,wall=2+3``."""
    pairs = (item.partition("=") for item in text.split(","))
    return [(name.strip(), (source or name).strip()) for name, _, source in pairs]


def _of_named(source: str, sources: dict[str, str]) -> str:
    """Return the source of what another structure encloses, ``inside(wall)``, with that of the other."""
    wall = wall_of(source)
    return source if wall is None else f"inside({sources.get(wall, wall)})"


def wall_of(segment: str | None) -> str | None:
    """Return what encloses a cavity, ``wall`` of ``inside(wall)``; None if it is none."""
    match = re.fullmatch(r"inside\(([^()]+)\)", segment or "")
    return match and match[1].strip()


class GroomSettings(_Settings):
    """Grooming."""

    label: Annotated[
        int | None,
        Field(
            ge=1,
            le=2**31 - 1,
            json_schema_extra=_shown(if_none="all above 0"),
            description="Label value of the structure; all values above 0 if not given.",
        ),
    ] = None
    segment: Annotated[
        str | None,
        Field(
            min_length=1,
            max_length=200,
            json_schema_extra=_shown(if_none="none"),
            description="Name of the structure in the files (.seg.nrrd, DICOM SEG), in a table next to them "
            "or in FreeSurfer's list; case, dashes and the order of words do not matter.",
        ),
    ] = None
    structures: Annotated[
        str | None,
        Field(
            max_length=2000,
            json_schema_extra=_shown(if_none="one"),
            description="Structures that are modelled together, separated by commas: names of files or "
            "labels, or numbers of labels. NAME=2+3 joins labels under a name; cavity=inside(wall) is what "
            "a wall encloses.",
        ),
        AfterValidator(_structures),
    ] = None
    structure_grooming: Annotated[
        str | None,
        Field(
            max_length=2000,
            json_schema_extra=_shown(if_none="none"),
            description="Settings of grooming that differ for a structure, such as "
            "patella:smoothing=0.5,cartilage:openings=open.",
        ),
        AfterValidator(_grooming),
    ] = None
    values: Annotated[
        Values | None,
        Field(
            json_schema_extra=_shown(if_none="labels"),
            description="What the voxels are: labels, signed distances from the surface, or probabilities "
            "(also a mask with soft edges), of which half of the full value is the surface.",
        ),
    ] = None
    pieces: Annotated[
        Pieces,
        Field(description="Separate pieces: keep the largest, or all, joined by the shortest bridges."),
    ] = Pieces.LARGEST
    openings: Annotated[
        Openings,
        Field(
            description="Open meshes: close only openings smaller than a particle's part of the surface "
            "(auto), none (open) or all (close). Particles do not leave an open mesh across its rim."
        ),
    ] = Openings.AUTO
    spacing: Annotated[
        float | None,
        Field(
            gt=0.0,
            le=100.0,
            json_schema_extra=_shown("mm"),
            description="Node spacing of the isotropic grid; from the finest input axis if not given.",
        ),
    ] = None
    smoothing: Annotated[
        float,
        Field(
            ge=0.0,
            le=5.0,
            json_schema_extra=_shown("voxels"),
            description="Standard deviation of the Gaussian that removes voxel steps.",
        ),
    ] = 1.0
    tunnels: Annotated[
        float,
        Field(
            ge=0.0,
            le=10.0,
            json_schema_extra=_shown("voxels"),
            description="Fill tunnels narrower than this: most come from noise in the labels. 0 keeps all.",
        ),
    ] = 3.0
    alignment: Annotated[
        Alignment,
        Field(description="Rigid alignment: none, centre of mass, principal axes, or closest points (ICP)."),
    ] = Alignment.ICP
    mirror: Annotated[
        Mirror,
        Field(
            description="Which body side is mirrored onto the other: left, right or off. Auto mirrors the "
            "rarer side (left if equal) if a column side or all file names give the sides."
        ),
    ] = Mirror.AUTO
    scaling: Annotated[
        bool,
        Field(
            description="Also scale the shapes to one size. The factors are stored; files keep their size."
        ),
    ] = False
    mesh_edge: Annotated[
        float | None,
        Field(
            gt=0.0,
            le=100.0,
            json_schema_extra=_shown("mm"),
            description="Edge length of the surface meshes; about 6000 vertices per shape if not given.",
        ),
    ] = None
    adaptive_mesh: Annotated[
        bool, Field(description="Use smaller triangles where the surface is strongly curved.")
    ] = False

    @property
    def source(self) -> tuple[int | None, str | None, str | None, Values | None]:
        """What of a file is read: a label, a name, several structures; and what its voxels are."""
        return self.label, self.segment, self.structures, self.values

    @property
    def structure(self) -> str:
        """The structure in the files: its name, or its label; empty if neither is given."""
        return self.segment or ("" if self.label is None else str(self.label))

    @property
    def of_structures(self) -> dict[str, "GroomSettings"]:
        """The settings of each of several structures alone, by its name; empty for one structure."""
        own, sources = _own_grooming(self.structure_grooming), dict(_named_sources(self.structures or ""))
        return {
            name: own.get(name, OwnGrooming()).applied(
                self.model_copy(
                    update={
                        "structures": None,
                        "structure_grooming": None,
                        "label": int(source) if source.isdecimal() else None,
                        "segment": None if source.isdecimal() else _of_named(source, sources),
                    }
                )
            )
            for name, source in sources.items()
            if name
        }


class OwnGrooming(_Settings):
    """What differs for one subject: ``pieces=all; tunnels=10; turned=long; mirrored=yes``.

    It is read from the column ``grooming`` of the cohort's table.

    Attributes
    ----------
    label, segment, values, pieces, openings, spacing, smoothing, tunnels
        As in `GroomSettings`; those that are None are those of the cohort.
    turned : Turn or None
        The shape lies the other way round: it is turned about this axis.
    mirrored : bool
        The shape is its mirror image.
    """

    label: int | None = None
    segment: str | None = None
    values: Values | None = None
    pieces: Pieces | None = None
    openings: Openings | None = None
    spacing: float | None = None
    smoothing: float | None = None
    tunnels: float | None = None
    turned: Turn | None = None
    mirrored: bool = False

    @classmethod
    def read(cls, text: str, subject: str) -> "OwnGrooming":
        """Return what a cell of the table says.

        Parameters
        ----------
        text : str
            Names and values, separated by semicolons.
        subject : str
            The subject's name, for messages.

        Raises
        ------
        InputError
            If a name or a value is not known.
        """
        fields = dict(part.partition("=")[::2] for part in text.split(";") if part.strip())
        given = {name.strip(): value.strip() for name, value in fields.items()}
        try:
            own = cls.model_validate(given)
            own.applied(GroomSettings())
        except ValidationError as error:
            name = str(error.errors()[0]["loc"][0])
            known = (
                f"one of {', '.join(cls.model_fields)}" if name not in cls.model_fields else "a valid value"
            )
            raise InputError(
                f"{subject}: {name}={given.get(name, '')} in its column grooming is not {known}"
            ) from error
        return own

    @property
    def text(self) -> str:
        """The text that `read` takes."""
        given = self.model_dump(mode="json", exclude_defaults=True)
        return "; ".join(f"{name}={'yes' if value is True else value}" for name, value in given.items())

    def applied(self, settings: GroomSettings) -> GroomSettings:
        """Return the settings of the subject's own surface."""
        own = self.model_dump(exclude_none=True, exclude={"turned", "mirrored"})
        return GroomSettings.model_validate(settings.model_dump() | own) if own else settings


_OF_STRUCTURES = ("values", "pieces", "openings", "spacing", "smoothing", "tunnels")
"""Settings of `OwnGrooming` that a structure may have."""


class OptimizeSettings(_Settings):
    """Optimization."""

    method: Annotated[
        Method,
        Field(
            description="Terms of the objective: geodesic or Euclidean distances, with or without normals."
        ),
    ] = Method.GEODESIC_NORMALS
    particles: Annotated[
        int, Field(ge=FEWEST, le=MOST, description="Number of corresponding points on every shape.")
    ] = 1024
    structure_particles: Annotated[
        str | None,
        Field(
            max_length=2000,
            json_schema_extra=_shown(if_none="all alike"),
            description="Numbers of particles of structures that have more or fewer, such as "
            "femur=512,patella=128.",
        ),
        AfterValidator(_counts),
    ] = None
    align_by: Annotated[
        str | None,
        Field(
            min_length=1,
            max_length=200,
            json_schema_extra=_shown(if_none="all"),
            description="Structure by which subjects with several structures are aligned.",
        ),
    ] = None
    seed: Annotated[
        int,
        Field(
            ge=0,
            le=2**31 - 1,
            description="Random seed; on a CPU the same seed gives the same result.",
        ),
    ] = 0
    procrustes: Annotated[
        Procrustes,
        Field(
            description="Alignment of the particles: off, rigid (sizes kept), form (optimized at one size, "
            "sizes kept in results) or shape (one size). Auto: form with ICP, shape with scaling, else off."
        ),
    ] = Procrustes.AUTO
    core_set: Annotated[
        int | None,
        Field(
            ge=3,
            le=100000,
            json_schema_extra=_shown(if_none="none"),
            description="Number of subjects that are optimized jointly, chosen to span shapes and groups; "
            "the others are fitted to them one by one. If not given, all are optimized jointly.",
        ),
    ] = None
    landmarks: Annotated[
        bool,
        Field(
            description="Start with particles on the subjects' landmarks (column landmarks of cohort.csv, or "
            "NAME.mrk.json next to the file)."
        ),
    ] = False
    ensemble_weight: Annotated[
        float | None,
        Field(
            gt=0.0,
            le=10.0,
            json_schema_extra=_shown(if_none="derived from the cohort"),
            description="Weight of the ensemble entropy H(Z) relative to the sampling entropy; derived from "
            "how many parts of the surface vary independently if not given.",
        ),
    ] = None
    coherence: Annotated[
        float,
        Field(
            ge=0.0,
            le=100.0,
            description="How closely particles move along with their neighbours. 4 keeps two standard "
            "deviations within a particle's share of the surface; 0 gives the paper's objective.",
        ),
    ] = 4.0
    normals_weight: Annotated[
        float, Field(gt=0.0, le=10.0, description="Weight of the entropy of the surface normals, H(V).")
    ] = 0.1
    opening_weight: Annotated[
        float,
        Field(
            ge=0.0,
            le=10.0,
            description="Weight of opening angles (edges, tips, hollows) relative to normals in H(V); 0 "
            "gives the paper's H(V).",
        ),
    ] = 1.0
    regularization_start: Annotated[
        float,
        Field(
            gt=0.0,
            le=1e6,
            description="Regularization of the covariances when annealing starts, relative to 1/10000 of the "
            "mean surface area.",
        ),
    ] = 10.0
    regularization_end: Annotated[
        float, Field(gt=0.0, le=1e6, description="Regularization of the covariances when annealing ends.")
    ] = 0.00025
    split_iterations: Annotated[int, Field(ge=5, le=100000, description="Iterations after each split.")] = 50
    anneal_iterations: Annotated[
        int,
        Field(
            ge=5,
            le=100000,
            description="Iterations of annealing: two thirds before the particles are split, the rest after.",
        ),
    ] = 450
    settle_iterations: Annotated[
        int,
        Field(
            ge=5,
            le=100000,
            description="Maximum number of iterations after annealing if the run does not converge.",
        ),
    ] = 1000
    tolerance: Annotated[
        float,
        Field(
            gt=0.0,
            le=1.0,
            description="A run has converged when 20 iterations change the objective per particle by less "
            "than this.",
        ),
    ] = 2e-4


class RunSettings(_Settings):
    """Run."""

    groom: GroomSettings = GroomSettings()
    optimize: OptimizeSettings = OptimizeSettings()
    device: Annotated[
        str,
        Field(
            description="Compute device: auto, cpu, cuda:0 …; auto takes the first GPU. Several devices, "
            "such as cuda:0,cuda:1, share the shapes.",
        ),
        _form(
            r"auto|(cpu|cuda(:\d+)?)(,(cpu|cuda(:\d+)?))*",
            "must be auto, cpu, cuda or such as cuda:0; several with commas and no spaces: cuda:0,cuda:1",
        ),
    ] = "auto"
    workers: Annotated[
        int | None,
        Field(
            ge=1,
            le=256,
            json_schema_extra=_shown(if_none="one per core"),
            description="Number of processes that groom and fit subjects; one per core if not given.",
        ),
    ] = None
    memory: Annotated[
        float | None,
        Field(
            ge=0.1,
            le=100000.0,
            json_schema_extra=_shown("GB", if_none="unlimited"),
            description="Memory limit of the optimization. Data beyond it are kept in memory-mapped files of "
            "the project. Unlimited if not given.",
        ),
    ] = None
    cluster: Annotated[
        str | None,
        Field(
            max_length=300,
            json_schema_extra=_shown(if_none="none"),
            description="Dask cluster that grooms and fits subjects: local, slurm, or the address of a "
            "scheduler (tcp://host:8786) whose workers see the same files. none or not given: processes of "
            "this machine.",
        ),
        _form(
            r"local|slurm|(tcp|tls|ucx)://\S+",
            "must be local, slurm, or the address of a scheduler, such as tcp://host:8786",
        ),
    ] = None

    @field_validator("cluster", mode="before")
    @classmethod
    def _or_none(cls, given: object) -> object:
        return None if given == "none" else given

    @property
    def of_structures(self) -> dict[str, "RunSettings"]:
        """The settings of each of several structures alone, by its name; empty for one structure."""
        counts = _pairs(self.optimize.structure_particles or "", "=")
        alone = {"align_by": None, "structure_particles": None, "core_set": None, "landmarks": False}
        return {
            name: self.model_copy(
                update={
                    "groom": groom,
                    "optimize": self.optimize.model_copy(
                        update=alone | {"particles": int(counts.get(name, self.optimize.particles))}
                    ),
                }
            )
            for name, groom in self.groom.of_structures.items()
        }

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of particles of each structure."""
        several = self.of_structures.values()
        return tuple(own.optimize.particles for own in several) or (self.optimize.particles,)

    @property
    def unknown_structures(self) -> list[str]:
        """Names of structures that have settings but are not modelled."""
        known = self.groom.of_structures
        given = [
            *([self.optimize.align_by] if self.optimize.align_by else []),
            *_pairs(self.optimize.structure_particles or "", "="),
            *_own_grooming(self.groom.structure_grooming),
        ]
        return [name for name in dict.fromkeys(given) if name not in known]

    @property
    def placing(self) -> OptimizeSettings:
        """The optimizer's settings with `Procrustes.AUTO` resolved for these settings."""
        if self.optimize.procrustes is not Procrustes.AUTO:
            return self.optimize
        meant = Procrustes.OFF
        if self.groom.alignment is Alignment.ICP:
            meant = Procrustes.SHAPE if self.groom.scaling else Procrustes.FORM
        return self.optimize.model_copy(update={"procrustes": meant})
