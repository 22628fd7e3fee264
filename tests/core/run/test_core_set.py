import logging
from dataclasses import replace

import numpy as np
import pytest
import pyvista
from scipy.spatial.transform import Rotation

from homolog.errors import InputError
from homolog.grooming.cache import read_groomed
from homolog.io.results import read_result
from homolog.run import FinishReason, Phase
from homolog.run.choose_core import choose_core, outline
from homolog.surfaces.mesh import TriangleMesh


@pytest.fixture
def with_core(settings):
    """Settings with a core set of three, of four subjects."""
    optimize = settings.optimize.model_copy(update={"core_set": 3})
    return settings.model_copy(update={"optimize": optimize, "workers": 1})


@pytest.fixture
def outlines(finished):
    return [outline(read_groomed(finished.groomed, name)) for name in "abcd"]


def test_a_run_with_a_core_set_that_is_cancelled_among_its_fits_ends_as_one_that_is_not(
    start, with_core, groomed
):
    run = start(settings=with_core)
    fits_seen = []

    def cancel(status):
        if status.phase is Phase.FITTING and "fitting" in status.message:
            fits_seen.append((groomed.fits / "core.npz").is_file())
            run.cancel()

    assert run.execute(cancel) is FinishReason.CANCELLED
    assert all(fits_seen)
    assert len(fits_seen) > 0
    later = start(settings=with_core, resume=True)
    assert (
        later.execute(lambda _: (groomed.fits / "pass6").exists() and later.cancel())
        is FinishReason.CANCELLED
    )
    numbers = sorted(int(path.name.removeprefix("pass")) for path in groomed.fits.glob("pass*"))
    assert numbers == list(range(numbers[-1] - 2, numbers[-1] + 1))
    phases = []
    resumed = start(settings=with_core.model_copy(update={"workers": 2}), resume=True)
    assert resumed.execute(lambda status: phases.append(status.phase)) is FinishReason.COMPLETED
    assert Phase.OPTIMIZING not in phases
    assert not groomed.fits.exists()
    result = read_result(groomed)
    mapped = start(settings=with_core.model_copy(update={"memory": 0.1}))
    assert mapped.execute() is FinishReason.COMPLETED
    whole = read_result(groomed)
    np.testing.assert_array_equal(result.local, whole.local)
    np.testing.assert_allclose(result.world, whole.world, atol=1e-9)
    assert result.names == ("a", "b", "c", "d")
    centred = whole.world - whole.world.mean(axis=1, keepdims=True)
    apart = np.linalg.norm(centred - centred.mean(axis=0), axis=2)
    sizes = np.linalg.norm(centred, axis=2).mean(axis=1)
    assert (apart.mean(axis=1) < 0.35 * sizes).all()


def test_passes_after_a_core_set_that_spans_the_cohort_are_not_annealed(start, with_core, caplog):
    caplog.set_level(logging.INFO, logger="homolog.run.core_set")
    loose = {"regularization_start": 10.0, "regularization_end": 5.0}  # more than fits deviate
    optimize = with_core.optimize.model_copy(update=loose)
    start(settings=with_core.model_copy(update={"optimize": optimize})).execute()
    first, *_ = (record.args for record in caplog.records if "generalization" in record.msg)
    assert first[0] == 1


def test_a_core_set_does_not_use_landmarks(start, with_core, groomed):
    optimize = with_core.optimize.model_copy(update={"landmarks": True})
    with pytest.raises(InputError, match="landmarks"):
        start(settings=with_core.model_copy(update={"optimize": optimize})).execute()


def test_a_core_set_takes_its_share_of_every_group_and_the_same_each_time(outlines):
    many = [replace(item, name=f"{item.name}{copy}") for copy in range(3) for item in outlines]
    alignments = np.tile(np.eye(4), (12, 1, 1))
    groups = ["x"] * 3 + ["y"] * 9
    chosen = choose_core(many, alignments, groups, 6)
    assert len(set(chosen.tolist())) == 6
    assert np.count_nonzero(chosen < 3) == 2
    np.testing.assert_array_equal(chosen, choose_core(many, alignments, groups, 6))


def test_a_core_set_spans_the_sizes(outlines):
    alignments = np.tile(np.eye(4), (4, 1, 1))
    mesh = outlines[0].coarse_mesh
    scaled = [
        replace(outlines[0], coarse_mesh=TriangleMesh(factor * mesh.vertices, mesh.faces))
        for factor in (1.0, 1.02, 1.01, 1.6)
    ]
    assert 3 in choose_core(scaled, alignments, [None] * 4, 2)


def test_a_core_set_spans_the_ways_in_which_shapes_differ(outlines):
    widths = np.linspace(1.0, 1.3, 12)
    random = np.random.default_rng(0)
    sphere = pyvista.Icosphere(radius=1.0, nsub=3)
    stretched = [np.diag([width, 1.0 / width, 1.0]) for width in widths[random.permutation(12)]]
    turns = Rotation.random(12, random_state=1)  # each has vertices of its own
    many = [
        replace(
            outlines[0], coarse_mesh=TriangleMesh(turn.apply(sphere.points) @ stretch, sphere.regular_faces)
        )
        for turn, stretch in zip(turns, stretched, strict=True)
    ]
    chosen = choose_core(many, np.tile(np.eye(4), (12, 1, 1)), [None] * 12, 4)
    of_chosen = np.sort([stretched[index][0, 0] for index in chosen])
    assert of_chosen[0] == 1.0
    assert of_chosen[-1] == pytest.approx(1.3)
    assert np.diff(of_chosen).max() < 0.16
