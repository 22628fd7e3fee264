import gzip
import struct
import sys

import numpy as np
import pytest
import trimesh
from PIL import Image

from homolog.errors import InputError, user_message
from homolog.io.meshes import read_mesh, write_mesh
from homolog.surfaces.mesh import TriangleMesh

SUFFIXES = [".vtp", ".vtk", ".ply", ".stl", ".obj"]


@pytest.fixture
def mesh():
    vertices = np.array([[10.5, 0, 0], [12, 0.125, 0], [10, 2, 0.25], [10, 0, 2]])
    return TriangleMesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_written_is_read_again(mesh, tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_mesh(path, mesh)
    again = read_mesh(path)
    assert again.volume == pytest.approx(mesh.volume)
    if suffix != ".stl":  # which lists corners, not vertices
        assert np.array_equal(again.vertices, mesh.vertices)
        assert np.array_equal(again.faces, mesh.faces)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".ply", ".stl"])
def test_files_say_that_they_are_lps(mesh, tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    write_mesh(path, mesh)
    if suffix == ".vtp":
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

        reader = vtkXMLPolyDataReader(file_name=str(path))
        reader.Update()
        assert reader.GetOutput().GetFieldData().GetAbstractArray("SPACE").GetValue(0) == "LPS"
    else:
        assert b"SPACE=LPS" in path.read_bytes()[:300]


def test_a_mesh_marked_ras_is_turned(mesh, tmp_path):
    path = tmp_path / "a.ply"
    write_mesh(path, mesh)
    path.write_bytes(path.read_bytes().replace(b"SPACE=LPS", b"SPACE=RAS"))
    assert np.array_equal(read_mesh(path).vertices, mesh.vertices * [-1.0, -1.0, 1.0])


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".ply"])
def test_values_at_vertices_are_kept(mesh, tmp_path, suffix):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOLegacy import vtkPolyDataReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    path = tmp_path / f"a{suffix}"
    values = np.array([1.5, -2.0, 0.0, 4.0])
    write_mesh(path, mesh, {"difference mm": values, "move": mesh.vertices})
    if suffix == ".ply":
        header = path.read_bytes().split(b"end_header")[0].decode()
        assert "property float difference_mm" in header
        assert "property float move_2" in header
        return
    reader = vtkXMLPolyDataReader() if suffix == ".vtp" else vtkPolyDataReader()
    if suffix == ".vtk":
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
        reader.ReadAllFieldsOn()
    reader.SetFileName(str(path))
    reader.Update()
    result = reader.GetOutput().GetPointData()
    name = "difference mm" if suffix == ".vtp" else "difference%20mm"
    stored = result.GetArray("difference mm") or result.GetArray(name)
    assert vtk_to_numpy(stored).tolist() == values.tolist()


