"""Thickness of walls: what position alone does not show."""

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.patient import Reference, compare_groomed
from homolog.statistics.moderation import moderated
from homolog.surfaces.mesh import TriangleMesh

from .conftest import AXES, build, groomed, moved, sphere

INNER = 0.72
"""Size of the inner ellipsoid, relative to the outer one: walls of 4 to 8 mm."""


def shell(random):
    """Return a hollow ellipsoid whose middle shifts a lot, so that positions differ more than its wall."""
    directions, faces = sphere()
    axes = AXES * np.exp(random.normal(scale=0.04, size=3))
    outer = directions * axes
    waves = np.zeros(len(outer))
    for _ in range(8):
        waves += 0.7 * np.sin(outer @ random.normal(scale=0.25, size=3) + random.uniform(0.0, 6.0))
    both = np.concatenate([outer, INNER * outer]) + np.concatenate([waves, waves])[:, None] * np.tile(
        directions, (2, 1)
    )
    return both, np.concatenate([faces, faces[:, ::-1] + len(outer)])


@pytest.fixture(scope="module")
def shells(provenance):
    random = np.random.default_rng(1)
    points, faces = shell(random)
    return build((points, faces), provenance, count=20, make=lambda _: shell(random)[0])


def test_a_thinned_wall_is_found_where_positions_differ_more(shells):
    random = np.random.default_rng(77)
    points, faces = shell(random)
    plain = compare_groomed(shells, groomed("p", TriangleMesh(moved(points, random), faces)))
    assert not plain.regions
    directions = sphere()[0]
    thin = points.copy()
    patch = np.exp(-0.5 * np.square(AXES * (directions - directions[5])).sum(axis=1) / 6.0**2)
    half = len(directions)
    thin[half:] += 0.6 * patch[:, None] * (points[:half] - points[half:])
    found = compare_groomed(shells, groomed("p", TriangleMesh(moved(thin, random), faces)))
    region = found.regions[0]
    assert -0.8 < region.thicker < -0.3
    assert found.thicker.min() < -0.4
    assert np.median(np.abs(found.thicker)) < 0.2


def test_a_reference_of_an_older_version_is_to_be_made_again(reference, tmp_path):
    import json

    reference.save(tmp_path / "ref.npz")
    with np.load(tmp_path / "ref.npz") as stored:
        arrays = {name: stored[name] for name in stored.files}
    record = json.loads(str(arrays["record"])) | {"version": 1}
    np.savez(tmp_path / "old.npz", **arrays | {"record": np.array(json.dumps(record))})
    with pytest.raises(InputError, match="make it again"):
        Reference.load(tmp_path / "old.npz")


def test_a_larger_bump_is_visible_on_more_of_the_surface(reference):
    shares = [reference.visible(height, 12.0).mean() for height in (0.5, 2.0, 8.0)]
    assert shares[0] < shares[1] <= shares[2]
    assert shares[2] == 1.0


def test_variances_that_differ_by_chance_become_equal_and_others_stay():
    random = np.random.default_rng(0)
    alike = random.normal(size=(8, 5000)).var(axis=0, ddof=1)
    assert moderated(alike, 7).std() < 0.1 * alike.std()
    true = np.exp(random.normal(scale=0.4, size=5000))
    own = (random.normal(size=(8, 5000)) * np.sqrt(true)).var(axis=0, ddof=1)
    error = [np.square(np.log(item) - np.log(true)).mean() for item in (own, moderated(own, 7))]
    assert error[1] < 0.8 * error[0]
