"""Names of folders that say what is in them rather than whose it is."""

import re
from collections.abc import Iterable

__all__ = [
    "IMAGE_FOLDER",
    "LABEL_FOLDER",
    "MESH_FOLDER",
    "PREDICTION_FOLDER",
    "SOURCE_FOLDER",
    "describe_contents",
]

_PART = r"([-_.]?(tr|ts|va|train|training|test|testing|val|validation))?"
LABEL_FOLDER = re.compile(
    rf"((segmentation|seg|label|mask|structure|annotation|gt|ground[-_ ]?truth|masque|mascara)s?"
    rf"|masken?|segmentierung(en)?|segmentacion(es)?|mascher[ae]|segmentazion[ei]){_PART}",
    re.IGNORECASE,
)
IMAGE_FOLDER = re.compile(
    rf"((image|img|scan|volume|picture)s?|bild(er)?|imagen(es)?|immagin[ei]){_PART}", re.IGNORECASE
)
MESH_FOLDER = re.compile(r"(mesh|meshe|surface|model)s?", re.IGNORECASE)
"""Names of folders that are not subjects."""
PREDICTION_FOLDER = re.compile(
    r"(auto(matic)?|(nnu-?net[-_ .]?)?(pred|predict|prediction|infer|inference|output|result)s?"
    r"|post[-_ ]?process(ed|ing)?|nnunet(v2)?|fold[-_ ]?\d)([-_. ].*|tr|ts|va)?",
    re.IGNORECASE,
)
"""Names of folders with predictions of a network, ignored if there are label maps."""
SOURCE_FOLDER = re.compile(r"(in|inputs?|raw|sources?|originals?|mri|surf)", re.IGNORECASE)
"""Names of folders of which files next to them were made, and of CAT12; never groups."""


def describe_contents(names: Iterable[str]) -> bool:
    """Return whether a folder among several has a name for label maps, images or meshes."""
    kinds = (LABEL_FOLDER, IMAGE_FOLDER, MESH_FOLDER)
    return any(kind.fullmatch(name) for name in names for kind in kinds)
