import numpy as np
import pytest
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import GridSearchCV, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import check_estimator

from homolog.errors import InputError
from homolog.statistics.shape_model import ShapeModel


def test_modes_and_variances_are_those_of_the_full_covariance_matrix(ellipsoids):
    particles = ellipsoids(subjects=12, particles=9)
    model = ShapeModel().fit(particles)
    covariance = np.cov(particles.reshape(12, -1), rowvar=False)
    values, vectors = np.linalg.eigh(covariance)
    np.testing.assert_allclose(9 * model.explained_variance_, values[::-1][:11], rtol=1e-8)
    for mode, vector in zip(model.components_.reshape(11, -1), vectors.T[::-1], strict=False):
        assert abs(mode @ vector) == pytest.approx(3.0, abs=1e-9)


def test_the_primal_side_is_used_when_subjects_outnumber_coordinates(ellipsoids):
    particles = ellipsoids(subjects=40, particles=5)
    model = ShapeModel().fit(particles)
    values = np.linalg.eigvalsh(np.cov(particles.reshape(40, -1), rowvar=False))
    np.testing.assert_allclose(5 * model.explained_variance_, values[::-1], rtol=1e-8)
    np.testing.assert_allclose(model.inverse_transform(model.scores_), particles, atol=1e-9)


def test_modes_are_orthogonal_and_scores_rebuild_every_subject(ellipsoids):
    particles = ellipsoids()
    model = ShapeModel().fit(particles)
    flat = model.components_.reshape(len(model.components_), -1)
    np.testing.assert_allclose(flat @ flat.T / len(model.mean_), np.eye(len(flat)), atol=1e-9)
    np.testing.assert_allclose(model.inverse_transform(model.scores_), particles, atol=1e-9)
    np.testing.assert_allclose(model.transform(particles), model.scores_, atol=1e-9)
    assert model.explained_variance_ratio_.sum() == pytest.approx(1.0)


def test_one_standard_deviation_along_a_mode_is_that_far_from_the_mean(ellipsoids):
    model = ShapeModel().fit(ellipsoids())
    shape = model.instance([0.0, -2.0])
    distance = np.sqrt(np.square(shape - model.mean_).sum(axis=1).mean())
    assert distance == pytest.approx(2.0 * model.scores_[:, 1].std(ddof=1))
    assert model.transform(shape)[1] == pytest.approx(-2.0 * model.standard_deviations_[1])


def test_a_cohort_that_differs_in_size_only_has_no_modes_left_after_scaling(ellipsoids):
    first = ellipsoids(subjects=2)[0]
    particles = first * np.linspace(0.8, 1.2, 9)[:, None, None]
    assert ShapeModel().fit(particles).explained_variance_ratio_[0] == pytest.approx(1.0)
    scaled = ShapeModel(scaling=True).fit(particles)
    assert scaled.explained_variance_.sum() < 1e-12
    assert scaled.score(2.0 * particles + 3.0) > -1e-9  # other sizes and places are taken out


def test_the_same_shape_again_and_again_gives_a_model_without_modes(ellipsoids):
    particles = np.repeat(ellipsoids(subjects=2)[:1], 5, axis=0)
    model = ShapeModel().fit(particles)
    np.testing.assert_allclose(model.mean_, particles[0], atol=1e-12)
    assert np.isfinite(model.explained_variance_ratio_).all()
    assert model.explained_variance_.sum() < 1e-20


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
        ShapeModel().fit(particles, names=["Ann", "Ben", "Cleo", "Dan"][: len(particles)])


def test_scores_and_particles_that_are_not_of_the_model_are_refused(ellipsoids):
    model = ShapeModel().fit(ellipsoids())
    more = np.zeros(len(model.components_) + 1)
    for call in (model.instance, model.inverse_transform):
        for wrong in (more, 1.0):
            with pytest.raises(InputError, match=f"k at most {len(model.components_)}"):
                call(wrong)
    with pytest.raises(InputError, match=rf"\(..., {len(model.mean_)}, 3\), not \(5, 3\)"):
        model.transform(np.zeros((5, 3)))


def test_a_saved_model_is_read_as_it_was(ellipsoids, tmp_path):
    model = ShapeModel().fit(ellipsoids())
    model.save(tmp_path / "model.npz")
    read = ShapeModel.load(tmp_path / "model.npz")
    for name in ("mean_", "components_", "explained_variance_", "explained_variance_ratio_", "scores_"):
        np.testing.assert_array_equal(getattr(read, name), getattr(model, name))


def test_a_model_saved_with_modes_of_length_one_is_read_in_root_mean_squares(ellipsoids, tmp_path):
    model = ShapeModel().fit(ellipsoids())
    length = np.sqrt(len(model.mean_))
    np.savez(
        tmp_path / "before.npz",
        mean=model.mean_,
        components=model.components_ / length,
        sizes=np.ones(9),
        explained_variance=model.explained_variance_ * length**2,
        scores=model.scores_ * length,
    )
    read = ShapeModel.load(tmp_path / "before.npz")
    for name in ("components_", "explained_variance_", "scores_"):
        np.testing.assert_allclose(getattr(read, name), getattr(model, name), rtol=1e-12)


