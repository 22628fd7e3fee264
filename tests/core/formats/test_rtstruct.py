"""Contours of radiotherapy structures."""

import numpy as np
import pytest
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian

from homolog.cohort import Cohort, Subject, read_cohort
from homolog.errors import InputError
from homolog.io.images import read_segmentation, read_volume
from homolog.io.structures import list_structures

RTSTRUCT = "1.2.840.10008.5.1.4.1.1.481.3"
OBLIQUE = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])[:, [2, 0, 1]]


def circle(radius, centre, height, count=90):
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    x, y = radius * np.cos(angles) + centre[0], radius * np.sin(angles) + centre[1]
    return np.column_stack([x, y, np.full(count, height)])


def ball(radius, centre, heights):
    """Return the contours of a ball in slices."""
    widths = {z: np.sqrt(max(radius**2 - (z - centre[2]) ** 2, 0.0)) for z in heights}
    return [circle(width, centre[:2], z) for z, width in widths.items() if width > 0.0]


@pytest.fixture
def write(tmp_path):
    """Return a function that writes structures (name, contours), as treatment planning systems do."""

    def make(structures, name="patient.dcm", kind="CLOSED_PLANAR"):
        content = Dataset()
        content.file_meta = FileMetaDataset()
        content.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
        content.file_meta.MediaStorageSOPClassUID = content.SOPClassUID = RTSTRUCT
        content.file_meta.MediaStorageSOPInstanceUID = content.SOPInstanceUID = "1.2.3"
        content.Modality, content.PatientName = "RTSTRUCT", "Jane"
        content.StructureSetROISequence, content.ROIContourSequence = [], []
        for number, (title, contours) in enumerate(structures, start=1):
            structure, drawn = Dataset(), Dataset()
            structure.ROINumber, structure.ROIName = number, title
            drawn.ReferencedROINumber, drawn.ContourSequence = number, []
            for points in contours:
                contour = Dataset()
                contour.ContourGeometricType, contour.NumberOfContourPoints = kind, len(points)
                contour.ContourData = [f"{value:.4f}" for value in points.ravel()]
                drawn.ContourSequence.append(contour)
            content.StructureSetROISequence.append(structure)
            content.ROIContourSequence.append(drawn)
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        content.save_as(path, enforce_file_format=True)
        return path

    return make


HEIGHTS = np.arange(-30.0, 30.0, 2.5)
HEART = ("Heart", ball(20.0, (5.0, -8.0, 1.0), HEIGHTS))
BODY = ("BODY", [circle(60.0, (0.0, 0.0), z) for z in HEIGHTS])


def centre(segmentation):
    inside = np.argwhere(segmentation.mask).mean(axis=0) * segmentation.spacing
    return segmentation.rotation @ inside + segmentation.origin


@pytest.mark.parametrize("turn", [np.eye(3), OBLIQUE])
def test_a_structure_is_read_by_name_from_where_it_lies(write, turn):
    path = write([(name, [points @ turn.T for points in contours]) for name, contours in (BODY, HEART)])
    assert [segment.name for segment in read_volume(path).segments()] == ["BODY", "Heart"]
    heart = read_segmentation(path, None, "heart")
    assert heart.volume == pytest.approx(4.0 / 3.0 * np.pi * 20.0**3, rel=0.02)
    np.testing.assert_allclose(centre(heart), turn @ [5.0, -8.0, 1.0], atol=0.3)
    assert np.linalg.det(heart.rotation) == pytest.approx(1.0)
    with pytest.raises(InputError, match="overlap"):
        read_segmentation(path, None)


def test_a_contour_within_another_is_a_hole_and_copies_are_drawn_once(write):
    ring = [circle(radius, (0.0, 0.0), z) for z in HEIGHTS for radius in (20.0, 10.0, 20.0)]
    mask = read_segmentation(write([("ring", ring)]), None)
    assert mask.volume == pytest.approx(np.pi * (20.0**2 - 10.0**2) * 2.5 * len(HEIGHTS), rel=0.02)


def test_contours_in_every_other_slice_of_others_are_kept_at_their_distance(write):
    sparse = read_segmentation(write([BODY, ("Heart", HEART[1][::2])]), None, "Heart")
    slices = sparse.mask.any(axis=(0, 1))
    assert sparse.spacing[2] == pytest.approx(2.5)
    assert np.diff(np.flatnonzero(slices)).tolist() == [2] * (slices.sum() - 1)


