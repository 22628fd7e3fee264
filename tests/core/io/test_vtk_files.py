"""Surfaces as VTK's own writers leave them, in each of their ways, and damaged ones."""

import zlib

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.io.meshes import read_mesh

CORNERS = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2]]
SIDES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6]]
LAST = [0, 4, 7], [0, 7, 3]


@pytest.fixture
def cube():
    """Return a box of quads, two triangles and values of many kinds, as VTK has it."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkBitArray, vtkPoints, vtkStringArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

    points, cells, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
    points.SetData(numpy_to_vtk(np.array(CORNERS, np.float32), deep=True))
    for face in (*SIDES, *LAST):
        cells.InsertNextCell(len(face), face)
    surface.SetPoints(points)
    surface.SetPolys(cells)
    for name, text in (("SPACE", "RAS"), ("note", "a text of more than sixty-three letters " * 3)):
        texts = vtkStringArray()
        texts.SetName(name)
        texts.InsertNextValue(text)
        surface.GetFieldData().AddArray(texts)
    bits = vtkBitArray()
    bits.SetName("bits")
    for number in range(11):
        bits.InsertNextValue(number % 2)
    surface.GetFieldData().AddArray(bits)
    for dtype in ("u1", "i2", "i4", "i8", "f4", "f8"):
        array = numpy_to_vtk(np.arange(6, dtype=dtype).reshape(3, 2), deep=True)
        array.SetName(f"a {dtype}")
        array.SetComponentName(0, "first")
        surface.GetFieldData().AddArray(array)
    values = numpy_to_vtk(np.arange(8.0), deep=True)
    values.SetName("values")
    surface.GetPointData().SetScalars(values)
    return surface


def check(mesh):
    assert sorted(map(tuple, mesh.vertices)) == sorted((-x, -y, z) for x, y, z in CORNERS)
    assert mesh.volume == pytest.approx(8.0)
    assert len(mesh.faces) == 12


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("binary", [False, True])
def test_legacy_files_of_every_kind_are_read(cube, tmp_path, version, binary):
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

    writer = vtkPolyDataWriter(file_name=str(tmp_path / "a.vtk"), input_data=cube)
    writer.SetFileVersion(version)
    writer.SetFileType(2 if binary else 1)
    assert writer.Write()
    check(read_mesh(tmp_path / "a.vtk"))


@pytest.mark.parametrize("mode", ["SetDataModeToAscii", "SetDataModeToBinary", "SetDataModeToAppended"])
@pytest.mark.parametrize("compressor", [None, "ZLib", "LZMA", "LZ4"])
@pytest.mark.parametrize("order", ["Little", "Big"])
@pytest.mark.parametrize("encoded", [False, True])
@pytest.mark.parametrize("header", [32, 64])
def test_xml_files_of_every_kind_are_read(cube, tmp_path, mode, compressor, order, encoded, header):
    from vtkmodules import vtkIOCore
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter(file_name=str(tmp_path / "a.vtp"), input_data=cube)
    getattr(writer, mode)()
    getattr(writer, f"SetByteOrderTo{order}Endian")()
    getattr(writer, f"SetHeaderTypeToUInt{header}")()
    writer.SetEncodeAppendedData(encoded)
    writer.SetCompressor(getattr(vtkIOCore, f"vtk{compressor}DataCompressor")() if compressor else None)
    writer.SetBlockSize(32)  # several blocks, the last one shorter
    assert writer.Write()
    check(read_mesh(tmp_path / "a.vtp"))


def test_pieces_are_put_together(tmp_path):
    piece = (
        '<Piece NumberOfPoints="3" NumberOfPolys="1"><Points><DataArray type="Float32" format="ascii">{}'
        '</DataArray></Points><Polys><DataArray type="Int32" Name="connectivity" format="ascii">0 1 {}'
        '</DataArray><DataArray type="Int32" Name="offsets" format="ascii">3</DataArray></Polys></Piece>'
    )
    whole = '<VTKFile type="PolyData"><PolyData>{}</PolyData></VTKFile>'
    pieces = [piece.format(f"{x} 0 0 {x + 1} 0 0 {x} 1 0", 2) for x in (0, 5)]
    (tmp_path / "a.vtp").write_text(whole.format("".join(pieces)))
    mesh = read_mesh(tmp_path / "a.vtp")
    assert sorted(mesh.vertices[:, 0]) == [0, 0, 1, 5, 5, 6]
    assert mesh.area == pytest.approx(1.0)
    (tmp_path / "a.vtp").write_text(whole.format(pieces[0].replace("0 1 2", "0 1 3") + pieces[1]))
    with pytest.raises(InputError, match="refers to vertices"):
        read_mesh(tmp_path / "a.vtp")


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("binary", [False, True])
def test_strips_become_triangles_of_one_orientation(tmp_path, version, binary):
    from vtkmodules.vtkFiltersCore import vtkStripper, vtkTriangleFilter
    from vtkmodules.vtkFiltersSources import vtkSphereSource
    from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

    ball = vtkSphereSource(radius=10.0, theta_resolution=24, phi_resolution=12)
    triangles = vtkTriangleFilter(input_connection=ball.GetOutputPort())
    strips = vtkStripper(input_connection=triangles.GetOutputPort())
    strips.Update()
    assert strips.GetOutput().GetNumberOfStrips()
    writer = vtkPolyDataWriter(file_name=str(tmp_path / "a.vtk"), input_data=strips.GetOutput())
    writer.SetFileVersion(version)
    writer.SetFileType(2 if binary else 1)
    writer.Write()
    mesh = read_mesh(tmp_path / "a.vtk")
    assert len(mesh.faces) == triangles.GetOutput().GetNumberOfPolys()
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 1000.0, rel=0.05)


CELLS = (10, 11, 12, 13, 14, 24, 25, 26, 27, 29, 71, 72, 73)


@pytest.fixture(params=[*CELLS, 5, 8, 9, 22, 23], ids=lambda kind: f"type {kind}")
def grid(request):
    """Return cells of one type, three along each axis, as VTK's own source has them, and the area."""
    from vtkmodules.vtkFiltersSources import vtkCellTypeSource

    source = vtkCellTypeSource(cell_type=request.param)
    source.SetBlocksDimensions(3, 3, 3)
    source.Update()
    return source.GetOutput(), 54.0 if request.param in CELLS else 9.0


