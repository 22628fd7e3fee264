"""Files that are not read as they are, and what a user can do with them."""

from collections import Counter
from pathlib import Path

from homolog.cohort.entries import notes_on_skipped
from homolog.cohort.subject import IMAGE_SUFFIXES, MESH_SUFFIXES, suffix_of

__all__ = ["contents_of", "remedy_for"]

_UNPACK = "unpack the archives"
_FROM_ARRAYS = "save them as NIfTI with their voxel size, or pass them to homolog.correspond in Python"
_SLICER = "save the segmentation as .seg.nrrd in 3D Slicer"
_SURFACES = "export label maps as NRRD or NIfTI, or surfaces as STL or PLY"
_REMEDIES = {
    **dict.fromkeys((".zip", ".tar", ".tgz", ".tar.gz", ".tar.bz2", ".tar.xz", ".7z", ".rar"), _UNPACK),
    **dict.fromkeys((".nii.bz2", ".nii.xz", ".nii.zip", ".bz2", ".xz"), _UNPACK),
    **dict.fromkeys((".mrb", ".mrml"), _SLICER),
    **dict.fromkeys((".npy", ".npz", ".mat", ".h5", ".hdf5", ".pkl", ".pt", ".zarr"), _FROM_ARRAYS),
    **dict.fromkeys((".am", ".hx", ".mcs", ".mxp", ".3dm", ".blend", ".step", ".stp", ".igs"), _SURFACES),
    **dict.fromkeys((".fbx", ".dae", ".wrl", ".x3d", ".ctm", ".iv", ".asc", ".xyz"), _SURFACES),
    **dict.fromkeys((".mnc", ".mnc2"), "convert them to NIfTI with mnc2nii"),
    **dict.fromkeys((".vti", ".vts", ".vtr"), "save label maps as .mhd in ParaView or as .nrrd in 3D Slicer"),
    **dict.fromkeys((".vtm", ".vtmb"), "keep them with the folders of their parts, or save .vtp in ParaView"),
    **dict.fromkeys((".jpg", ".jpeg", ".gif"), "export label maps, or slices as PNG or TIFF"),
    ".img": "put their headers (.hdr) next to them",
    **dict.fromkeys((".raw", ".zraw"), "put their headers (.mhd or .nhdr) next to them"),
    ".swproj": "run the ShapeWorks project itself: homolog run FILE.swproj",
    ".itksnap": "save the segmentation as NIfTI in ITK-SNAP",
    **dict.fromkeys((".particles", ".lpts", ".wpts"), "import the particles: homolog import"),
}
"""What to do with files of other types, by suffix."""
_OTHERS = "convert them to one of the known types"
_NAMED = 5
"""Largest number of types in a message."""


def remedy_for(path: Path) -> str:
    """Return what to do with a file that is no segmentation or mesh; empty if its type is unknown."""
    return _REMEDIES.get(_suffix(path), "")


def contents_of(folder: Path) -> str:
    """Return a clause on the files of other types in a folder, what to do with them, and the known types."""
    others = Counter(
        suffix
        for pattern in ("*", "*/*", "*/*/*")
        for file in folder.glob(pattern)
        if (suffix := _suffix(file)) and file.name[0] != "." and file.is_file()
    ).most_common(_NAMED)
    contents = ""
    if others:
        remedies = dict.fromkeys(item for suffix, _ in others if (item := _REMEDIES.get(suffix)))
        listed = ", ".join(f"{suffix} ({count})" for suffix, count in others)
        contents = f"; it contains {listed}; {'; '.join(remedies) or _OTHERS}"
    contents += "".join(f"; {note}" for note in notes_on_skipped(folder))
    known = f"{', '.join(IMAGE_SUFFIXES + MESH_SUFFIXES)} and folders of DICOM files"
    return f"{contents}; known files are {known}"


def _suffix(path: Path) -> str:
    """Return a file's suffix, or the last two of a packed one: ``.tar.gz``."""
    name = path.name.lower()
    two = [item for item in _REMEDIES if item.count(".") > 1 and name.endswith(item)]
    return two[0] if two else suffix_of(path)
