"""Files of every format, made here, with known content."""

import gzip

import numpy as np
import pytest
import SimpleITK

TURN = np.array(
    [[0.8, 0.6, 0.0], [0.6, -0.8, 0.0], [0.0, 0.0, -1.0]]
)  # columns: along x, y and z of the grid
SPACING, ORIGIN = np.array([1.5, 2.0, 3.0]), np.array([5.0, -6.0, 7.0])
SPACES = {"left-posterior-superior": (1, 1, 1), "right-anterior-superior": (-1, -1, 1)}


@pytest.fixture
def blocks():
    """Return labels (I, J, K) with a block of 1 and one of 2 that touch, no side of them alike."""
    values = np.zeros((9, 10, 11), np.uint8)
    values[3:5, 3:6, 3:7] = 1
    values[5:8, 6:8, 2:9] = 2
    return values


@pytest.fixture
def points():
    """Return a function that gives the positions [LPS] of a segmentation's voxels, sorted."""

    def of(segmentation, unit=1.0):
        inside = np.argwhere(segmentation.mask) * segmentation.spacing
        result = (inside @ segmentation.rotation.T + segmentation.origin) / unit
        return result[np.lexsort(np.round(result, 1).T)]

    return of


@pytest.fixture
def write_nrrd(tmp_path):
    """Write a NRRD file by hand: layers (I, J, K) or (L, I, J, K), encoding, further header lines."""

    def write(name, layers, lines=(), *, encoding="raw", space="left-posterior-superior", data_file=None):
        layered = layers.ndim == 4
        sizes = " ".join(map(str, layers.shape))
        header = [
            "NRRD0004",
            "type: uchar",
            f"dimension: {layers.ndim}",
            f"space: {space}",
            f"sizes: {sizes}",
            f"space directions: {'none ' * layered}(1,0,0) (0,2,0) (0,0,3)",
            f"kinds: {'list ' * layered}domain domain domain",
            f"encoding: {encoding}",
            "space origin: (5,-6,7)",
            *([f"data file: {data_file}"] if data_file else []),
            *lines,
        ]
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


@pytest.fixture
def expected():
    """Return a function that gives where the voxels of a value lie [LPS] in the DICOM files, sorted."""

    def of(blocks, value=None):
        inside = np.argwhere(blocks > 0 if value is None else blocks == value)
        result = inside * SPACING @ TURN.T + ORIGIN
        return result[np.lexsort(np.round(result, 1).T)]

    return of


@pytest.fixture
def series(blocks, tmp_path):
    """Return a folder with one DICOM file a slice, in an order that their names don't tell."""
    folder = tmp_path / "cohort" / "patient"
    folder.mkdir(parents=True)
    write_slices(folder, blocks, "1.2.3.4")
    return folder


def write_slices(folder, blocks, uid):
    """Write a label map of oblique axes as the slices of a series."""
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for k in range(blocks.shape[2]):
        image = SimpleITK.GetImageFromArray(blocks[:, :, k].T[None])
        image.SetSpacing(SPACING.tolist())
        place = ORIGIN + TURN[:, 2] * SPACING[2] * k
        tags = {
            "0008|0060": "OT",
            "0020|000d": "1.2.3",
            "0020|000e": uid,
            "0008|0018": f"{uid}.{k + 1}",
            "0020|0032": "\\".join(map(str, place)),
            "0020|0013": str(k),
            "0020|0037": "\\".join(map(str, [*TURN[:, 0], *TURN[:, 1]])),
            "0010|0010": "Doe^Jane",
        }
        for key, value in tags.items():
            image.SetMetaData(key, value)
        writer.SetFileName(folder / f"{uid}_{(7 * k) % 11:02d}.dcm")
        writer.Execute(image)


@pytest.fixture
def write_series():
    """Return a function that writes a further series: folder, labels, its number."""
    return write_slices


def rewritten(path, edit):
    import pydicom

    content = pydicom.dcmread(path)
    edit(content)
    uid = content.file_meta.TransferSyntaxUID
    how = {"implicit_vr": uid.is_implicit_VR, "little_endian": uid.is_little_endian}
    pydicom.dcmwrite(path, content, force_encoding=True, **how)


@pytest.fixture
def each():
    """Return a function that changes every slice of a folder."""

    def change(series, edit):
        for path in sorted(series.iterdir()):
            rewritten(path, edit)

    return change


@pytest.fixture
def make_seg(series, tmp_path):
    """Return a function that writes a DICOM SEG over the series: masks (K, J, I[, 2]), type, what else."""
    import highdicom as hd
    import pydicom
    from pydicom.sr.codedict import codes

    sources = [pydicom.dcmread(item) for item in sorted(series.iterdir())]
    for entry in sources:
        entry.FrameOfReferenceUID, entry.PatientID, entry.StudyID = "1.2.9", "p", "s"
        for name in ("PatientBirthDate", "PatientSex", "StudyDate", "StudyTime", "AccessionNumber"):
            setattr(entry, name, "")
        entry.ReferringPhysicianName, entry.SliceThickness, entry.PixelSpacing = "", 3.0, [2.0, 1.5]
    sources.sort(key=lambda source: int(source.InstanceNumber))
    descriptions = [
        hd.seg.SegmentDescription(
            segment_number=number,
            segment_label=name,
            algorithm_type="MANUAL",
            segmented_property_category=codes.SCT.Organ,
            segmented_property_type=codes.SCT.Liver,
        )
        for number, name in enumerate(("heart", "both"), start=1)
    ]

    def make(masks, kind="BINARY", edit=None, **how):
        made = hd.seg.Segmentation(
            sources, masks, kind, descriptions, "1.2.5", 1, "1.2.5.1", 1, "maker", "model", "1", "1", **how
        )
        path = tmp_path / "seg" / "a.dcm"
        path.parent.mkdir(exist_ok=True)
        made.save_as(path)
        if edit is not None:
            rewritten(path, edit)
        return path

    return make
