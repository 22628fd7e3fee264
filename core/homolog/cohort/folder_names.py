"""Names of folders that say what is in them rather than whose it is."""

import re
from collections.abc import Collection, Iterable

__all__ = [
    "IMAGES",
    "LABELS",
    "MESHES",
    "PREDICTION_FOLDER",
    "SCANS",
    "SOURCE_FOLDER",
    "describe_contents",
    "folders_of",
]

_GLUED = r"(tr|ts|va|train|training|test|testing|val|validation)?"
LABELS = re.compile(
    r"((segmentation|seg|label|mask|msk|structure|annotation|gt|ground ?truth|masque|mascara)s?"
    rf"|masken?|segmentierung(en)?|segmentacion(es)?|mascher[ae]|segmentazion[ei]){_GLUED}"
)
IMAGES = re.compile(rf"((image|img|scan|volume|picture)s?|bild(er)?|imagen(es)?|immagin[ei]){_GLUED}")
MESHES = re.compile(r"(mesh|meshe|surface|model)s?")
SCANS = re.compile(r"data|dicom|cbct|cta?|mr[ait]?|pet|t[12]w?|us|volumes?")
"""Words for the contents of folders, of which each contains several subjects."""
_PARTS = frozenset(["tr", "ts", "va", "train", "training", "test", "testing", "val", "valid", "validation"])
"""Words in the names of such folders that divide the subjects."""
_VERSIONS = frozenset(
    ["anonymised", "anonymized", "corrected", "final", "manual", "new", "nifti", "nii", "nrrd", "old", "v"]
)
"""Words in the names of such folders that tell nothing."""
PREDICTION_FOLDER = re.compile(
    r"(auto(matic)?|(nnu-?net[-_ .]?)?(pred|predict|prediction|infer|inference|output|result)s?"
    r"|post[-_ ]?process(ed|ing)?|nnunet(v2)?(?![-_. ]*raw)|fold[-_ ]?\d)([-_. ].*|tr|ts|va)?",
    re.IGNORECASE,
)
"""Names of folders with predictions of a network, ignored if there are label maps."""
SOURCE_FOLDER = re.compile(r"(in|inputs?|raw|sources?|originals?|mri|surf)", re.IGNORECASE)
"""Names of folders of which files next to them were made, and of CAT12; never groups."""
_CAPITAL = re.compile(r"(?<=[a-z])(?=[A-Z])")
"""Boundary between the words of ``labelsTr``."""


def folders_of(kind: re.Pattern[str], names: Iterable[str]) -> set[str]:
    """Return the names of folders that contain files of one kind, by their names.

    Words that all folders next to each other share, as the name of a data set, are disregarded.

    Parameters
    ----------
    kind : re.Pattern
        `LABELS`, `IMAGES` or `MESHES`; beside label maps, `SCANS`.
    names : iterable of str
        Names of the folders next to each other.
    """
    by_name = {name: _words(name) for name in names}
    shared = set.intersection(*map(set, by_name.values())) if len(by_name) > 1 else set[str]()
    shared = {word for word in shared if not _is_content(word)}
    return {name for name, own in by_name.items() if kind.fullmatch(_told(own, shared))}


def describe_contents(names: Collection[str]) -> bool:
    """Return whether a folder among several has a name for label maps, images or meshes."""
    return any(folders_of(kind, names) for kind in (LABELS, IMAGES, MESHES))


def _words(name: str) -> list[str]:
    """Return the words of ``CT_masks``, ``labelsTr`` and ``ribfrac-val-labels-1``, without numbers."""
    return [word.casefold() for word in re.findall(r"[^\W\d_]+", _CAPITAL.sub("_", name))]


def _told(own: Iterable[str], shared: Collection[str]) -> str:
    return " ".join(word for word in own if word not in shared and word not in _PARTS | _VERSIONS)


def _is_content(word: str) -> bool:
    return any(kind.fullmatch(word) for kind in (LABELS, IMAGES, MESHES))
