"""The layouts of folders that are recognized without a pattern."""

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from homolog.cohort.files import is_series, shape_in, shapes_below
from homolog.cohort.patterns import Fields, assembled, proposals_text, single
from homolog.cohort.subject import IMAGE_SUFFIXES, Cohort, Subject, stem_of, suffix_of
from homolog.cohort.unread import contents_of
from homolog.errors import InputError

__all__ = ["DERIVATIVES", "read_folder", "structures_in", "structures_named", "subject_at"]

DERIVATIVES = "derivatives"
"""Folder of a BIDS data set with results computed from the scans."""
_LABELS, _IMAGES, _CHANNEL = "labelsTr", "imagesTr", "_0000"
"""nnU-Net's folders, and the end of the names of a scan's first channel."""
_SEGMENTATIONS, _SCANS = "segmentations", ("ct", "mri")
"""TotalSegmentator's folder of a subject's structures, and its scan next to it."""
_NAMED = 5
"""Largest number of files or folders in a message."""
_DISTINCT = re.compile(r"[-_. ]")


def read_folder(folder: Path) -> Cohort:
    """Return the cohort of a folder in a known layout.

    Raises
    ------
    InputError
        If the folder contains no shape, or its layout is another one; the message has the patterns that fit.
    """
    shapes = shapes_below(folder)
    if not shapes and is_series(folder):
        raise InputError(
            f"{folder}: contains the slices of one series; give the folder above it, which contains one "
            "folder for each subject"
        )
    if not shapes:
        raise InputError(f"{folder}: contains no segmentation or mesh{contents_of(folder)}")
    for layout in _LAYOUTS:
        if cohort := layout(folder, shapes):
            return cohort
    raise InputError(
        f"{folder}: its layout is none of those that are known{proposals_text(folder, shapes)}\n"
        "or list the files in a table (name,path,group)"
    )


def structures_in(folder: Path) -> dict[str, Path]:
    """Return the shapes of one subject's folder by structure: its file's name without the subject's."""
    place = folder / _SEGMENTATIONS
    shapes = shapes_below(place if place.is_dir() else folder, 0)
    return {_structure(path, folder.name): path for path in shapes}


def structures_named(path: Path) -> dict[str, Path]:
    """Return the shapes ``FOLDER/NAME_STRUCTURE.nii.gz`` of a subject ``FOLDER/NAME`` by structure."""
    files = shapes_below(path.parent, 0) if path.parent.is_dir() else []
    return {name: file for file in files if (name := _structure(file, path.name)) != stem_of(file)}


def subject_at(path: Path, name: str = "") -> Subject:
    """Return the subject of a file, a folder of slices, or a folder with a file for each structure."""
    name = name or stem_of(path)
    if not path.is_dir() or path == path.parent:
        return single(name, path)
    if series := shape_in(path):
        return single(name, series)
    files = structures_in(path)
    if len(files) == 1:
        return single(name, next(iter(files.values())))
    return Subject(name, path, structures=MappingProxyType(files))


def _structure(path: Path, subject: str) -> str:
    """Return a file's name without suffix and without the subject's name at its beginning or end."""
    stem = stem_of(path)
    for rest, separator in ((stem.removeprefix(subject), 0), (stem.removesuffix(subject), -1)):
        if rest and rest != stem and _DISTINCT.match(rest[separator]):
            return rest.strip("-_. ")
    return stem


def _parts(folder: Path, path: Path) -> tuple[str, ...]:
    return path.relative_to(folder).parts


def _bids(folder: Path, shapes: Sequence[Path]) -> Cohort | None:
    """Read BIDS derivatives: ``sub-01[/ses-01]/anat/sub-01[_ses-01][_hemi-L][_label-X]_dseg.nii.gz``.

    Files with other entities, or of several kinds and pipelines, are told apart by a pattern.
    """
    matched: list[tuple[Fields, Path]] = []
    kinds = set()
    for path in shapes:
        place = _parts(folder, path)
        *pairs, suffix = stem_of(path).split("_")
        entities = dict(pair.split("-", 1) for pair in pairs if "-" in pair)
        is_surface = path.name.endswith(".surf.gii")
        if not any(part.startswith("sub-") for part in place[:-1]) or "sub" not in entities:
            continue
        if not is_surface and suffix not in ("dseg", "mask"):
            continue
        pipeline = place[: next(index for index, part in enumerate(place) if part.startswith("sub-"))]
        others = {key: value for key, value in entities.items() if key not in ("sub", "ses", "hemi", "label")}
        kinds.add((pipeline, tuple(others.items()), suffix))
        fields = {"subject": f"sub-{entities['sub']}"}
        fields |= {"session": f"ses-{entities['ses']}"} if "ses" in entities else {}
        fields |= {"side": entities["hemi"]} if "hemi" in entities else {}
        fields |= {"structure": entities["label"]} if "label" in entities else {}
        matched.append((fields, path))
    return assembled(folder, matched) if len(kinds) == 1 else None


