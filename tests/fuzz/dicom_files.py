"""Good DICOM files to begin from: a series of slices, segmentation objects, and contours."""

import shutil
from pathlib import Path

import numpy as np

__all__ = ["good_contours", "good_deflated_seg", "good_seg", "good_series"]


def good_series(folder: Path) -> None:
    """A label map of six slices."""
    import SimpleITK

    (folder / "series").mkdir()
    writer = SimpleITK.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for number in range(6):
        image = SimpleITK.GetImageFromArray(np.full((1, 8, 9), 3 - number // 2, np.uint8))
        tags = {
            "0008|0060": "OT",
            "0020|000d": "1.2.3",
            "0020|000e": "1.2.4",
            "0008|0018": f"1.2.4.{number + 1}",
            "0020|0032": f"0\\0\\{number}",
            "0020|0037": "1\\0\\0\\0\\1\\0",
            "0020|0013": str(number),
        }
        for key, value in tags.items():
            image.SetMetaData(key, value)
        writer.SetFileName(folder / "series" / f"{number}.dcm")
        writer.Execute(image)


def good_seg(folder: Path) -> None:
    """A segmentation object over that label map."""
    import highdicom
    import pydicom
    from pydicom.sr.codedict import codes

    good_series(folder)
    sources = [pydicom.dcmread(path) for path in sorted((folder / "series").iterdir())]
    shutil.rmtree(folder / "series")
    for source in sources:
        for name in ("PatientName", "PatientBirthDate", "PatientSex", "StudyDate", "StudyTime", "StudyID"):
            setattr(source, name, "")
        source.PatientID = source.AccessionNumber = source.ReferringPhysicianName = ""
        source.FrameOfReferenceUID, source.SliceThickness, source.PixelSpacing = "1.2.9", 1.0, [1.0, 1.0]
    organ = highdicom.seg.SegmentDescription(1, "all", codes.SCT.Organ, codes.SCT.Liver, "MANUAL")
    highdicom.seg.Segmentation(
        sources, np.ones((6, 8, 9), np.uint8), "BINARY", [organ], "1.2.5", 1, "1.2.5.1", 1, "m", "m", "1", "1"
    ).save_as(folder / "a.dcm")


def good_deflated_seg(folder: Path) -> None:
    """The same, deflated as a whole."""
    import pydicom
    from pydicom.uid import DeflatedExplicitVRLittleEndian

    good_seg(folder)
    content = pydicom.dcmread(folder / "a.dcm")
    content.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    content.save_as(folder / "deflated.dcm", implicit_vr=False, little_endian=True)
    (folder / "a.dcm").unlink()


def good_contours(folder: Path) -> None:
    """A prism as the contours of a radiotherapy structure."""
    from pydicom.dataset import Dataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian

    content, structure, drawn = Dataset(), Dataset(), Dataset()
    content.file_meta = FileMetaDataset()
    content.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    content.SOPClassUID = content.file_meta.MediaStorageSOPClassUID = "1.2.840.10008.5.1.4.1.1.481.3"
    content.SOPInstanceUID = content.file_meta.MediaStorageSOPInstanceUID = "1.2.3"
    structure.ROINumber, structure.ROIName, drawn.ReferencedROINumber = 1, "all", 1
    drawn.ContourSequence = []
    for height in range(0, 18, 3):
        contour = Dataset()
        contour.ContourGeometricType, contour.NumberOfContourPoints = "CLOSED_PLANAR", 4
        corners = ((0, 0), (9, 0), (9, 8), (0, 8))
        contour.ContourData = [value for corner in corners for value in (*corner, height)]
        drawn.ContourSequence.append(contour)
    content.StructureSetROISequence, content.ROIContourSequence = [structure], [drawn]
    content.save_as(folder / "contours.dcm", enforce_file_format=True)
