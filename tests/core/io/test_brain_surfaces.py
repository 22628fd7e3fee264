"""GIFTI, FreeSurfer's surfaces and OFF, as nibabel and trimesh write them."""

import nibabel
import numpy as np
import pytest
import trimesh
from nibabel.freesurfer import write_geometry
from nibabel.gifti import GiftiCoordSystem, GiftiDataArray, GiftiImage

from homolog.errors import InputError
from homolog.io.meshes import read_mesh

BALL = trimesh.creation.icosphere(subdivisions=2, radius=30.0)
POINTS = BALL.vertices * [1.0, 1.5, 0.8]
TO_LPS = [-1.0, -1.0, 1.0]
CORONAL = ((-1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
TILTED = ((-1.0, 0.0, 0.0), (0.0, 0.6, -0.8), (0.0, 0.8, 0.6))
AXIAL_LEFT_HANDED = ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def freesurfer(path, axes, *, valid="1  # volume info valid", in_scanner=False):
    about = {"head": [2, 0, 20], "valid": valid, "filename": "T1.mgz", "volume": [256, 200, 160]}
    about |= {"voxelsize": [1.0, 1.0, 1.2], **dict(zip(("xras", "yras", "zras"), axes, strict=True))}
    write_geometry(path, POINTS, BALL.faces, "by a test", about | {"cras": [5.0, -7.0, 11.0]})
    if in_scanner:  # which nibabel does not write
        tags = [np.array([2, flag, 20], ">i4").tobytes() for flag in (0, 1)]
        path.write_bytes(path.read_bytes().replace(*tags))
    return read_mesh(path)


def gifti(path, *, matrix=None, space="NIFTI_XFORM_UNKNOWN", encoding="B64GZ", order="C"):
    system = GiftiCoordSystem(space, "NIFTI_XFORM_SCANNER_ANAT", np.eye(4) if matrix is None else matrix)
    points = GiftiDataArray(
        POINTS.astype("f4"), "NIFTI_INTENT_POINTSET", coordsys=system, encoding=encoding, ordering=order
    )
    faces = GiftiDataArray(BALL.faces.astype("i4"), "NIFTI_INTENT_TRIANGLE", encoding=encoding)
    GiftiImage(darrays=[points, faces]).to_filename(path)
    return read_mesh(path)


@pytest.mark.parametrize("axes", [CORONAL, TILTED, AXIAL_LEFT_HANDED])
def test_freesurfer_surfaces_lie_where_their_volume_lies(tmp_path, axes):
    volume = nibabel.freesurfer.MGHImage(np.zeros((256, 200, 160), "u1"), np.eye(4))
    volume.header["Mdc"], volume.header["Pxyz_c"] = np.array(axes), (5.0, -7.0, 11.0)
    volume.header["delta"] = (1.0, 1.0, 1.2)
    to_scanner = volume.header.get_vox2ras() @ np.linalg.inv(volume.header.get_vox2ras_tkr())
    expected = nibabel.affines.apply_affine(to_scanner, POINTS) * TO_LPS
    assert freesurfer(tmp_path / "lh.pial", axes).vertices == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("changes", [{"in_scanner": True}, {"valid": "0"}])
def test_freesurfer_surfaces_in_scanner_coordinates_or_of_no_volume_stay(tmp_path, changes):
    result = freesurfer(tmp_path / "sub_rh.white", TILTED, **changes)
    assert result.vertices == pytest.approx(POINTS * TO_LPS, abs=1e-4)


@pytest.mark.parametrize("encoding", ["ASCII", "B64BIN", "B64GZ"])
def test_gifti_matrices_lead_to_the_scanner(tmp_path, encoding):
    matrix = np.eye(4)
    matrix[:3, 3] = 5.0, -7.0, 11.0
    result = gifti(tmp_path / "a.surf.gii", matrix=matrix, encoding=encoding)
    assert result.vertices == pytest.approx((POINTS + matrix[:3, 3]) * TO_LPS, abs=1e-4)
    placed = gifti(tmp_path / "b.gii", matrix=matrix, space="NIFTI_XFORM_SCANNER_ANAT", order="F")
    assert placed.vertices == pytest.approx(POINTS * TO_LPS, abs=1e-4)


def test_off_files_with_comments_polygons_and_colours_are_read(tmp_path):
    path = tmp_path / "cube.off"
    cube = trimesh.creation.box()
    quads = "4 0 1 3 2 1 0 0\n4 4 6 7 5\n4 0 4 5 1\n4 2 3 7 6\n4 0 2 6 4\n4 1 5 7 3\n"
    points = "\n".join(" ".join(map(str, point)) for point in cube.vertices)
    path.write_text(f"# made by hand\nCOFF\n\n8 6 12  # counts\n{points}\n{quads}")
    result = read_mesh(path)
    assert len(result.faces) == 12
    assert abs(result.volume) == pytest.approx(1.0)
    path.write_text(cube.export(file_type="off"))
    assert read_mesh(path).volume == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["lh.pial", "a.gii", "a.off"])
def test_truncated_files_are_refused(tmp_path, name):
    path = tmp_path / name
    if name == "lh.pial":
        freesurfer(path, CORONAL)
    elif name == "a.gii":
        gifti(path)
    else:
        path.write_text(BALL.export(file_type="off"))
    path.write_bytes(path.read_bytes()[:-2000])
    with pytest.raises(InputError, match=name):
        read_mesh(path)


def test_a_surface_of_amira_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "bone.surf"
    path.write_bytes(b"# HyperSurface 0.1 BINARY\n\nVertices 0\n")
    with pytest.raises(InputError, match=r"bone\.surf: .*Amira; save it as STL"):
        read_mesh(path)