def _nnunet(folder: Path, shapes: Sequence[Path]) -> Cohort | None:
    """Read nnU-Net's ``labelsTr/CASE.nii.gz``, with ``imagesTr/CASE_0000.nii.gz`` as scan."""
    labels = [path for path in shapes if _parts(folder, path)[0] == _LABELS and path.parent.name == _LABELS]
    if not labels:
        return None
    cohort = assembled(folder, [({"subject": stem_of(path)}, path) for path in labels])
    subjects = []
    for subject in cohort.subjects:
        scan = folder / _IMAGES / f"{subject.name}{_CHANNEL}{suffix_of(subject.path)}"
        subjects.append(replace(subject, image=scan) if scan.is_file() else subject)
    return replace(cohort, subjects=tuple(subjects))


def _totalsegmentator(folder: Path, shapes: Sequence[Path]) -> Cohort | None:
    """Read TotalSegmentator's ``CASE/segmentations/STRUCTURE.nii.gz``, with ``CASE/ct.nii.gz`` as scan."""
    files = [path for path in shapes if _parts(folder, path)[1:-1] == (_SEGMENTATIONS,)]
    if not files:
        return None
    fields = [({"subject": path.parents[1].name, "structure": stem_of(path)}, path) for path in files]
    cohort = assembled(folder, fields)
    subjects = []
    for subject in cohort.subjects:
        places = (subject.path.parent / f"{name}{suffix}" for name in _SCANS for suffix in IMAGE_SUFFIXES)
        subjects.append(replace(subject, image=next((file for file in places if file.is_file()), None)))
    return replace(cohort, subjects=tuple(subjects))


def _flat(folder: Path, shapes: Sequence[Path]) -> Cohort | None:
    """Read one file for each subject in the folder itself, if no file's name contains another subject's."""
    files = [path for path in shapes if path.parent == folder]
    if not files or len(files) < 2 <= len(shapes):
        return None
    by_stem: dict[str, Path] = {}
    for path in files:
        if (first := by_stem.setdefault(stem_of(path), path)) != path:
            raise InputError(
                f"{folder}: {first.name} and {path.name} are two files of {stem_of(path)}; move one of them, "
                f"or use a pattern with its suffix{proposals_text(folder, shapes)}"
            )
    stems = list(by_stem)
    if _extend(stems) or _repeat(stems):
        return None
    further = len(shapes) - len(files)
    note = f"not used: {further} file{'' if further == 1 else 's'} in subfolders"
    matched = [({"subject": stem}, path) for stem, path in zip(stems, files, strict=True)]
    return assembled(folder, matched, [note] if further else [])


def _extend(stems: Sequence[str]) -> bool:
    """Return whether a name is another one with words added: ``case1`` and ``case1_seg``."""
    names = set(stems)
    cuts = ((stem, match.start()) for stem in stems for match in _DISTINCT.finditer(stem))
    return any(stem[:at] in names for stem, at in cuts)


def _repeat(stems: Sequence[str]) -> bool:
    """Return whether most subjects have most of several files, ``p1_left`` and ``p1_right``."""
    split = [_DISTINCT.split(stem) for stem in stems]
    if len({len(each) for each in split}) > 1:
        return False
    for index in range(len(split[0])):
        kinds = {each[index] for each in split}
        owners = {(*each[:index], *each[index + 1 :]) for each in split}
        if min(len(kinds), len(owners)) > 1 and 2 * len(stems) > len(kinds) * len(owners):
            return True
    return False


def _folders(folder: Path, shapes: Sequence[Path]) -> Cohort | None:
    """Read a folder for each subject: with one file, or with one for each structure that most subjects have.

    A single file may lie deeper, as hospitals export series: PATIENT/STUDY/SERIES.
    """
    by_folder: dict[str, list[Path]] = defaultdict(list)
    for path in shapes:
        by_folder[_parts(folder, path)[0]].append(path)
    if any(path.parent == folder for path in shapes):
        return None
    if max(map(len, by_folder.values())) == 1:
        return assembled(folder, [({"subject": name}, path) for name, (path,) in by_folder.items()])
    if any(len(_parts(folder, path)) != 2 for path in shapes):
        return None
    matched = [
        ({"subject": name, "structure": _structure(path, name)}, path)
        for name, files in by_folder.items()
        for path in files
    ]
    structures = {fields["structure"] for fields, _ in matched}
    kinds = {(fields["structure"], suffix_of(path)) for fields, path in matched}
    most = 2 * len(matched) > len(by_folder) * len(structures)
    is_grid = len(by_folder) > 1 and len(kinds) == len(structures) and most
    return assembled(folder, matched) if is_grid else None


_LAYOUTS: tuple[Callable[[Path, Sequence[Path]], Cohort | None], ...] = (
    _bids,
    _nnunet,
    _totalsegmentator,
    _flat,
    _folders,
)
