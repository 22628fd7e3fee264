import numpy as np
import pytest

from homolog.errors import Cancelled
from homolog.statistics.parallel import Null, parallel_analysis


def _by_definition(rows, repeats, percentile, generator):
    """Horn's parallel analysis from its definition: covariance matrices and shuffled columns."""
    real = np.linalg.eigvalsh(np.cov(rows, rowvar=False))[::-1]
    drawn = []
    for _ in range(repeats):
        shuffled = np.column_stack([generator.permutation(column) for column in rows.T])
        drawn.append(np.linalg.eigvalsh(np.cov(shuffled, rowvar=False))[::-1])
    threshold = np.percentile(drawn, percentile, axis=0)
    n_retained = 0
    while n_retained < len(real) and real[n_retained] > threshold[n_retained]:
        n_retained += 1
    return real, threshold, n_retained


@pytest.mark.parametrize(("subjects", "expected"), [(15, 1), (60, 3)])
def test_eigenvalues_thresholds_and_count_are_those_of_the_definition(subjects, expected):
    generator = np.random.default_rng(3)
    sources = generator.normal(size=(subjects, 3)) * [4.0, 3.0, 2.0]
    rows = sources @ generator.normal(size=(3, 30)) + generator.normal(size=(subjects, 30))
    result = parallel_analysis(rows, repeats=400, seed=1)
    real, threshold, n_retained = _by_definition(rows, 400, 95.0, generator)
    modes = min(subjects - 1, 30)
    np.testing.assert_allclose(result.eigenvalues, real[:modes], atol=1e-8)
    np.testing.assert_allclose(result.threshold[:10], threshold[:10], rtol=0.06)
    assert result.n_retained == n_retained == expected


@pytest.mark.parametrize("null", list(Null))
def test_noise_without_correlation_keeps_no_modes(null):
    noise = np.random.default_rng(5).normal(size=(21, 256, 3))
    assert parallel_analysis(noise, null=null, repeats=100).n_retained == 0


@pytest.mark.parametrize("null", list(Null))
def test_two_strong_modes_in_noise_are_both_kept(null):
    generator = np.random.default_rng(6)
    modes = generator.normal(size=(2, 200, 3))
    shapes = np.tensordot(generator.normal(size=(24, 2)), modes, axes=1)
    shapes += 0.4 * generator.normal(size=shapes.shape)
    assert parallel_analysis(shapes, null=null, repeats=100).n_retained == 2


def test_the_null_of_signs_sees_a_common_shift_that_the_others_centre_away():
    generator = np.random.default_rng(7)
    shift = generator.normal(size=(100, 3))
    differences = shift + 0.5 * generator.normal(size=(16, 100, 3))
    assert (
        parallel_analysis(differences, nuisance=np.zeros((16, 0)), null=Null.SIGNS, repeats=100).n_retained
        == 1
    )
    assert parallel_analysis(differences, null=Null.PERMUTATION, repeats=100).n_retained == 0


def test_the_same_seed_gives_the_same_bits(ellipsoids):
    first, again = (parallel_analysis(ellipsoids(), repeats=20, seed=9) for _ in range(2))
    assert first.threshold.tobytes() == again.threshold.tobytes()


def test_parallel_analysis_stops_where_it_is_cancelled(ellipsoids):
    def cancel(fraction, message):
        if fraction > 0.3:
            raise Cancelled

    with pytest.raises(Cancelled):
        parallel_analysis(ellipsoids(), repeats=20, tick=cancel)


@pytest.mark.parametrize("subjects", [120, 300])
def test_null_data_of_a_part_have_the_spectrum_of_whole_null_data(monkeypatch, subjects):
    generator = np.random.default_rng(8)
    modes = generator.choice([-1.0, 1.0], size=(3, 60, 3)) * [[[1.0]], [[0.7]], [[0.5]]]
    shapes = np.tensordot(generator.normal(size=(subjects, 3)), modes, axes=1)
    shapes += generator.normal(size=shapes.shape)
    whole = parallel_analysis(shapes, repeats=100)
    monkeypatch.setattr("homolog.statistics.parallel.MOST", 60)
    part = parallel_analysis(shapes, repeats=100)
    np.testing.assert_allclose(part.null_mean[:60], whole.null_mean[:60], rtol=0.1)
    np.testing.assert_allclose(part.threshold[:20], whole.threshold[:20], rtol=0.15)
    assert part.n_retained == whole.n_retained == 3
