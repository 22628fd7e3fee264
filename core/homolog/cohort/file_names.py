"""Interpretation of file names: label maps or scans, structures, time points."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from homolog.cohort.pictures import has_pages
from homolog.cohort.sides import is_side
from homolog.cohort.subject import IMAGE_SUFFIXES, MESH_SUFFIXES, stem_of, suffix_of

__all__ = [
    "are_groups",
    "are_times",
    "best_label_maps",
    "corrected",
    "describe_files",
    "files_beside",
    "is_mask",
    "is_picture",
    "is_site",
    "kinds_before_numbers",
    "known_files",
    "maps_of_all",
    "name_within",
    "numbered_part",
    "owner_of",
    "pictures_among",
    "structure_in",
    "structures_in_names",
    "times_among",
    "words_but_times",
    "words_of_individual",
]

_CAPITAL = re.compile(r"(?<=[a-z])(?=[A-Z])")
"""Boundary between the words of ``femurLeft``."""
_SEPARATED = re.compile(r"[^\W_]+")
# fmt: off
_MASKS = frozenset([
    "dseg", "ground", "groundtruth", "gt", "label", "labelmap", "labelmaps", "labels", "manual", "mask",
    "masks", "msk", "roi", "seg", "segmentation", "segmentations", "segs", "truth",
    "maske", "masken", "segmentierung", "segmentierungen", "masque", "masques", "mascara", "mascaras",
    "segmentacion", "segmentaciones", "maschera", "maschere", "segmentazione", "segmentazioni",
])
"""Words in the names of label maps."""
_MODALITIES = frozenset([
    "4d", "adc", "bold", "cbct", "cine", "ct", "cta", "dicom", "dwi", "flair", "mp2rage", "mprage", "mr",
    "mri", "mrt", "pd", "pdw", "pet", "probseg", "swi", "t1", "t1c", "t1ce", "t1gd", "t1n", "t1w", "t2",
    "t2f", "t2star", "t2w",
])
_ACQUISITIONS = frozenset([
    "2d", "3d", "arterial", "ax", "axial", "blade", "cor", "coronal", "dixon", "fl2d", "fl3d", "flash", "fs",
    "fse", "gre", "haste", "iso", "native", "portal", "sag", "sagittal", "se", "spair", "spc", "spgr", "stir",
    "tirm", "tra", "transversal", "trufi", "tse", "venous", "vibe",
])
# fmt: on
"""Words for sequences, planes and phases that follow the modality in names of scans: ``t2_tse_tra``."""
_PICTURES = _MODALITIES | {
    "bild", "brain", "grey", "greyscale", "image", "imaging", "img", "norm", "nu", "orig", "raw", "scan",
    "volume",
}  # fmt: skip
"""Names of scans next to label maps."""
_PREDICTIONS = frozenset(["inference", "pred", "predicted", "prediction", "predictions", "preds"])
_PROBABILITIES = frozenset([
    "confidence", "entropy", "heatmap", "logit", "logits", "prob", "proba", "probabilities", "probability",
    "probs", "softmax", "uncertainty",
])  # fmt: skip
_DERIVED = _PREDICTIONS | _PROBABILITIES
"""Words in the names of a network's results."""
_NORMALIZED = {"norm", "nu", "orig"}
"""Last words of the names of FreeSurfer's scans."""
_SCAN, _PROBABILITY, _PLAIN, _PREDICTION, _MASK = range(5)
"""What a file is by its name; of a subject's files, one with the largest number is the label map."""
_LABEL_MAPS = frozenset({"aseg", "dseg", "firstseg", "wmparc"})
"""Words of BIDS, FSL and FreeSurfer for a map of all structures."""
# fmt: off
_GROUPS = frozenset([
    "ad", "asd", "case", "cases", "cn", "control", "controls", "ctl", "ctrl", "disease", "diseased", "f",
    "female", "females", "hc", "healthy", "m", "male", "males", "mci", "men", "nc", "normal", "normals",
    "pathological", "patient", "patients", "td", "test", "testing", "train", "training", "val", "valid",
    "validation", "women",
])
# fmt: on
"""Words in the names of folders of groups."""
_PEOPLE = frozenset(
    [
        "cases",
        "control",
        "controls",
        "ctl",
        "ctrl",
        "gesund",
        "gesunde",
        "hc",
        "healthy",
        "kontrollen",
        "kontrollgruppe",
        "normals",
        "patienten",
        "patients",
    ]
)
"""Words that mark a folder, and those next to it, as groups, whatever other words their names contain."""
_TIME = re.compile(
    r"(day|frame|month|phase|ses|session|time|timepoint|tp|visit|week|year)\d{1,4}"
    r"|(19|20)\d\d[01]\d[0-3]\d|baseline|diastole|ed|es|followup|post|postop|pre|preop|systole"
)
_SITE = re.compile(
    rf"(({'|'.join(sorted(_GROUPS))})[-_. ]+)?"
    r"(arm|batch|center|centre|cohort|fold|group|hospital|observer|part|rater|reader|scanner|set|site|study)"
    r"[-_. ]?(\d{1,3}|[a-z])",
    re.IGNORECASE,
)
"""Names of folders that are numbered parts of a cohort: ``siteA``, ``Training batch 2``."""
_CHANNEL = re.compile(r"_000\d$")
"""Suffix of the names of nnU-Net's scans."""
_DATE = re.compile(r"(?<!\d)((?:19|20)\d\d)[-_.]([01]\d)[-_.]([0-3]\d)(?!\d)")
_OTHER_GIFTI = re.compile(
    r"\.(shape|func|label|time|tensor|vector|coord|topo|rgba|dset|annot)\.gii$"
    r"|(^|[^a-z])((very_?)?inflated|sphere|flat)([^a-z].*)?\.gii$",
    re.IGNORECASE,
)
"""GIFTI files of values on a surface, and of unfolded surfaces."""
_NUMBER_LAST = re.compile(r"(.*[^\W\d_])[-_. ]?(\d+)")
_FEWEST = 3
"""Least number of subjects for structure names at the ends of file names."""
_FULL = 0.75
"""Least share of the subjects with a file for each structure, if names contain structures."""