def test_what_is_no_saved_model_is_refused(ellipsoids, tmp_path):
    model = ShapeModel().fit(ellipsoids())
    with pytest.raises(InputError, match=r"model.txt: .*\.npz"):
        model.save(tmp_path / "model.txt")
    np.savez(tmp_path / "other.npz", mean=model.mean_)
    np.savez(
        tmp_path / "odd.npz",
        mean=model.mean_,
        components=model.components_,
        explained_variance=[1.0],
        scores=model.scores_,
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
    model = ShapeModel().fit(ellipsoids())
    shapes = model.sample(20_000, random_state=3)
    np.testing.assert_allclose(model.transform(shapes).var(axis=0), model.explained_variance_, rtol=0.05)
    np.testing.assert_array_equal(model.sample(2, random_state=3), shapes[:2])


@pytest.mark.filterwarnings("ignore")
def test_a_shape_model_passes_the_checks_of_scikit_learn_but_for_the_class_of_one_error():
    results = check_estimator(ShapeModel(), on_fail=None, on_skip=None)
    failed = {item["check_name"]: item["exception"] for item in results if item["status"] == "failed"}
    assert failed.keys() == {"check_dtype_object"}, failed
    assert isinstance(failed["check_dtype_object"], InputError)  # a ValueError instead of a TypeError
    assert len(results) > 30


def test_flattened_particles_give_the_modes_of_particles(ellipsoids):
    particles = ellipsoids()
    flat = particles.reshape(len(particles), -1)
    model, of_flat = ShapeModel().fit(particles), ShapeModel().fit(flat)
    np.testing.assert_array_equal(of_flat.scores_, model.scores_)
    np.testing.assert_array_equal(of_flat.mean_, model.mean_.ravel())
    assert of_flat.instance([1.0]).shape == flat[0].shape
    shares = PCA().fit(flat).explained_variance_ratio_[: model.n_components_]
    np.testing.assert_allclose(model.explained_variance_ratio_, shares, rtol=1e-9)


def test_as_many_modes_are_kept_as_are_asked_for(ellipsoids):
    particles = ellipsoids()
    every = ShapeModel().fit(particles)
    assert ShapeModel(2).fit(particles).components_.shape == (2, *particles.shape[1:])
    np.testing.assert_array_equal(
        ShapeModel(2).fit(particles).explained_variance_ratio_, every.explained_variance_ratio_[:2]
    )
    share = float(every.explained_variance_ratio_[:2].sum())
    assert ShapeModel(share - 1e-6).fit(particles).n_components_ == 2
    assert ShapeModel(share + 1e-6).fit(particles).n_components_ == 3
    for wrong in (0, -1, 1.5, "two"):
        with pytest.raises(InputError, match="n_components="):
            ShapeModel(wrong).fit(particles)


def test_the_number_of_modes_is_chosen_by_cross_validation(ellipsoids):
    random = np.random.default_rng(0)
    modes = np.linalg.qr(random.normal(size=(150, 2)))[0].T
    particles = ellipsoids(subjects=2, particles=50)[:1] + (
        random.normal(size=(40, 2)) * (30.0, 10.0) @ modes + random.normal(scale=0.05, size=(40, 150))
    ).reshape(40, 50, 3)
    scores = [cross_val_score(ShapeModel(count), particles, cv=4).mean() for count in (1, 2)]
    assert scores[0] < 10 * scores[1] < 0.0
    search = GridSearchCV(ShapeModel(), {"n_components": [1, 2]}, cv=4).fit(particles)
    assert search.best_params_ == {"n_components": 2}


def test_a_shape_model_feeds_a_classifier_in_a_pipeline(ellipsoids):
    particles = ellipsoids(subjects=20)
    longer = particles[:, :, 0].std(axis=1)
    labels = longer > np.median(longer)
    pipeline = make_pipeline(ShapeModel(3), LogisticRegression())
    assert cross_val_score(pipeline, particles, labels, cv=4).mean() > 0.7


def test_a_seed_given_to_the_model_repeats_its_samples(ellipsoids):
    model = ShapeModel(random_state=3).fit(ellipsoids())
    np.testing.assert_array_equal(model.sample(2), model.sample(2))
    again = clone(model)
    assert repr(again) == "ShapeModel(random_state=3)"
    with pytest.raises(InputError, match="not fitted"):
        again.sample(2)


def test_a_model_without_size_is_saved_with_the_size_that_it_takes_shapes_to(ellipsoids, tmp_path):
    particles = ellipsoids()
    ShapeModel(2, scaling=True).fit(particles).save(tmp_path / "model.npz")
    read = ShapeModel.load(tmp_path / "model.npz")
    assert read.n_components_ == 2
    np.testing.assert_allclose(read.transform(particles), read.scores_, atol=1e-6)