def test_a_cohort_has_the_contours_of_each_patient_not_the_scan(write, series):
    for name in ("p1", "p2"):
        write([HEART], f"study/{name}/visit/contours/rs.dcm")
        scan = write([HEART], f"study/{name}/visit/scan/1.dcm").parent
        (scan / "1.dcm").write_bytes(next(series.iterdir()).read_bytes())
    root = scan.parents[2]
    subjects = read_cohort(root).subjects
    assert [(subject.name, subject.path.name) for subject in subjects] == [("p1", "rs.dcm"), ("p2", "rs.dcm")]
    assert [subject.image for subject in subjects] == [
        root / name / "visit" / "scan" for name in ("p1", "p2")
    ]


def test_the_scan_of_contours_is_the_series_in_their_folder_or_the_only_one_beside(write, series):
    slice_ = next(series.iterdir()).read_bytes()
    write([HEART], "mixed/p1/rs.dcm").with_name("1.dcm").write_bytes(slice_)
    assert read_cohort(scans := series.parents[1] / "mixed").subjects[0].image == scans / "p1"
    alone = write([HEART], "study/p1/visit/contours/rs.dcm")
    for count, expected in ((0, None), (1, alone.parents[1] / "ct1"), (2, None)):
        if count:
            (alone.parents[1] / f"ct{count}").mkdir()
            (alone.parents[1] / f"ct{count}" / "1.dcm").write_bytes(slice_)
        assert read_cohort(alone.parents[3]).subjects[0].image == expected


TILTED = ("Tilted", [points @ OBLIQUE.T for points in HEART[1]])
UNEVEN = ("Uneven", ball(20.0, (0.0, 0.0, 0.0), [0.0, 2.0, 4.7, 9.3, 11.0]))
BETWEEN = ("Between", ball(20.0, (0.0, 0.0, 0.0), np.arange(-20.9, 20.0, 3.5)))


@pytest.mark.parametrize(
    ("structure", "complaint"),
    [(TILTED, "planes"), (UNEVEN, "unevenly spaced"), (BETWEEN, "slices of others")],
)
def test_a_structure_in_other_slices_does_not_prevent_reading_the_others(write, structure, complaint):
    path = write([structure, BODY, HEART])
    volume = read_volume(path)
    assert [segment.name for segment in volume.segments()] == ["BODY", "Heart"]
    assert read_segmentation(path, None, "heart").volume == pytest.approx(
        read_segmentation(write([BODY, HEART], "without.dcm"), None, "heart").volume
    )
    with pytest.raises(InputError, match=f"contours of {structure[0]} are .*{complaint}"):
        read_segmentation(path, None, structure[0])
    listed = list_structures(Cohort((Subject("p1", path),), path.parent))
    assert [item.name for item in listed.structures] == ["BODY", "Heart"]
    assert not listed.problems
    assert listed.unavailable == tuple(volume.unavailable.values())


def test_structures_of_several_files_that_cannot_be_read_are_listed_once(write):
    subjects = tuple(
        Subject(name, write([UNEVEN, BODY, HEART], f"{name}.dcm")) for name in ("p1", "p2", "p3")
    )
    (message,) = list_structures(Cohort(subjects, subjects[0].path.parent)).unavailable
    assert "p1.dcm: the contours of Uneven" in message
    assert message.endswith("2 more files")


def test_a_structure_that_remains_alone_is_read_with_a_note_on_the_other(write):
    notes = read_segmentation(write([UNEVEN, HEART]), None).notes
    assert any("contours of Uneven" in note for note in notes)


def test_points_and_structures_without_contours_are_ignored(write):
    with pytest.raises(InputError, match="no closed contours"):
        read_volume(write([HEART], kind="POINT"))
    assert [segment.name for segment in read_volume(write([("none", []), HEART])).named] == ["Heart"]


@pytest.mark.parametrize(
    ("structures", "complaint"),
    [
        ([("Heart", HEART[1][:1])], "in one plane"),
        ([UNEVEN], "unevenly spaced"),
        ([("Heart", [np.arange(7.0)])], "export it again"),
        ([("Heart", [circle(1e7, (0.0, 0.0), z) for z in HEIGHTS])], "needs .* GB"),
    ],
)
def test_contours_that_make_no_structure_are_refused(write, structures, complaint, capfd):
    with pytest.raises(InputError, match=complaint):
        read_segmentation(write(structures), None)
    assert "".join(capfd.readouterr()) == ""


def test_a_file_cut_short_is_refused(write):
    path = write([HEART])
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"patient\.dcm"):
        read_segmentation(path, None)
