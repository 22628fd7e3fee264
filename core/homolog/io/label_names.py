"""Names of structures: tables next to the files, public lists, and matching of a user's input."""

import difflib
import json
import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar

from homolog.cohort import IMAGE_SUFFIXES, suffix_of
from homolog.errors import InputError, listed
from homolog.spreadsheets import lists_labels, read_rows

__all__ = [
    "FREESURFER",
    "KNOWN_LISTS",
    "KnownList",
    "LabelTable",
    "known_list",
    "label_table",
    "matching",
    "near",
    "read_label_table",
    "same_name",
    "together",
]

_LARGEST = 2**20
"""Largest table of labels in bytes; larger files are ignored."""
_KINDS = (".txt", ".ctbl", ".label", ".labels", ".lut", ".json", ".tsv", ".csv")
_INHERITED = 5
"""Number of parent folders that are searched for BIDS tables."""
_NEAR = 6
"""Largest number of names in a message."""

_Named = TypeVar("_Named")


@dataclass(frozen=True, slots=True)
class LabelTable:
    """Names of label values.

    Attributes
    ----------
    source : str
        Name of the file or public list, for messages.
    names : mapping of int to str
        Names by value; values are above 0.
    is_known_list : bool
        Whether it is a public list inferred from the file's values, rather than a table next to the file.
    """

    source: str
    names: Mapping[int, str]
    is_known_list: bool = False


def same_name(name: str, other: str) -> bool:
    """Return whether two names denote the same structure.

    Case, blanks, dashes, underscores and the order of words are ignored; ``L`` and ``lh`` mean left.
    """
    return not _keys(name).isdisjoint(_keys(other))


def matching(items: Iterable[tuple[str, _Named]], wanted: str) -> list[_Named]:
    """Return the items that match a name: exact matches, if there are any."""
    items = list(items)
    exact = [item for name, item in items if name.strip().casefold() == wanted.strip().casefold()]
    return exact or [item for name, item in items if name and same_name(name, wanted)]


def near(names: Iterable[str], wanted: str) -> list[str]:
    """Return similar names, best first."""
    tokens = {name: set(_tokens(name)) for name in names if name}
    wanted_tokens = set(_tokens(wanted))
    inside = [name for name, own in tokens.items() if wanted_tokens <= own or own <= wanted_tokens]
    plain = {" ".join(sorted(own)): name for name, own in tokens.items()}
    alike = [
        plain[get_close_match]
        for get_close_match in difflib.get_close_matches(" ".join(sorted(wanted_tokens)), plain, 3, 0.75)
    ]
    telling = {word for word in wanted_tokens - {"left", "right"} if len(word) > 3}
    partly = [name for name, own in tokens.items() if telling & own]
    return list(dict.fromkeys([*inside, *alike, *partly]))[:_NEAR]


