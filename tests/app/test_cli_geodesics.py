import pytest
import scipy.sparse

from homolog.io.meshes import write_mesh
from homolog.surfaces.mesh import TriangleMesh
from homolog_app.cli import main


@pytest.fixture
def octahedron(tmp_path):
    vertices = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    write_mesh(tmp_path / "octahedron.ply", TriangleMesh(vertices, faces))
    return tmp_path / "octahedron.ply"


def test_the_matrix_is_written_and_its_size_told(octahedron, tmp_path, capsys):
    out = tmp_path / "table.npz"
    assert (
        main(["geodesics", str(octahedron), "--d-max", "1.5", "--out", str(out), "--progress", "none"]) == 0
    )
    matrix = scipy.sparse.load_npz(out)
    assert sorted(matrix.data) == pytest.approx([0.0] * 6 + [2**0.5] * 24, rel=1e-4)
    output = capsys.readouterr().err
    assert "6 vertices, mean edge 1.41 mm" in output
    assert "30 distances in" in output


def test_verifying_prints_the_errors(octahedron, capsys):
    arguments = ["--d-max", "inf", "--verify", "6", "--progress", "none"]
    assert main(["geodesics", str(octahedron), *arguments]) == 0
    assert "30 pairs of 6 sources" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--d-max", "0"], "octahedron.ply: d_max is 0.0"),
        (["--d-max", "nan"], "octahedron.ply: d_max is nan"),
        (["--d-max", "1", "--out", "table.csv"], "table.csv: the matrix is written as .npz"),
        (["--d-max", "1", "--verify", "0"], "--verify 0: at least one source"),
        (["--d-max", "1", "--device", "cuda:99"], "device 'cuda:99' is not on this machine"),
        (["--d-max", "1", "--memory-limit", "0"], "above the limit of 0 GB"),
    ],
)
def test_what_cannot_be_done_is_refused(octahedron, capsys, options, complaint):
    assert main(["geodesics", str(octahedron), *options]) == 2
    assert complaint in capsys.readouterr().err


def test_full_memory_is_told_with_a_remedy(octahedron, capsys, monkeypatch):
    def full(*given, **options):
        raise RuntimeError("Failed to allocate 123 bytes on device 'cpu'")

    monkeypatch.setattr("homolog.geodesics.each_table", full)
    arguments = ["--d-max", "1.5", "--device", "cpu", "--progress", "none"]
    assert main(["geodesics", str(octahedron), *arguments]) != 0
    assert "has too little memory" in capsys.readouterr().err
