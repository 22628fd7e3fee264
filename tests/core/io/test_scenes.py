"""Surfaces in glTF and 3MF files."""

import zipfile

import pytest
import trimesh

from homolog.errors import InputError
from homolog.io.meshes import read_mesh

THREE_MF = "http://schemas.microsoft.com/3dmanufacturing"


@pytest.fixture
def ball():
    return trimesh.creation.icosphere(subdivisions=2, radius=30.0)


def check(mesh, ball, centre):
    assert len(mesh.faces) == len(ball.faces)
    assert mesh.volume == pytest.approx(ball.volume, rel=1e-5)
    assert 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) == pytest.approx(centre, abs=1e-4)


@pytest.mark.parametrize("kind", ["glb", "gltf"])
@pytest.mark.parametrize("unit", [1.0, 0.001])
def test_gltf_scenes_are_read_in_millimetres_or_metres(tmp_path, ball, kind, unit):
    ball.apply_scale(unit)
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix([5.0 * unit, 0.0, 0.0]))
    written = scene.export(file_type=kind)
    files = {"model.glb": written} if kind == "glb" else written
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    ball.apply_scale(1.0 / unit)
    check(read_mesh(tmp_path / f"model.{kind}"), ball, [5.0, 0.0, 0.0])


@pytest.mark.parametrize("needed", ["KHR_draco_mesh_compression", "KHR_mesh_quantization"])
def test_a_compressed_gltf_scene_is_refused_with_the_remedy(tmp_path, needed):
    (tmp_path / "a.gltf").write_text(f'{{"extensionsRequired": ["KHR_materials_unlit", "{needed}"]}}')
    with pytest.raises(InputError, match="export it without compression"):
        read_mesh(tmp_path / "a.gltf")


def model(objects, build, unit):
    return (
        f'<model unit="{unit}" xmlns="{THREE_MF}/core/2015/02" xmlns:p="{THREE_MF}/production/2015/06">'
        f"<resources>{objects}</resources><build>{build}</build></model>"
    )


def write_3mf(path, ball, *, part="/3D/part.model"):
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in (0.1 * ball.vertices).tolist())
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in ball.faces.tolist())
    mesh = f"<mesh><vertices>{points}</vertices><triangles>{faces}</triangles></mesh>"
    moved = f'<component p:path="{part}" objectid="3" transform="1 0 0 0 1 0 0 0 1 1 0 0"/>'
    whole = f'<object id="1"><components>{moved}</components></object>'
    mirrored = '<item objectid="1" transform="-1 0 0 0 1 0 0 0 1 0 0 0"/>'
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/part.model", model(f'<object id="3">{mesh}</object>', "", "centimeter"))
        archive.writestr("3D/whole.model", model(whole, mirrored, "centimeter"))


def test_3mf_parts_are_placed_in_their_unit(tmp_path, ball):
    write_3mf(tmp_path / "a.3mf", ball)
    check(read_mesh(tmp_path / "a.3mf"), ball, [-10.0, 0.0, 0.0])


def test_3mf_parts_that_are_not_there_are_refused(tmp_path, ball):
    write_3mf(tmp_path / "a.3mf", ball, part="/3D/other.model")
    with pytest.raises(InputError, match="parts that are missing"):
        read_mesh(tmp_path / "a.3mf")