def known_files(entries: Sequence[Path]) -> list[Path]:
    """Return the segmentations and meshes, without GIFTI files of values or unfolded surfaces.

    TIFF files with several pages are segmentations; others may be slices, see `picture_cohort`.
    """
    return [
        entry
        for entry in entries
        if suffix_of(entry) in IMAGE_SUFFIXES + MESH_SUFFIXES
        and not _OTHER_GIFTI.search(entry.name)
        and entry.is_file()
        and not (suffix_of(entry) in (".tif", ".tiff") and not has_pages(entry))
    ]


def _is_group(name: str) -> bool:
    """Return whether a folder's name denotes a group: ``patients``, ``train``, ``pre``."""
    tokens = _words(name)
    if is_site(name):
        return True
    return bool(tokens) and all(
        word in _GROUPS or word in _MODALITIES or _TIME.fullmatch(word) for word in tokens
    )


def are_groups(names: Sequence[str]) -> bool:
    """Return whether folders next to each other are groups: ``Controls`` and ``Hip dysplasia``."""
    return all(map(_is_group, names)) or any(not _PEOPLE.isdisjoint(_words(name)) for name in names)


def is_site(name: str) -> bool:
    """Return whether a folder's name denotes a numbered part of a cohort: ``siteA``, ``rater2``."""
    return bool(_SITE.fullmatch(name))


def name_within(kind: str, name: str) -> str:
    """Return a name without a structure's name at either end: ``01`` of ``liver_01`` in ``liver``."""
    inner = re.sub(rf"^{re.escape(kind)}[-_. ]+|[-_. ]+{re.escape(kind)}$", "", name, flags=re.IGNORECASE)
    return inner or name


def _words(text: str) -> list[str]:
    return [word.casefold() for word in _SEPARATED.findall(_DATE.sub(r"\1\2\3", text))]


def is_picture(structure: str) -> bool:
    """Return whether the name of a subject's file denotes a scan."""
    tokens = _words(structure)
    if tokens[-1:] == ["probseg"]:  # BIDS, also where a label is named
        return True
    if not tokens or not _MASKS.isdisjoint(tokens):
        return False
    if tokens[-1].endswith("mri"):  # ``lgemri``
        return True
    is_acquisition = tokens[0] in _MODALITIES and _ACQUISITIONS.issuperset(set(tokens) - _MODALITIES)
    return is_acquisition or structure.casefold() in _PICTURES or tokens[-1] in _MODALITIES | _NORMALIZED


def is_mask(structure: str) -> bool:
    """Return whether the name of a subject's file says only that it is a label map: ``GT``."""
    tokens = _words(structure)
    return bool(tokens) and _MASKS.issuperset(tokens)


