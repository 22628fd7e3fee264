"""Public numbers of structures: FreeSurfer's (FreeSurferColorLUT.txt), and TotalSegmentator's task `total`.

A list applies to a file only if its numbers, or the names of its folders, match: every list contains the
values 1, 2 and 3.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

__all__ = ["FREESURFER", "KNOWN_LISTS", "KnownList", "known_list"]


@dataclass(frozen=True, slots=True)
class KnownList:
    """A public list of labels.

    Attributes
    ----------
    source : str
        Origin of the list, for messages.
    names : mapping of int to str
        Names by number.
    hints : re.Pattern
        Pattern in the names of files and folders with such labels.
    common : frozenset of int
        Numbers that occur in the program's files; the others occur in the list only.
    fewest : int
        Least number of different values, all of them common, from which on a file is assumed to follow the
        list.
    telling : frozenset of int
        Values any one of which has the same effect.
    """

    source: str
    names: Mapping[int, str]
    hints: re.Pattern[str]
    common: frozenset[int]
    fewest: int
    telling: frozenset[int] = frozenset()

    def fits(self, values: frozenset[int]) -> bool:
        """Return whether a file's values alone match the list."""
        return values <= self.common and (len(values) >= self.fewest or bool(values & self.telling))


def known_list(path: Path, values: frozenset[int]) -> KnownList | None:
    """Return the public list that matches a file's values, if any.

    Parameters
    ----------
    path : Path
        The file; its name and those of the two folders above it are matched.
    values : frozenset of int
        The values above 0 that have voxels.
    """
    text = "/".join(path.parts[-3:]).casefold()
    hinted = [item for item in KNOWN_LISTS if item.hints.search(text) and values <= item.names.keys()]
    fitting = [item for item in KNOWN_LISTS if item.fits(values)]
    return next(iter([*hinted, *fitting]), None) if values else None


_SIDED = {  # number on the left, on the right
    "Cerebral-Exterior": (1, 40), "Cerebral-White-Matter": (2, 41), "Cerebral-Cortex": (3, 42),
    "Lateral-Ventricle": (4, 43), "Inf-Lat-Vent": (5, 44), "Cerebellum-Exterior": (6, 45),
    "Cerebellum-White-Matter": (7, 46), "Cerebellum-Cortex": (8, 47), "Thalamus-unused": (9, 48),
    "Thalamus": (10, 49), "Caudate": (11, 50), "Putamen": (12, 51), "Pallidum": (13, 52),
    "Hippocampus": (17, 53), "Amygdala": (18, 54), "Insula": (19, 55), "Operculum": (20, 56),
    "Lesion": (25, 57), "Accumbens-area": (26, 58), "Substancia-Nigra": (27, 59), "VentralDC": (28, 60),
    "undetermined": (29, 61), "vessel": (30, 62), "choroid-plexus": (31, 63), "WM-hypointensities": (78, 79),
    "non-WM-hypointensities": (81, 82),
}  # fmt: skip
_RARE = frozenset({1, 6, 9, 19, 20, 25, 27, 29, 40, 45, 48, 55, 56, 57, 59, 61})
"""Numbers that do not occur in FreeSurfer's own maps, but in lists that count from 1."""
_MIDDLE = {
    14: "3rd-Ventricle", 15: "4th-Ventricle", 16: "Brain-Stem", 24: "CSF", 72: "5th-Ventricle",
    77: "WM-hypointensities", 80: "non-WM-hypointensities", 85: "Optic-Chiasm", 192: "Corpus_Callosum",
    251: "CC_Posterior", 252: "CC_Mid_Posterior", 253: "CC_Central", 254: "CC_Mid_Anterior",
    255: "CC_Anterior",
}  # fmt: skip
_CORTEX = [
    "unknown",
    "bankssts",
    "caudalanteriorcingulate",
    "caudalmiddlefrontal",
    "corpuscallosum",
    "cuneus",
    "entorhinal",
    "fusiform",
    "inferiorparietal",
    "inferiortemporal",
    "isthmuscingulate",
    "lateraloccipital",
    "lateralorbitofrontal",
    "lingual",
    "medialorbitofrontal",
    "middletemporal",
    "parahippocampal",
    "paracentral",
    "parsopercularis",
    "parsorbitalis",
    "parstriangularis",
    "pericalcarine",
    "postcentral",
    "posteriorcingulate",
    "precentral",
    "precuneus",
    "rostralanteriorcingulate",
    "rostralmiddlefrontal",
    "superiorfrontal",
    "superiorparietal",
    "superiortemporal",
    "supramarginal",
    "frontalpole",
    "temporalpole",
    "transversetemporal",
    "insula",
]
"""Regions of the atlas of Desikan and Killiany, numbered from 1000 (left) and from 2000 (right)."""


