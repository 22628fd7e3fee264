"""Files of every format, made here, with known content."""

import gzip

import numpy as np
import pytest

SPACES = {"left-posterior-superior": (1, 1, 1), "right-anterior-superior": (-1, -1, 1)}


@pytest.fixture
def blocks():
    """Return labels (I, J, K) with a block of 1 and one of 2, no side of them alike."""
    values = np.zeros((9, 10, 11), np.uint8)
    values[1:3, 2:5, 3:7] = 1
    values[5:8, 6:8, 2:9] = 2
    return values


@pytest.fixture
def points():
    """Return a function that gives the positions [LPS] of a segmentation's voxels, sorted."""

    def of(segmentation, unit=1.0):
        inside = np.argwhere(segmentation.mask) * segmentation.spacing
        found = (inside @ segmentation.rotation.T + segmentation.origin) / unit
        return found[np.lexsort(np.round(found, 1).T)]

    return of


@pytest.fixture
def write_nrrd(tmp_path):
    """Write a NRRD file by hand: layers (I, J, K) or (L, I, J, K), encoding, further header lines."""

    def write(name, layers, lines=(), *, encoding="raw", space="left-posterior-superior", data_file=None):
        layered = layers.ndim == 4
        sizes = " ".join(map(str, layers.shape))
        header = [
            "NRRD0004", "type: uchar", f"dimension: {layers.ndim}", f"space: {space}", f"sizes: {sizes}",
            f"space directions: {'none ' * layered}(1,0,0) (0,2,0) (0,0,3)",
            f"kinds: {'list ' * layered}domain domain domain", f"encoding: {encoding}",
            "space origin: (5,-6,7)", *([f"data file: {data_file}"] if data_file else []), *lines,
        ]  # fmt: skip
        body = layers.tobytes(order="F")
        body = gzip.compress(body) if encoding == "gzip" else body
        path = tmp_path / name
        path.write_bytes("\n".join(header).encode() + b"\n\n" + (b"" if data_file else body))
        return path

    return write


@pytest.fixture
def named():
    """Return the header lines with which 3D Slicer names segments: (name, value, layer) of each."""

    def lines(*segments):
        return [
            line
            for number, (name, value, layer) in enumerate(segments)
            for line in (
                f"Segment{number}_ID:=Segment_{number}",
                f"Segment{number}_Name:={name}",
                f"Segment{number}_LabelValue:={value}",
                f"Segment{number}_Layer:={layer}",
            )
        ]

    return lines