@pytest.mark.parametrize("suffix", [".stl", ".obj"])
def test_values_that_a_format_cannot_keep_are_refused(mesh, tmp_path, suffix):
    with pytest.raises(InputError, match=r"use \.vtp or \.ply"):
        write_mesh(tmp_path / f"a{suffix}", mesh, {"a": np.zeros(4)})


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_unreadable_file_is_named(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_text("this is no mesh\n")
    with pytest.raises(InputError, match=f"a{suffix}: (can't be read|contains no triangles)"):
        read_mesh(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_missing_file_is_named(tmp_path, suffix):
    with pytest.raises(InputError, match="does not exist"):
        read_mesh(tmp_path / f"gone{suffix}")


@pytest.mark.parametrize("suffix", [".vtp", ".vtk", ".ply"])
def test_a_file_cut_short_is_refused_or_open(tmp_path, suffix):
    """Binary files with half of their data must not pass as a closed surface."""
    from homolog.surfaces.topology import check_mesh

    angles = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    rim = np.stack([np.cos(angles), np.sin(angles), np.zeros(200)], axis=1)
    vertices = np.concatenate([rim, [[0, 0, 1], [0, 0, -1]]])
    ring = np.arange(200)
    faces = np.concatenate(
        [
            np.stack([ring, (ring + 1) % 200, np.full(200, 200)], axis=1),
            np.stack([(ring + 1) % 200, ring, np.full(200, 201)], axis=1),
        ]
    )
    path = tmp_path / f"a{suffix}"
    write_mesh(path, TriangleMesh(vertices, faces))
    check_mesh(read_mesh(path), "whole")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(InputError):
        check_mesh(read_mesh(path), "cut")


def test_many_coordinates_that_are_not_numbers_are_refused(mesh, tmp_path):
    bad = np.array(mesh.vertices)
    bad[1, 1] = np.nan
    write_mesh(tmp_path / "a.vtp", TriangleMesh(bad, mesh.faces))
    with pytest.raises(InputError, match="aren't numbers"):
        read_mesh(tmp_path / "a.vtp")


CUBE = """# a cube of quads
v 0 0 0 1.0
v 2 0 0 1.0
v 2 2 0 1.0
v 0 2 0 1.0 # a note
v 0 0 2
v 2 0 2 0.5 0.5 0.5
v 2 2 2
v 0 2 2
vn 0 0 1
vt 0 0
g sides
usemtl nothing
f 1/1/1 4/1/1 3/1/1 2/1/1
f 5//1 6//1 7//1 8//1
f 1 2 6 \\
5
f -7 -6 -2 -3
s off
f 3/1 4/1 8/1 7/1
f 1 5 8 4
"""


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_an_obj_of_quads_groups_textures_and_relative_numbers_is_read(tmp_path, end):
    path = tmp_path / "a.obj"
    path.write_bytes(CUBE.replace("\n", end).encode())
    mesh = read_mesh(path)
    assert mesh.volume == pytest.approx(8.0)
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)


def test_a_polygon_that_turns_inward_is_split_within_itself(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\nf 2 3 4 5 1\n")
    mesh = read_mesh(path)
    assert mesh.area == pytest.approx(10.0)
    assert len(mesh.faces) == 3


@pytest.mark.parametrize(
    "line", ["v 1 2", "v a b c", "f 1 2 9", "f 0 1 2", "f 1 2 -9", "f x y z", "f 1.5 2 3"]
)
def test_an_obj_that_makes_no_sense_is_refused(tmp_path, line):
    path = tmp_path / "a.obj"
    path.write_text(CUBE + line + "\n")
    with pytest.raises(InputError, match=r"a\.obj: can't be read"):
        read_mesh(path)


def test_a_face_of_thousands_of_corners_is_refused_at_once(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text(CUBE + "f" + " 1 2 3" * 100_000 + "\n")
    with pytest.raises(InputError, match="more than 1000 corners"):
        read_mesh(path)


@pytest.mark.parametrize(
    "header", [b"solid made by a CAD program, facet", b"COLOR=1234, SPACE=RAS", b"\xff" * 80]
)
@pytest.mark.parametrize("filling", [b"", b"\0" * 30])
def test_a_binary_stl_is_known_whatever_its_header_says(mesh, tmp_path, header, filling):
    path = tmp_path / "a.stl"
    write_mesh(path, mesh)
    path.write_bytes(header.ljust(80) + path.read_bytes()[80:] + filling)
    again = read_mesh(path)
    assert again.volume == pytest.approx(mesh.volume)
    assert again.vertices[:, 0].max() == (12 if b"RAS" not in header else -10)


FACET = "facet normal 0 0 1\n outer loop\n  vertex {}\n  vertex 1 0 0\n  vertex 0 1 0\n endloop\nendfacet\n"


@pytest.mark.parametrize("case", [str.lower, str.upper])
def test_an_stl_as_text_is_read_with_all_its_solids(tmp_path, case):
    path = tmp_path / "a.stl"
    solids = [
        f"solid {n}\n{FACET.format(p)}endsolid {n}\n" for n, p in (("a", "0 0 0"), ("b", "0 0 -2.5E-1"))
    ]
    path.write_text(case("".join(solids)))
    assert len(read_mesh(path).faces) == 2


@pytest.mark.parametrize(
    "content",
    [
        "solid a\n" + FACET.format("0 0 0"),
        "solid a\n" + FACET.format("0 0") + "endsolid a\n",
        "solid a\n" + FACET.format("0 0 0").replace("vertex 1 0 0\n", "") + "endsolid a\n",
        "solid a\n" + FACET.format("0 0 zero") + "endsolid a\n",
        "solid a\n" + FACET.format("0 0 0").replace("endfacet", "") + "endsolid a\n",
    ],
)
def test_an_stl_as_text_that_is_cut_short_or_damaged_is_refused(tmp_path, content):
    path = tmp_path / "a.stl"
    path.write_text(content)
    with pytest.raises(InputError, match=r"a\.stl: can't be read"):
        read_mesh(path)


@pytest.mark.parametrize("count", [0, 3, 5, 2**32 - 1])
def test_a_binary_stl_of_another_length_than_it_says_is_refused(mesh, tmp_path, count):
    path = tmp_path / "a.stl"
    write_mesh(path, mesh)
    content = path.read_bytes()
    path.write_bytes(content[:80] + count.to_bytes(4, "little") + content[84:])
    with pytest.raises(InputError, match=r"a\.stl: can't be read"):
        read_mesh(path)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("number", ["f4", "f8"])
def test_a_binary_ply_is_read_in_both_byte_orders(mesh, tmp_path, order, number):
    path = tmp_path / "a.ply"
    points = mesh.vertices.astype(order + number)
    faces = np.empty(4, [("count", "u1"), ("corners", order + "i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    kind = {"f4": "float", "f8": "double"}[number]
    path.write_bytes(
        f"ply\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\nelement vertex 4\n"
        f"property {kind} x\nproperty {kind} y\nproperty {kind} z\nelement face 4\n"
        "property list uchar int vertex_indices\nend_header\n".encode()
        + points.tobytes()
        + faces.tobytes()
    )
    assert read_mesh(path).volume == pytest.approx(mesh.volume)


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("textured", ["all faces", "some faces"])
def test_a_textured_ply_of_triangles_and_quadrangles_is_read_as_its_bare_surface(
    mesh, tmp_path, text, textured
):
    path = tmp_path / "scan.ply"
    vertices = np.vstack([mesh.vertices, mesh.vertices[[0]] + 5.0])
    faces = [*mesh.faces.tolist(), [0, 1, 2, 4]]
    layout = "ascii" if text else "binary_little_endian"
    header = (
        f"ply\nformat {layout} 1.0\ncomment TextureFile skin.png\nelement vertex 5\nproperty float x\n"
        "property float y\nproperty float z\nproperty uchar red\nelement face 5\n"
        "property list uchar int vertex_indices\nproperty list uchar float texcoord\n"
        "property int texnumber\nend_header\n"
    )
    rows = [("3fB", [*point, 7]) for point in vertices]
    for index, face in enumerate(faces):
        places = [0.25] * 2 * len(face) if textured == "all faces" or index % 2 else []
        rows.append((f"B{len(face)}iB{len(places)}fi", [len(face), *face, len(places), *places, 0]))
    if text:
        body = "".join(" ".join(map(str, numbers)) + "\n" for _, numbers in rows).encode()
    else:
        body = b"".join(struct.pack("<" + kinds, *numbers) for kinds, numbers in rows)
    path.write_bytes(header.encode() + body)
    read = read_mesh(path)
    assert np.array_equal(read.vertices, vertices)
    assert np.array_equal(read.faces[:4], mesh.faces)
    assert len(read.faces) == 6


@pytest.mark.parametrize("faces", ["3 0 2 1\n0 0 0\n", "3 0 2 1.5\n"])
def test_a_ply_that_contradicts_its_header_is_refused(tmp_path, faces):
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 1\nproperty list uchar int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n" + faces
    )
    with pytest.raises(InputError, match=r"a\.ply: can't be read"):
        read_mesh(path)


@pytest.mark.parametrize("name", ["a.obj", "a.glb"])
def test_a_textured_surface_whose_seams_are_cut_is_closed_again(tmp_path, name):
    ball = trimesh.creation.icosphere(2, 50.0)
    corners = ball.vertices[ball.faces].reshape(-1, 3)  # each triangle has its own place in the picture
    cut = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    places = np.random.default_rng(1).random((len(corners), 2))
    cut.visual = trimesh.visual.TextureVisuals(places, image=Image.new("RGB", (4, 4)))
    cut.export(tmp_path / name)
    read = read_mesh(tmp_path / name)
    assert (len(read.vertices), len(read.faces)) == (162, 320)
    assert read.volume == pytest.approx(ball.volume, rel=1e-5)


@pytest.mark.parametrize(
    ("suffix", "text"),
    [
        (".obj", "v 0,5 0 0\nv 1,5 0 0\nv 0,5 1 0\nv 0,5 0 -1,25\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"),
        (".off", "OFF\n3 1 0\n0,5 0,0 0,0\n1,5 0,0 0,0\n0,5 1,0 -1,25\n3 0 1 2\n"),
        (
            ".stl",
            "solid a\nfacet normal 0,0 0,0 1,0\nouter loop\nvertex 0,5 0,0 0,0\nvertex 1,5 0,0 0,0\n"
            "vertex 0,5 1,0 -1,25\nendloop\nendfacet\nendsolid a\n",
        ),
    ],
)
def test_a_surface_of_text_with_decimal_commas_is_read(tmp_path, suffix, text):
    (tmp_path / f"a{suffix}").write_text(text)
    vertices = read_mesh(tmp_path / f"a{suffix}").vertices
    assert vertices.min(axis=0).tolist() == [0.5, 0.0, -1.25]
    assert vertices.max(axis=0).tolist() == [1.5, 1.0, 0.0]


def test_an_unknown_suffix_is_refused(mesh, tmp_path):
    with pytest.raises(InputError, match=r"a\.gltf: .* \.vtp"):
        write_mesh(tmp_path / "a.gltf", mesh)


def test_a_folder_that_cannot_be_written_to_is_named(mesh, tmp_path):
    (tmp_path / "file").write_text("")
    for suffix in (".vtp", ".ply"):
        with pytest.raises(InputError, match="can't be written"):
            write_mesh(tmp_path / "file" / f"a{suffix}", mesh)


@pytest.mark.parametrize("share", [0.0, 0.05, 0.4, 0.7, 0.99])
def test_a_ply_cut_short_anywhere_is_refused(mesh, tmp_path, share):
    """VTK's reader would crash on it."""
    path = tmp_path / "a.ply"
    write_mesh(path, mesh, {"value": np.zeros(4)})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"a\.ply: can't be read"):
        read_mesh(path)


@pytest.mark.parametrize("faces", ["3 0 1 99", "3 -1 0 1", "2000000000 0 1 2"])
def test_a_ply_whose_faces_make_no_sense_is_no_crash(tmp_path, faces):
    """VTK's reader would follow them out of memory, or try for minutes."""
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n{faces}\n"
    )
    with pytest.raises(InputError, match=r"refers to vertices|cut short"):
        read_mesh(path)


@pytest.mark.parametrize("count", ["99999999999", "9" * 25])
def test_a_vtp_that_claims_too_much_is_refused_before_memory_is_asked_for(mesh, tmp_path, count):
    path = tmp_path / "a.vtp"
    write_mesh(path, mesh)
    path.write_bytes(path.read_bytes().replace(b'NumberOfPoints="4"', f'NumberOfPoints="{count}"'.encode()))
    with pytest.raises(InputError, match="claims more points"):
        read_mesh(path)


@pytest.mark.parametrize(("corners", "area"), [(4, 2.0), (6, 2.598076211353316)])
def test_polygons_of_a_ply_are_split(tmp_path, corners, area):
    angles = 2.0 * np.pi * np.arange(corners) / corners
    points = "".join(f"{x:.15f} {y:.15f} 0\n" for x, y in zip(np.cos(angles), np.sin(angles), strict=True))
    path = tmp_path / "a.ply"
    path.write_text(
        f"ply\nformat ascii 1.0\nelement vertex {corners}\nproperty double x\nproperty double y\n"
        "property double z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        f"{points}{corners} {' '.join(map(str, range(corners)))}\n"
    )
    assert read_mesh(path).area == pytest.approx(area)


def test_a_ply_of_triangle_strips_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "strips.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n4 0 1 2 -1\n"
    )
    with pytest.raises(InputError, match=r"a mesh: contains triangle strips; save it with triangles$"):
        read_mesh(path)


def test_a_ply_of_points_alone_is_no_surface(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 1\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    (tmp_path / "cloud.ply").write_text(f"{header}end_header\n1 2 3\n")
    with pytest.raises(InputError, match=r"cloud\.ply: contains no triangles"):
        read_mesh(tmp_path / "cloud.ply")


def test_a_ply_as_text_with_colours_is_read(tmp_path):
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0 9\n1 0 0 9\n0 1 0 9\n3 0 1 2\n"
    )
    assert read_mesh(path).area == pytest.approx(0.5)


def test_letters_of_another_encoding_in_a_plys_comment_do_not_matter(tmp_path):
    header = (
        "ply\nformat ascii 1.0\ncomment von Müller\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    (tmp_path / "a.ply").write_bytes(header.encode("latin-1") + b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    assert read_mesh(tmp_path / "a.ply").area == pytest.approx(0.5)


@pytest.mark.parametrize("offsets", ["0 3 900000", "0 -3 6", "3 3 6"])
@pytest.mark.parametrize("cells", ["POLYGONS", "TRIANGLE_STRIPS"])
def test_faces_that_would_lead_vtk_out_of_memory_are_refused(tmp_path, offsets, cells):
    path = tmp_path / "a.vtk"
    path.write_text(
        "# vtk DataFile Version 5.1\n\nASCII\nDATASET POLYDATA\nPOINTS 3 double\n0 0 0 1 0 0 0 1 0\n"
        f"{cells} 3 6\nOFFSETS vtktypeint64\n{offsets}\nCONNECTIVITY vtktypeint64\n0 1 2 0 2 1\n"
    )
    with pytest.raises(InputError, match="refers to vertices"):
        read_mesh(path)


def test_a_legacy_file_that_ends_in_its_header_is_refused(tmp_path):
    path = tmp_path / "a.vtk"
    path.write_text("# vtk DataFile Version 5.1\n\nBINARY\nDATASET POLYDATA\nFIELD FieldData 1\nSPACE 1 1 ")
    with pytest.raises(InputError, match=r"can.t be read as a mesh"):
        read_mesh(path)


def test_a_package_that_is_not_installed_is_named_and_the_file_not_blamed(mesh, tmp_path, monkeypatch):
    trimesh.Trimesh(mesh.vertices, mesh.faces).export(tmp_path / "a.glb")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        read_mesh(tmp_path / "a.glb")
    message = user_message(caught.value)
    assert "trimesh is not installed" in message
    assert "pip install trimesh" in message


@pytest.mark.parametrize("suffix", [".vtk", ".ply", ".stl", ".obj"])
def test_meshes_compressed_by_gzip_are_read_if_they_are_whole(mesh, tmp_path, suffix):
    write_mesh(tmp_path / f"a{suffix}", mesh)
    packed = gzip.compress((tmp_path / f"a{suffix}").read_bytes())
    (tmp_path / f"a{suffix}.gz").write_bytes(packed)
    (tmp_path / f"b{suffix}.gz").write_bytes(packed[:-12])
    assert read_mesh(tmp_path / f"a{suffix}.gz").volume == pytest.approx(mesh.volume)
    with pytest.raises(InputError, match="unpacked"):
        read_mesh(tmp_path / f"b{suffix}.gz")


def test_a_surface_of_too_many_corners_is_not_called_damaged(mesh, tmp_path, monkeypatch):
    write_mesh(tmp_path / "a.stl", mesh)
    monkeypatch.setattr("homolog.io.polygons.MOST", 11)
    with pytest.raises(InputError, match="simplify the surface") as caught:
        read_mesh(tmp_path / "a.stl")
    assert "damaged" not in str(caught.value)