def _freesurfer() -> dict[int, str]:
    names = dict(_MIDDLE)
    for name, (left, right) in _SIDED.items():
        names |= {left: f"Left-{name}", right: f"Right-{name}"}
    for start, side in ((1000, "lh"), (2000, "rh")):
        names |= {start + number: f"ctx-{side}-{name}" for number, name in enumerate(_CORTEX)}
    return names


_TOTAL = [
    "spleen",
    "kidney_right",
    "kidney_left",
    "gallbladder",
    "liver",
    "stomach",
    "pancreas",
    "adrenal_gland_right",
    "adrenal_gland_left",
    "lung_upper_lobe_left",
    "lung_lower_lobe_left",
    "lung_upper_lobe_right",
    "lung_middle_lobe_right",
    "lung_lower_lobe_right",
    "esophagus",
    "trachea",
    "thyroid_gland",
    "small_bowel",
    "duodenum",
    "colon",
    "urinary_bladder",
    "prostate",
    "kidney_cyst_left",
    "kidney_cyst_right",
    "sacrum",
    "vertebrae_S1",
    "vertebrae_L5",
    "vertebrae_L4",
    "vertebrae_L3",
    "vertebrae_L2",
    "vertebrae_L1",
    "vertebrae_T12",
    "vertebrae_T11",
    "vertebrae_T10",
    "vertebrae_T9",
    "vertebrae_T8",
    "vertebrae_T7",
    "vertebrae_T6",
    "vertebrae_T5",
    "vertebrae_T4",
    "vertebrae_T3",
    "vertebrae_T2",
    "vertebrae_T1",
    "vertebrae_C7",
    "vertebrae_C6",
    "vertebrae_C5",
    "vertebrae_C4",
    "vertebrae_C3",
    "vertebrae_C2",
    "vertebrae_C1",
    "heart",
    "aorta",
    "pulmonary_vein",
    "brachiocephalic_trunk",
    "subclavian_artery_right",
    "subclavian_artery_left",
    "common_carotid_artery_right",
    "common_carotid_artery_left",
    "brachiocephalic_vein_left",
    "brachiocephalic_vein_right",
    "atrial_appendage_left",
    "superior_vena_cava",
    "inferior_vena_cava",
    "portal_vein_and_splenic_vein",
    "iliac_artery_left",
    "iliac_artery_right",
    "iliac_vena_left",
    "iliac_vena_right",
    "humerus_left",
    "humerus_right",
    "scapula_left",
    "scapula_right",
    "clavicula_left",
    "clavicula_right",
    "femur_left",
    "femur_right",
    "hip_left",
    "hip_right",
    "spinal_cord",
    "gluteus_maximus_left",
    "gluteus_maximus_right",
    "gluteus_medius_left",
    "gluteus_medius_right",
    "gluteus_minimus_left",
    "gluteus_minimus_right",
    "autochthon_left",
    "autochthon_right",
    "iliopsoas_left",
    "iliopsoas_right",
    "brain",
    "skull",
]


def _totalsegmentator() -> dict[int, str]:
    ribs = [f"rib_{side}_{number}" for side in ("left", "right") for number in range(1, 13)]
    return dict(enumerate([*_TOTAL, *ribs, "sternum", "costal_cartilages"], start=1))


_BRAIN, _BODY = _freesurfer(), _totalsegmentator()
FREESURFER = KnownList(
    "FreeSurfer",
    MappingProxyType(_BRAIN),
    re.compile(r"aseg|aparc|freesurfer|synthseg"),
    common=frozenset(_BRAIN) - _RARE,
    fewest=8,
    telling=frozenset(right for _, right in _SIDED.values()) - _RARE,
)
_TOTALSEGMENTATOR = KnownList(
    "TotalSegmentator",
    MappingProxyType(_BODY),
    re.compile(r"totalseg|total_seg"),
    common=frozenset(_BODY),
    fewest=40,
)
KNOWN_LISTS = (FREESURFER, _TOTALSEGMENTATOR)