def check_surface(mesh, area):
    assert mesh.area == pytest.approx(area)
    sides = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    uses = np.unique(sides, axis=0, return_counts=True)[1]
    assert area < 54.0 or (uses == 2).all()


@pytest.mark.parametrize("version", [42, 51])
def test_volume_cells_of_legacy_files_become_their_surface(grid, tmp_path, version):
    from vtkmodules.vtkIOLegacy import vtkUnstructuredGridWriter

    cells, area = grid
    writer = vtkUnstructuredGridWriter(file_name=str(tmp_path / "a.vtk"), input_data=cells)
    writer.SetFileVersion(version)
    assert writer.Write()
    check_surface(read_mesh(tmp_path / "a.vtk"), area)


def test_volume_cells_of_xml_files_become_their_surface(grid, tmp_path):
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    cells, area = grid
    assert vtkXMLUnstructuredGridWriter(file_name=str(tmp_path / "a.vtu"), input_data=cells).Write()
    check_surface(read_mesh(tmp_path / "a.vtu"), area)


GRID = (
    "# vtk DataFile Version 3.0\nby hand\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 int 0 0 0 1 0 0 0 1 0\n"
)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ("CELLS 1 4 3 0 1 2\nCELL_TYPES 1 42\n", "cells of the types 42 are not supported"),
        ("CELLS 1 4 3 0 1 2\nCELL_TYPES 1 10\n", "cells with too few corners"),
        ("CELLS 1 4 3 0 1 3\nCELL_TYPES 1 5\n", "refers to vertices"),
        ("CELLS 1 4 3 0 1 2\n", "cells without a type"),
    ],
)
def test_cells_that_make_no_sense_are_refused_with_the_reason(tmp_path, part, message):
    (tmp_path / "a.vtk").write_text(GRID + part)
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "a.vtk")


HEAD = "# vtk DataFile Version 3.0\nby hand\nASCII\nDATASET POLYDATA\n"