def files_beside(files: Sequence[Path]) -> tuple[dict[Path, Path], list[Path]]:
    """Return the files next to label maps of the same subjects, by their names.

    Parameters
    ----------
    files : sequence of Path

    Returns
    -------
    dict of Path to Path
        Scans, each with its label map: ``case1.nii.gz`` next to ``case1_seg.nii.gz``, ``case1_ct.nii.gz``
        next to ``case1.nii.gz``, ``ct_1.nrrd`` next to ``mask_1.nrrd``, nnU-Net's ``case1_0000.nii.gz`` next
        to ``case1.nii.gz``.
    list of Path
        Predictions and probabilities.
    """
    scans, derived = dict[Path, Path](), list[Path]()
    for ranked in _ranked(files):
        highest, label_map = max(ranked, key=lambda item: item[0])
        for rank, file in ranked:
            if rank == highest:
                continue
            if rank in (_PROBABILITY, _PREDICTION):
                derived.append(file)
            elif suffix_of(file) in IMAGE_SUFFIXES:
                scans[file] = label_map
    return scans, derived


def _ranked(files: Sequence[Path]) -> list[list[tuple[int, Path]]]:
    """Return the files of each subject, each with what it is by its name; the label map has the most."""
    stems = {stem_of(file) for file in files}
    by_subject: dict[tuple[str, ...], list[tuple[int, Path]]] = defaultdict(list)
    for file in files:
        stem = stem_of(file)
        without_channel = _CHANNEL.sub("", stem)
        is_channel = stem != without_channel and without_channel in stems
        tokens = [part for word in _words(without_channel if is_channel else stem) for part in _unglued(word)]
        by_subject[_whose(tokens)].append((_SCAN if is_channel else _rank(tokens, file), file))
    return list(by_subject.values())


def _unglued(word: str) -> list[str]:
    """Return a word for label maps or scans and the number that follows it: ``mask`` and ``01``."""
    parts = re.fullmatch(r"([a-z]+)(\d+)", word)
    is_kind = parts and word not in _PICTURES and parts[1] in _MASKS | (_PICTURES - _MODALITIES)
    return [parts[1], parts[2]] if parts and is_kind else [word]


def _rank(tokens: Sequence[str], file: Path) -> int:
    if not _PROBABILITIES.isdisjoint(tokens) or tokens[-1:] == ["probseg"]:
        return _PROBABILITY
    if not _PREDICTIONS.isdisjoint(tokens):
        return _PREDICTION
    if not _MASKS.isdisjoint(tokens) or suffix_of(file) == ".seg.nrrd":
        return _MASK
    return _PLAIN if _PICTURES.isdisjoint(tokens) else _SCAN


def _whose(tokens: Iterable[str]) -> tuple[str, ...]:
    parts = tuple(tokens)
    others = _MASKS | _DERIVED | _PICTURES | (frozenset() if _MODALITIES.isdisjoint(parts) else _ACQUISITIONS)
    return tuple(part for part in parts if part not in others)


def maps_of_all(files: Sequence[Path]) -> list[Path]:
    """Return the files with all structures of a subject, by their names: BIDS, FSL FIRST."""
    return [file for file in files if not _LABEL_MAPS.isdisjoint(_words(stem_of(file)))]


def corrected(files: Sequence[Path]) -> list[Path]:
    """Return files without FSL FIRST's duplicates with undecided border voxels.

    ``L_Hipp_first.nii.gz`` has these as separate values, ``L_Hipp_corr.nii.gz`` has only the structure.
    """
    better = {stem_of(file).removesuffix("_corr") for file in files if stem_of(file).endswith("_corr")}
    return [
        file
        for file in files
        if not (stem_of(file).endswith("_first") and stem_of(file).removesuffix("_first") in better)
    ]


def best_label_maps(files: Mapping[str, Path]) -> dict[str, Path]:
    """Return the files with all structures of a subject, by their names; otherwise all files.

    Preferred are a 3D Slicer segmentation among volumes, and BIDS' ``dseg`` in the subject's own space, with
    ``aseg`` among several.
    """
    segmentations = [file for file in files.values() if suffix_of(file) == ".seg.nrrd"]
    chosen = segmentations or maps_of_all(list(files.values()))
    keeps: tuple[Callable[[list[str]], bool], ...] = (
        lambda tokens: "space" not in tokens,
        lambda tokens: "aseg" in tokens,
    )
    for keep in keeps:
        chosen = [file for file in chosen if keep(_words(stem_of(file)))] or chosen
    return {name: file for name, file in files.items() if not chosen or file in chosen}


def are_times(structures: Iterable[str]) -> bool:
    """Return whether several files of a subject are time points: ``frame01_gt``, ``ED``."""
    names = list(structures)
    return len(names) > 1 and all(map(_is_time, names))


