from dataclasses import replace

import numpy as np
import pytest

from homolog.errors import InputError
from homolog.files.results import read_result
from homolog.grooming.cache import read_groomed
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
    assert {path.name for path in groomed.fits.glob("pass*")} == {"pass4", "pass5", "pass6"}
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
