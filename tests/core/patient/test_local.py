"""Limits, regions and percentiles."""

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.patient.coding import Coding
from homolog.patient.distribution import percentile
from homolog.patient.local import (
    BandNorm,
    LocalNorm,
    bands_of,
    gains,
    norm_and_maxima,
    prediction_limit,
    regions,
    scores_of,
)
from homolog.patient.mesh_graph import median_of_ring, ring_mean
from homolog.surfaces.mesh import TriangleMesh


@pytest.mark.parametrize("count", [12, 24, 60])
def test_the_limit_is_exceeded_by_five_percent_of_new_values(count):
    random = np.random.default_rng(1)
    exceeded = [
        values[-1] > prediction_limit(values[:-1])
        for values in np.exp(random.normal(1.2, 0.2, size=(4000, count + 1)))
    ]
    assert np.mean(exceeded) == pytest.approx(0.05, abs=0.012)


def test_with_many_controls_the_limit_is_a_rank():
    values = np.random.default_rng(0).permutation(np.arange(1.0, 100.0))
    assert prediction_limit(values) == pytest.approx(95.0)


def test_a_control_left_out_is_judged_by_the_others(template):
    directions, faces = template
    maps = np.random.default_rng(2).normal(size=(2, 20, faces.max() + 1))
    maps[1, 4, directions[:, 0] > 0.9] += 40.0
    norm, maxima = norm_and_maxima(maps, bands_of(maps, faces))
    assert maxima.argmax() == 4
    bands = bands_of(maps[:, 4], faces)
    inside = np.abs(scores_of(norm, maps[:, 4], maps.mean(axis=1), bands)).max()
    assert maxima[4] > 2.0 * inside


def test_a_subject_with_a_rough_surface_is_judged_by_its_own_roughness(template):
    _, faces = template
    random = np.random.default_rng(5)
    maps = random.normal(size=(2, 24, faces.max() + 1))
    maps *= np.exp(random.normal(scale=0.7, size=(1, 24, 1)))
    _, maxima = norm_and_maxima(maps, bands_of(maps, faces))
    assert maxima.max() < 2.0 * maxima.min()


def test_bands_with_long_tails_do_not_set_the_limit_of_the_others(template):
    _, faces = template
    random = np.random.default_rng(6)
    calm = random.normal(size=(1, 30, faces.max() + 1))
    tailed = random.standard_t(2.5, size=calm.shape)
    maps = np.concatenate([calm, tailed])
    bands = bands_of(maps, faces)
    norm, _ = norm_and_maxima(maps, bands)
    alone = LocalNorm.of(bands)
    ratio = (norm.deviation / alone.deviation).mean(axis=-1)
    assert ratio[1, 0] > 1.3 * ratio[0, 0]
    assert np.exp(np.log(ratio).mean()) == pytest.approx(1.0)


def test_healthy_people_exceed_the_limit_as_rarely_as_controls_do(template):
    _, faces = template
    random, count = np.random.default_rng(7), 24
    flagged = []
    for _ in range(30):
        size = (count + 5, faces.max() + 1)
        maps = np.stack([random.normal(size=size), random.standard_t(3, size)])
        maps *= np.exp(random.normal(scale=0.4, size=(1, count + 5, 1)))
        bands = bands_of(maps, faces)
        norm, maxima = norm_and_maxima(maps[:, :count], bands[:, :, :count])
        usual, limit = maps[:, :count].mean(axis=1), prediction_limit(maxima)
        for index in range(count, count + 5):
            z = scores_of(norm, maps[:, index], usual, bands[:, :, index])
            flagged.append(np.abs(z).max() > limit)
    assert 0.01 < np.mean(flagged) < 0.09


def test_a_bump_has_the_share_of_its_height_that_its_width_predicts(template):
    directions, faces = template
    radius, width = 40.0, 24.0
    mesh = TriangleMesh(radius * directions, faces)
    gaps = np.square(radius * (directions - directions[350])).sum(axis=1)
    bump = np.exp(-4.0 * np.log(2.0) * gaps / width**2)
    here = bands_of(np.stack([bump, bump]), faces)[0, :, 350]
    assert here == pytest.approx(gains(width, mesh.mean_edge), abs=0.08)


def test_regions_are_connected_and_of_one_sign(template):
    directions, faces = template
    mesh = TriangleMesh(10.0 * directions, faces)
    z = np.zeros(len(directions))
    for axis, value in ((0, 6.0), (1, -8.0), (2, 5.0)):
        z[directions[:, axis] > 0.95] = value
    met = np.ones(len(z), bool)
    result = regions(mesh, mesh.vertex_areas, 0.5 * z, z, met, 5.5)
    assert [region.z for region in result] == [-8.0, 6.0]
    assert result[0].mean == pytest.approx(-4.0)
    assert result[0].area == pytest.approx(2.0 * np.pi * 100.0 * 0.05, rel=0.35)


def test_a_single_vertex_is_no_region(template):
    _, faces = template
    values = np.zeros(faces.max() + 1)
    values[7] = 100.0
    assert not median_of_ring(values, faces).any()


def test_averaging_keeps_a_constant(template):
    _, faces = template
    assert ring_mean(np.full(faces.max() + 1, 3.0), faces, 4) == pytest.approx(3.0)


def test_percentiles_have_intervals_that_hold_them():
    controls = np.arange(1.0, 21.0)
    middle = percentile(10.5, controls)
    assert middle.percent == 50.0
    assert middle.low < 50.0 < middle.high
    assert percentile(99.0, controls).p == pytest.approx(1 / 21)
    assert percentile(0.0, controls, both_sides=True).p == pytest.approx(2 / 21)


def test_categories_may_be_shortened():
    coding, columns = Coding.of({"sex": ["female", "male", "male"], "age": ["40", "50", "60"]}, list("abc"))
    assert columns.shape == (3, 2)
    own, remarks = coding.columns({"sex": "F", "age": "50"})
    assert own == pytest.approx([columns[0, 0], columns[1, 1]])
    assert remarks == []
    with pytest.raises(InputError, match="female, male"):
        coding.columns({"sex": "x", "age": "50"})
    assert Coding.from_record(coding.record).columns({"sex": "m", "age": "40"})[0] == pytest.approx(
        coding.columns({"sex": "male", "age": "40"})[0]
    )


def test_around_a_bump_nothing_is_reported(template):
    directions, faces = template
    gaps = np.square(30.0 * (directions - directions[350])).sum(axis=1)
    bump = np.exp(-0.5 * gaps / 4.0**2)
    maps = np.stack([bump, np.zeros_like(bump)])
    bands = bands_of(maps, faces)
    flat = BandNorm(np.zeros_like(bands), np.full_like(bands, 0.01), np.ones((*bands.shape[:2], 1)))
    z = scores_of(flat, maps, np.zeros_like(maps), bands)
    assert z.max() > 20.0
    assert z.min() > -1e-9
