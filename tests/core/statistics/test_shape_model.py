import numpy as np
import pytest

from homolog.errors import InputError
from homolog.statistics.shape_model import ShapeModel


def test_modes_and_variances_are_those_of_the_full_covariance_matrix(ellipsoids):
    particles = ellipsoids(subjects=12, particles=9)
    model = ShapeModel.fit(particles)
    covariance = np.cov(particles.reshape(12, -1), rowvar=False)
    values, vectors = np.linalg.eigh(covariance)
    np.testing.assert_allclose(9 * model.explained_variance, values[::-1][:11], rtol=1e-8)
    for mode, vector in zip(model.components.reshape(11, -1), vectors.T[::-1], strict=False):
        assert abs(mode @ vector) == pytest.approx(3.0, abs=1e-9)


def test_the_primal_side_is_used_when_subjects_outnumber_coordinates(ellipsoids):
    particles = ellipsoids(subjects=40, particles=5)
    model = ShapeModel.fit(particles)
    values = np.linalg.eigvalsh(np.cov(particles.reshape(40, -1), rowvar=False))
    np.testing.assert_allclose(5 * model.explained_variance, values[::-1], rtol=1e-8)
    np.testing.assert_allclose(model.inverse_transform(model.scores), particles, atol=1e-9)


def test_modes_are_orthogonal_and_scores_rebuild_every_subject(ellipsoids):
    particles = ellipsoids()
    model = ShapeModel.fit(particles)
    flat = model.components.reshape(len(model.components), -1)
    np.testing.assert_allclose(flat @ flat.T / len(model.mean), np.eye(len(flat)), atol=1e-9)
    np.testing.assert_allclose(model.inverse_transform(model.scores), particles, atol=1e-9)
    np.testing.assert_allclose(model.transform(particles), model.scores, atol=1e-9)
    assert model.explained_variance_ratio.sum() == pytest.approx(1.0)


def test_one_standard_deviation_along_a_mode_is_that_far_from_the_mean(ellipsoids):
    model = ShapeModel.fit(ellipsoids())
    shape = model.instance([0.0, -2.0])
    distance = np.sqrt(np.square(shape - model.mean).sum(axis=1).mean())
    assert distance == pytest.approx(2.0 * model.scores[:, 1].std(ddof=1))
    assert model.transform(shape)[1] == pytest.approx(-2.0 * model.standard_deviations[1])


def test_a_cohort_that_differs_in_size_only_has_no_modes_left_after_scaling(ellipsoids):
    first = ellipsoids(subjects=2)[0]
    particles = first * np.linspace(0.8, 1.2, 9)[:, None, None]
    assert ShapeModel.fit(particles).explained_variance_ratio[0] == pytest.approx(1.0)
    scaled = ShapeModel.fit(particles, scaling=True)
    assert scaled.explained_variance.sum() < 1e-12
    np.testing.assert_allclose(scaled.sizes / scaled.sizes[4], np.linspace(0.8, 1.2, 9))


def test_the_same_shape_again_and_again_gives_a_model_without_modes(ellipsoids):
    particles = np.repeat(ellipsoids(subjects=2)[:1], 5, axis=0)
    model = ShapeModel.fit(particles)
    np.testing.assert_allclose(model.mean, particles[0], atol=1e-12)
    assert np.isfinite(model.explained_variance_ratio).all()
    assert model.explained_variance.sum() < 1e-20


@pytest.mark.parametrize(
    ("particles", "message"),
    [
        (np.zeros((1, 8, 3)), "at least two subjects"),
        (np.zeros((4, 8, 2)), "shape"),
        (np.full((3, 8, 3), np.nan), "Ann, Ben, Cleo: particle positions that are not finite"),
    ],
)
def test_particles_that_no_model_can_be_fitted_to_are_refused_by_name(particles, message):
    with pytest.raises(InputError, match=message):
        ShapeModel.fit(particles, names=["Ann", "Ben", "Cleo", "Dan"][: len(particles)])


def test_scores_and_particles_that_are_not_of_the_model_are_refused(ellipsoids):
    model = ShapeModel.fit(ellipsoids())
    more = np.zeros(len(model.components) + 1)
    for call in (model.instance, model.inverse_transform):
        for wrong in (more, 1.0):
            with pytest.raises(InputError, match=f"k at most {len(model.components)}"):
                call(wrong)
    with pytest.raises(InputError, match=rf"\(..., {len(model.mean)}, 3\), not \(5, 3\)"):
        model.transform(np.zeros((5, 3)))


def test_a_saved_model_is_read_as_it_was(ellipsoids, tmp_path):
    model = ShapeModel.fit(ellipsoids())
    model.save(tmp_path / "model.npz")
    read = ShapeModel.load(tmp_path / "model.npz")
    for name in ("mean", "components", "explained_variance", "scores", "sizes"):
        np.testing.assert_array_equal(getattr(read, name), getattr(model, name))


def test_a_model_saved_with_modes_of_length_one_is_read_in_root_mean_squares(ellipsoids, tmp_path):
    model = ShapeModel.fit(ellipsoids())
    length = np.sqrt(len(model.mean))
    np.savez(
        tmp_path / "before.npz",
        mean=model.mean,
        components=model.components / length,
        sizes=model.sizes,
        explained_variance=model.explained_variance * length**2,
        scores=model.scores * length,
    )
    read = ShapeModel.load(tmp_path / "before.npz")
    for name in ("components", "explained_variance", "scores"):
        np.testing.assert_allclose(getattr(read, name), getattr(model, name), rtol=1e-12)


def test_what_is_no_saved_model_is_refused(ellipsoids, tmp_path):
    model = ShapeModel.fit(ellipsoids())
    with pytest.raises(InputError, match=r"model.txt: .*\.npz"):
        model.save(tmp_path / "model.txt")
    np.savez(tmp_path / "other.npz", mean=model.mean)
    np.savez(
        tmp_path / "odd.npz",
        mean=model.mean,
        components=model.components,
        explained_variance=[1.0],
        scores=model.scores,
        sizes=model.sizes,
    )
    for name in ("other.npz", "odd.npz"):
        with pytest.raises(InputError, match=f"{name}: contains no shape model"):
            ShapeModel.load(tmp_path / name)


def test_a_file_that_is_no_model_is_not_to_be_thrown_away(tmp_path):
    (tmp_path / "README.md").write_text("# Mine")
    with pytest.raises(InputError, match=r"README\.md: .*give a file that ShapeModel\.save wrote") as caught:
        ShapeModel.load(tmp_path / "README.md")
    assert "delete" not in str(caught.value).replace(str(tmp_path), "")


def test_samples_have_the_variances_of_the_model_and_repeat_by_seed(ellipsoids):
    model = ShapeModel.fit(ellipsoids())
    shapes = model.sample(20_000, seed=3)
    np.testing.assert_allclose(model.transform(shapes).var(axis=0), model.explained_variance, rtol=0.05)
    np.testing.assert_array_equal(model.sample(2, seed=3), shapes[:2])
