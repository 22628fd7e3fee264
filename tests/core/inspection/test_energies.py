"""The energies' shares and the carried patterns."""

import numpy as np
import pytest

from homolog.correspondence.entropy.dual import entropy
from homolog.inspection import carried_places, checkerboard, particle_energies, stripes
from homolog.inspection.energies import shared_entropy
from homolog.registration.entropy import covariance
from homolog.settings import OptimizeSettings


@pytest.mark.parametrize("regularization", [1e-3, 1.0])
def test_the_shares_add_up_to_the_optimizers_entropy(regularization):
    rows = np.random.default_rng(0).normal(size=(5, 40, 3))
    rows -= rows.mean(axis=0)
    whole = entropy(covariance(rows.reshape(5, -1).astype(np.float32)), regularization)
    assert shared_entropy(rows, regularization).mean() == pytest.approx(whole, rel=1e-4)


def test_shapes_that_do_not_vary_have_no_entropy_to_share():
    assert np.abs(shared_entropy(np.zeros((4, 10, 3)), 0.01)).max() == 0.0


def test_crowded_and_misplaced_particles_have_the_largest_energies(known):
    local = known.local.copy()
    nearest = np.linalg.norm(local[2] - local[2, 60], axis=1).argsort()[1]
    local[2, 60] += 0.8 * (local[2, nearest] - local[2, 60])
    local[4, [8, 100]] = local[4, [100, 8]]
    result = known.inspect(local)
    energies = particle_energies(result.located, result.consensus, OptimizeSettings())
    crowded = np.unravel_index(energies.sampling.argmax(), energies.sampling.shape)
    assert crowded in {(2, 60), (2, nearest)}
    for part in (energies.ensemble, energies.normals):
        worst = np.argsort(part[4])[-2:]
        assert set(worst) == {8, 100}


def test_a_pattern_is_carried_to_the_same_places(make_known):
    good = make_known([(20, 16, 12), (10, 16, 12), (20, 8, 6)]).inspect()
    for m, axes in enumerate([(20, 16, 12), (10, 16, 12), (20, 8, 6)]):
        carried = carried_places(good.located, good.consensus, m)
        matrix, mesh = good.located.alignments[m], good.located.meshes[m]
        unit = (mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]) / axes
        np.testing.assert_allclose(
            carried, unit * np.median([(20, 16, 12), (10, 16, 12), (20, 8, 6)], axis=0), atol=0.2
        )


def test_stripes_run_across_the_longest_axis_and_checks_along_all(good):
    shape = good.consensus.shape
    along = np.linspace(-19, 19, 2000)[:, None] * [1.0, 0.0, 0.0]
    turned = np.linspace(-11, 11, 2000)[:, None] * [0.0, 0.0, 1.0] + np.array([2.0, 2.0, 0.0])
    assert np.abs(np.diff(stripes(along, shape, 0.1))).sum() == pytest.approx(8, abs=1)
    assert np.abs(np.diff(stripes(turned, shape, 0.1))).sum() <= 1
    assert np.abs(np.diff(checkerboard(turned, shape, 0.1))).sum() >= 3
    tones = stripes(along, shape, 0.5)
    assert tones.min() == 0.0
    assert tones.max() == 1.0
    assert np.abs(np.diff(tones)).max() < 0.05