def times_among(names: Iterable[str]) -> list[str]:
    """Return the folders of a subject that are time points: ``baseline`` and ``2020-04-02``."""
    times = [name for name in names if _is_time(name)]
    return times if len(times) > 1 else []


def _is_time(name: str) -> bool:
    tokens = [word for word in _words(name) if word not in _MASKS]
    return bool(tokens) and all(map(_TIME.fullmatch, tokens))


def describe_files(word: str) -> bool:
    """Return whether a word in file names tells no structures apart: sides, times, groups, label maps."""
    folded = word.casefold()
    return is_side(folded) or folded in _GROUPS | _MASKS or _TIME.fullmatch(folded) is not None


def words_but_times(text: str) -> tuple[str, ...]:
    """Return the words of a name without time points: ``cc`` and ``mask`` of ``ses-01_cc_mask``."""
    joined = re.sub(r"(?<=[^\W\d_])[-_. ](?=\d)", "", text)
    return tuple(word for word in _words(joined) if not _TIME.fullmatch(word))


def words_of_individual(name: str) -> tuple[str, ...]:
    """Return the words of a name without times and sides; subjects of one individual share them."""
    return tuple(word for word in words_but_times(name) if not is_side(word))


def structures_in_names(stems: Sequence[str]) -> dict[str, int]:
    """Return the structures in the names of one folder's files: ``p1_liver``, ``p1_spleen``, ``p2_liver`` ….

    A structure is the text after a subject's number, or the last word of names without numbers. Values are
    numbers of subjects. The result is empty if there is one file per subject, if the text is a side or a
    time, or if few subjects share it.
    """
    owners: dict[str, set[str]] = defaultdict(set)
    for stem in stems:
        owners[structure_in(stem)].add(owner_of(stem))
    subjects = set().union(*owners.values())
    whole = {name for name, whose in owners.items() if len(whose) >= _FULL * len(subjects)}
    kinds = {kind for name in whole if (kind := _kind(name))}
    several = len(kinds) > 1 and len(subjects) >= _FEWEST
    return {name: len(whose) for name, whose in owners.items()} if several else {}


def kinds_before_numbers(stems: Sequence[str]) -> list[str]:
    """Return the texts before equal numbers: ``liver_01``, ``spleen_01``, ``liver_02`` …; may be empty.

    These may be structures as well as groups.
    """
    numbers: dict[str, set[str]] = defaultdict(set)
    for stem in stems:
        if parts := _NUMBER_LAST.fullmatch(stem):
            numbers[parts[1]].add(parts[2])
    every = set().union(*numbers.values())
    kinds = [name for name, own in numbers.items() if _kind(name) and len(own) >= _FULL * len(every)]
    several = len(kinds) == len(numbers) and len({_kind(name) for name in kinds}) > 1
    return kinds if several and len(every) >= _FEWEST else []


def pictures_among(files: Sequence[Path]) -> dict[str, Path]:
    """Return the scans by subject: ``p1_ct``, if the other files are like ``p1_liver``."""
    scans = {owner_of(stem_of(file)): file for file in files if is_picture(structure_in(stem_of(file)))}
    pictures = set(scans.values())
    others = [stem_of(file) for file in files if file not in pictures]
    masks = {owner_of(stem) for stem in others if structure_in(stem)}
    return scans if scans and scans.keys() <= masks and {owner_of(stem) for stem in others} <= masks else {}


def structure_in(stem: str) -> str:
    """Return the part of a file's name after the subject's; empty if there is none."""
    return stem[len(owner_of(stem)) :].strip("_-. ")


def owner_of(stem: str) -> str:
    """Return a file's subject: the numbered part of its name; without a number, all but the last word."""
    return numbered_part(stem) or re.sub(r"[-_. ]+[^\W_]+$", "", stem) or stem


def numbered_part(stem: str) -> str:
    """Return a file's name up to the end of the last word with a number; empty if it has none."""
    numbered = re.match(r".*\d[^\W_]*", stem)
    return numbered[0] if numbered else ""


def _kind(text: str) -> tuple[str, ...]:
    """Return the words of a structure: neither side nor time, with at least one that is not a short code."""
    tokens = tuple(
        word
        for word in _words(_CAPITAL.sub("_", text))
        if word not in _MASKS and not is_side(word) and not _TIME.fullmatch(word)
    )
    return tokens if any(word.isalpha() and len(word) > 2 for word in tokens) else ()