@lru_cache(maxsize=4096)
def _keys(name: str) -> frozenset[str]:
    """Return the comparison key of a name."""
    split = _tokens(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    plain = _tokens(name)
    return frozenset({" ".join(sorted(split)), " ".join(sorted(plain)), "".join(plain)} - {""})


def _tokens(name: str) -> list[str]:
    tokens = re.findall(r"[^\W_]+", unicodedata.normalize("NFKC", name).casefold())
    return [_SYNONYMS.get(word, word) for word in tokens if word != "hemi"]  # of BIDS' hemi-L


_SYNONYMS = {"l": "left", "lh": "left", "r": "right", "rh": "right"}
"""Sides in names of BIDS and FreeSurfer."""


def label_table(path: Path, values: Iterable[int], wanted: str | None = None) -> LabelTable | None:
    """Return the names of the values of a file without names.

    Parameters
    ----------
    path : Path
        The label map. Tables are searched for under its own name, then in its folder, then in the folder
        above; the first ones found are used.
    values : iterable of int
        The values that have voxels.
    wanted : str, optional
        The structure that the user requests. If it is a FreeSurfer name and the values allow it, FreeSurfer's
        list is used even for files with few labels.

    Returns
    -------
    LabelTable or None
        A table next to the file; otherwise the public list that matches the values, or None.

    Raises
    ------
    InputError
        If two tables of the same precedence contradict each other.
    """
    for tables in _places(path):
        if tables:
            return _joined(tables)
    present = frozenset(values)
    known = known_list(path, present)
    if known is None and wanted and present and present <= FREESURFER.common:
        known = FREESURFER if any(same_name(name, wanted) for name in FREESURFER.names.values()) else None
    return LabelTable(known.source, known.names, is_known_list=True) if known else None


def _places(path: Path) -> Iterable[list[LabelTable]]:
    stem = path.name[: len(path.name) - len(suffix_of(path))]
    for folder in path.parents[:2]:
        entries = _entries(str(folder), folder.stat().st_mtime_ns if folder.is_dir() else 0)
        images = {
            entry[: -len(suffix_of(Path(entry)))]
            for entry in entries
            if suffix_of(Path(entry)) in IMAGE_SUFFIXES
        }
        tables = [Path(entry) for entry in entries if Path(entry).suffix.lower() in _KINDS]
        yield _read(folder / table for table in tables if table.stem == stem)
        yield _read(folder / table for table in tables if table.stem not in images)
    for folder in path.parents[
        2:_INHERITED
    ]:  # BIDS: a table in a parent folder applies to files with the same suffix
        yield _read(table for table in sorted(folder.glob("*dseg.tsv")) if stem.endswith(table.stem))


@lru_cache(maxsize=64)
def _entries(folder: str, changed: int) -> tuple[str, ...]:
    try:
        return tuple(sorted(path.name for path in Path(folder).iterdir() if not path.name.startswith(".")))
    except OSError:
        return ()


def _read(paths: Iterable[Path]) -> list[LabelTable]:
    return [table for path in paths if (table := read_label_table(path)) is not None]


def _joined(tables: Sequence[LabelTable]) -> LabelTable:
    """Return several tables as one; raises InputError if they give a value different names."""
    names: dict[int, tuple[str, str]] = {}
    for table in tables:
        for value, name in table.names.items():
            before, source = names.setdefault(value, (name, table.source))
            if not same_name(before, name):
                raise InputError(
                    f"{table.source}: names label {value} {name!r}, and {source} names it {before!r}; keep "
                    "the correct table next to the files, and move the other one"
                )
    joined = {value: name for value, (name, _) in names.items()}
    return LabelTable(", ".join(item.source for item in tables), MappingProxyType(joined))


def together(path: Path, labels: Sequence[tuple[int, str]], *, numbered: bool = True) -> str:
    """Return a note that labels (value and name of each) were combined, named by the file or a table.

    Without `numbered`, the values of labels with names are not given.
    """
    beside: Mapping[int, str] = {}
    with suppress(InputError):  # tables that contradict each other matter only where a name is asked for
        table = label_table(path, ())
        beside = table.names if table else beside
    names = [(own or beside.get(value, ""), value) for value, own in labels]
    called = [(f"{name} ({value})" if numbered else name) if name else str(value) for name, value in names]
    shown = listed(called, _NEAR)
    return f"labels {shown} were combined into one structure; choose a label to study one of them"


def read_label_table(path: Path) -> LabelTable | None:
    """Read a table of labels; return None for other files.

    FreeSurfer's colour tables, ITK-SNAP's label descriptions, 3D Slicer's colour tables (``.ctbl``,
    ``.csv``), BIDS' (``_dseg.tsv``), lists of numbers and names as text, JSON of numbers and names in either
    order (also nnU-Net's ``dataset.json`` and TotalSegmentator's class maps).
    """
    try:
        if not path.is_file() or path.stat().st_size > _LARGEST:
            return None
        kind = path.suffix.lower()
        if kind in (".tsv", ".csv"):
            names = _of_columns(path)
        else:
            text = path.read_text(encoding="utf-8-sig", errors="replace")
            names = _of_json(text) if kind == ".json" else _of_lines(text)
            if not names and kind == ".txt" and _OF_LABELS.search(path.stem):
                names = _of_list(text)
    except OSError as error:
        raise InputError(f"{path}: can't be read: {error.strerror}; check its permissions") from error
    names = {value: name.strip() for value, name in names.items() if value > 0 and name.strip()}
    return LabelTable(str(path), MappingProxyType(names)) if names else None


_COLOURED = re.compile(r"(\d{1,9})\s+(\S.*?)((?:\s+\d{1,3}){3,4})")
_PLAIN = re.compile(r"(\d{1,9})\s*[:=,;\t ]\s*([^\W\d_].*)")
_OF_LABELS = re.compile(r"label|legend|lut|class|struct|segment", re.IGNORECASE)
"""In names of lists of labels; a list of another name may number subjects or groups."""
_SNAP = re.compile(r'(\d{1,9})((?:\s+\d{1,3}){3})\s+[\d.]+\s+[01]\s+[01]\s+"(.*)"')


def _of_lines(text: str) -> dict[int, str]:
    """Return the names of a FreeSurfer, ITK-SNAP or Slicer table; all lines must have the same format."""
    lines = _lines(text)
    for pattern, name in ((_SNAP, 3), (_COLOURED, 2)):
        matches = [pattern.fullmatch(line) for line in lines]
        if all(matches):
            return {int(item[1]): item[name].strip('"') for item in matches if item}
    return {}


def _of_list(text: str) -> dict[int, str]:
    """Return the names of a list with a number and a name in each line, if no number is repeated."""
    lines = _lines(text)
    listed = {int(item[1]): item[2] for line in lines if (item := _PLAIN.fullmatch(line))}
    return listed if len(listed) == len(lines) > 1 else {}


def _lines(text: str) -> list[str]:
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def _of_columns(path: Path) -> dict[int, str]:
    """Return the names of a table with headings, as BIDS and 3D Slicer write them."""
    if not lists_labels(path):
        return {}
    columns, rows = read_rows(path)
    value, name = columns[:2]
    return {int(row[value]): row[name] for _, row in rows if row[value].isdecimal()}


def _of_json(text: str) -> dict[int, str]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        return {}
    if not isinstance(content, dict):
        return _of_entries(content)
    for key in ("labels", "total", "class_map", "names"):
        if isinstance(inner := content.get(key), dict | list):
            return _of_mapping(inner) if isinstance(inner, dict) else _of_entries(inner)
    return _of_mapping(content)


def _of_mapping(content: Mapping[str, object]) -> dict[int, str]:
    """Return the names of ``{"1": "spleen"}`` or ``{"spleen": 1}``."""
    numbers = {key: value for key, value in content.items() if type(value) is int}
    if all(key.isdecimal() and isinstance(value, str) for key, value in content.items()):
        return {int(key): str(value) for key, value in content.items()}
    if len(numbers) == len(content) == len(set(numbers.values())):
        return {value: key for key, value in numbers.items()}
    return {}


def _of_entries(content: object) -> dict[int, str]:
    """Return the names of ``[{"value": 1, "name": "spleen"}]``, with any names of the two keys."""
    names: dict[int, str] = {}
    for entry in content if isinstance(content, list) else ():
        if not isinstance(entry, dict):
            return {}
        keys = {str(key).casefold(): value for key, value in entry.items()}
        value = next(
            (keys[key] for key in ("value", "id", "index", "label", "number") if type(keys.get(key)) is int),
            None,
        )
        name = next(
            (keys[key] for key in ("name", "label", "structure") if isinstance(keys.get(key), str)), None
        )
        if value is None or name is None:
            return {}
        names[value] = name
    return names


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
