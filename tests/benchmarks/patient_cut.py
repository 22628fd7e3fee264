"""How much of a shape that the border of its image cuts off is said to be missing.

    python tests/benchmarks/patient_cut.py REFERENCE FOLDER [--share 0.25] [--subjects 4]

FOLDER contains segmentations of whole, healthy subjects who are not among the controls of REFERENCE. The
image of each is cut at a plane across one of its axes such that the given share of the whole surface lies
beyond, at each of six sides. Prints a table in Markdown: share that lies beyond; share that is said to be
missing (- where the shape is not recognised as cut off); distance of the whole surface's part beyond from the
expected surface; size over that of the whole subject; regions beyond the limit.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from homolog.cohort import read_cohort
from homolog.geometry import inverse_matrices, transform_points
from homolog.grooming import GroomedSubject
from homolog.grooming.subject import groom, read_source
from homolog.io.volumes import Segmentation
from homolog.patient import Reference, compare_groomed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reference", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--share", type=float, default=0.25)
    parser.add_argument("--subjects", type=int, default=4)
    arguments = parser.parse_args()
    reference = replace(Reference.load(arguments.reference), placing=None)
    settings = reference.provenance.groom
    print("| subject | side | cut off (%) | said to be missing (%) | off by (mm) | size | regions |")
    print("|---|---|---|---|---|---|---|")
    for subject in read_cohort(arguments.folder).subjects[: arguments.subjects]:
        source = read_source(subject, settings)
        assert isinstance(source, Segmentation), subject.path
        whole = groom(subject.name, source, settings)
        print(line(reference, "whole", whole, whole, np.zeros(len(whole.mesh.vertices), bool)))
        for axis, letter in enumerate("ijk"):
            for side in (-1, 1):
                image, beyond = cut(source, whole, axis, side, arguments.share)
                part = groom(subject.name, image, settings)
                text = f"{'-' if side < 0 else '+'}{letter}"
                print(line(reference, text, part, whole, beyond), flush=True)


def cut(
    source: Segmentation, whole: GroomedSubject, axis: int, side: int, share: float
) -> tuple[Segmentation, np.ndarray]:
    """Return the image without what lies beyond a plane, and the vertices that do."""
    along = (whole.mesh.vertices - source.origin) @ source.rotation[:, axis] / source.spacing[axis]
    areas = whole.mesh.vertex_areas
    order = np.argsort(-side * along)
    level = along[order[np.searchsorted(np.cumsum(areas[order]), share * areas.sum())]]
    first, last = 0, source.mask.shape[axis]
    if side < 0:
        first = round(level + 0.5)
        beyond = along < first - 0.5
    else:
        last = round(level + 0.5)
        beyond = along > last - 0.5
    kept = tuple(slice(first, last) if item == axis else slice(None) for item in range(3))
    origin = source.origin + first * source.spacing[axis] * source.rotation[:, axis]
    return replace(source, mask=source.mask[kept], origin=origin), beyond


def line(
    reference: Reference, side: str, part: GroomedSubject, whole: GroomedSubject, beyond: np.ndarray
) -> str:
    areas = whole.mesh.vertex_areas
    share = 100.0 * areas[beyond].sum() / areas.sum()
    result, usual = (compare_groomed(reference, item, force=True) for item in (part, whole))
    said = [remark for remark in result.remarks if "surface is missing" in remark]
    number = said[0].split(" %")[0].split()[-1] if said else "-"
    expected = transform_points(inverse_matrices(result.placement), result.expected.vertices)
    off = np.asarray(KDTree(expected).query(whole.mesh.vertices[beyond])[0]).mean() if beyond.any() else 0.0
    size = result.measures.size / usual.measures.size
    return (
        f"| {part.name} | {side} | {share:.1f} | {number} | {off:.2f} | {size:.3f} | {len(result.regions)} |"
    )


if __name__ == "__main__":
    main()
