import numpy as np
import pytest
import SimpleITK

from homolog.errors import InputError
from homolog.grooming.distance_maps import read_distance_map

CENTRE = np.array([4.0, -3.0, 2.0])


@pytest.fixture
def write(tmp_path):
    """Write the signed distance from a sphere of 8 mm, on an anisotropic grid that is turned."""

    def save(name, sign=1.0, values=None):
        turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        spacing, size = np.array([1.0, 1.0, 2.0]), np.array([24, 25, 14])
        origin = CENTRE - turn @ (spacing * (size - 1) / 2.0)
        index = np.stack(np.meshgrid(*map(np.arange, size), indexing="ij"), axis=-1)
        points = index * spacing @ turn.T + origin
        distances = (
            sign * (np.linalg.norm(points - CENTRE, axis=-1) - 8.0) if values is None else values(points)
        )
        image = SimpleITK.GetImageFromArray(distances.astype(np.float32).T)
        image.SetSpacing(spacing.tolist())
        image.SetOrigin(origin.tolist())
        image.SetDirection(turn.ravel().tolist())
        SimpleITK.WriteImage(image, tmp_path / name)
        return tmp_path / name

    return save


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha", "a.nii.gz"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_zero_level_lies_where_the_file_says_and_faces_outward(write, name, sign):
    mesh = read_distance_map(write(name, sign))
    assert np.linalg.norm(mesh.vertices - CENTRE, axis=1) == pytest.approx(8.0, abs=0.2)
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * 512.0, rel=0.03)


@pytest.mark.parametrize(
    "values", [lambda points: np.ones(points.shape[:3]), lambda points: np.full(points.shape[:3], np.nan)]
)
def test_what_has_no_zero_level_is_refused(write, values):
    with pytest.raises(InputError, match="is not a distance map"):
        read_distance_map(write("a.nrrd", values=values))