@pytest.mark.parametrize(
    "content",
    [
        HEAD + "POINTS 3 float\n0 0 0 1 0 0\n0 1 0\nPOLYGONS 1 4\n3 0 1 2\nMETADATA\nINFORMATION 0\n\n",
        "# vtk DataFile Version 2.0\nby hand\r\nascii\r\ndataset polydata"
        "\r\npoints 3 double\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\nlines 1 3 2 0 1\r\npolygons 1 4\r\n3 0 1 2\r\n",
        HEAD + "FIELD FieldData 1\nmeta 1 1 int\n3\nMETADATA\nCOMPONENT_NAMES\nx\n\nPOINTS 3 int 0 0 0 1 0 0 "
        "0 1 0 VERTICES 1 2 1 0 POLYGONS 1 4 3 0 1 2\nCELL_DATA 1\nwhatever comes then",
    ],
)
def test_legacy_files_written_by_hand_are_read(tmp_path, content):
    (tmp_path / "a.vtk").write_bytes(content.encode())
    assert read_mesh(tmp_path / "a.vtk").area == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ("FIELD f 1\nSPACE 1 1 ", "unknown kind ''"),
        ("FIELD f 99999999999\n", "more values than it can contain"),
        ("FIELD f 1\nx 4 -1 int\n", "more values than it can contain"),
        ("FIELD f 1\nx 1 1 variant\n0 3\n", "unknown kind 'variant'"),
        ("POINTS 1 float\n0 0 x\n", "could not convert"),
        ("POINTS 9 float\n0 0 1\n", "cut short"),
        ("POLYGONS 2 4\n3 0 1 2\n", "inconsistent faces"),
        ("POLYGONS 1 4\n-3 0 1 2\n", "inconsistent faces"),
        ("SCALARS a float\n", "unknown part 'scalars'"),
        ("POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 3\n", "refers to vertices"),
    ],
)
def test_legacy_files_that_make_no_sense_are_refused_with_the_reason(tmp_path, part, message):
    (tmp_path / "a.vtk").write_text(HEAD + part)
    with pytest.raises(InputError, match=rf"a\.vtk: can't be read .*{message}"):
        read_mesh(tmp_path / "a.vtk")


def test_a_volume_in_a_legacy_file_is_no_surface(tmp_path):
    (tmp_path / "a.vtk").write_text(HEAD.replace("POLYDATA", "STRUCTURED_POINTS") + "DIMENSIONS 2 2 2\n")
    with pytest.raises(InputError, match="not a surface"):
        read_mesh(tmp_path / "a.vtk")


XML = (
    '<VTKFile type="PolyData" byte_order="LittleEndian" header_type="UInt64" '
    'compressor="vtkZLibDataCompressor"><PolyData><Piece NumberOfPoints="{}" NumberOfPolys="1"><Points>'
    '<DataArray type="Float64" format="appended" offset="0"/></Points></Piece></PolyData>'
    '<AppendedData encoding="raw">_'
)


@pytest.mark.parametrize(
    ("points", "header", "message"),
    [
        (1000, (1, 2**40, 0), "does not match its points"),
        (1000, (2**40, 24, 0), "claims more blocks than it can contain"),
        (2**60, (1, 24, 24), "claims more points or faces than it can contain"),
        (10**7, (1, 24 * 10**7, 0), "claims more points or faces than it can contain"),
        (1000, (1, 24000, 0), "cut short"),
    ],
)
def test_an_xml_file_that_lies_is_refused_before_it_is_unpacked(tmp_path, points, header, message):
    body = zlib.compress(bytes(20000))
    stored = np.array([*header, len(body)], "<u8").tobytes() + body
    (tmp_path / "a.vtp").write_bytes(XML.format(points).encode() + stored + b"</AppendedData></VTKFile>")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "a.vtp")


def test_an_xml_file_with_entities_is_refused(tmp_path):
    (tmp_path / "a.vtp").write_text('<!DOCTYPE a [<!ENTITY b "bbbb">]>' + XML.format(3))
    with pytest.raises(InputError, match="a document type"):
        read_mesh(tmp_path / "a.vtp")


@pytest.mark.timeout(30)
def test_a_hundred_thousand_small_arrays_are_read_over_at_once(tmp_path):
    """What is left of the file must not be copied for each."""
    fields = "FIELD f 100000\n" + "a 1 1 int\n7\n" * 100_000
    surface = "POINTS 3 float\n0 0 0 1 0 0 0 1 0\nPOLYGONS 1 4\n3 0 1 2\n"
    (tmp_path / "a.vtk").write_text(HEAD + fields + surface)
    assert read_mesh(tmp_path / "a.vtk").area == pytest.approx(0.5)


def test_pieces_that_all_unpack_one_array_are_refused_before_memory_is_full(tmp_path, monkeypatch):
    monkeypatch.setattr("homolog.io.vtk_files.MOST", 3000)
    piece = XML.partition("<PolyData>")[2].partition("</PolyData>")[0].format(1000).replace("Polys", "Lines")
    head, tail = XML.partition("<PolyData>")[0], XML.partition("</PolyData>")[2]
    body = zlib.compress(bytes(24000))
    stored = np.array([1, 24000, 0, len(body)], "<u8").tobytes() + body
    content = f"{head}<PolyData>{piece * 7}</PolyData>{tail}".encode() + stored + b"</AppendedData></VTKFile>"
    (tmp_path / "a.vtp").write_bytes(content)
    with pytest.raises(InputError, match="more than 3000 points"):
        read_mesh(tmp_path / "a.vtp")
