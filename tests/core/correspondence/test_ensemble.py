import tracemalloc
from itertools import count

import numpy as np

from homolog.correspondence.ensemble import ShapeState, StateArrays, generalization_error, make_ensemble
from homolog.settings import OptimizeSettings


def random_states(number, particles):
    random = np.random.default_rng(0)
    base = random.normal(size=(particles, 3))
    for _ in range(number):
        aligned = base + 0.1 * random.normal(size=base.shape)
        normals = base + 0.2 * random.normal(size=base.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        openings = random.normal(size=particles).astype(np.float32)
        yield ShapeState(aligned, aligned.astype(np.float32), normals.astype(np.float32), openings, np.eye(4))


def ensemble_of(states, **how):
    settings = OptimizeSettings()
    return make_ensemble(states, settings, unit=1.0, area=0.0, opening_scale=1.0, templates=(1, 2), **how)


def test_states_in_arrays_give_the_same_ensemble_as_a_list():
    states = list(random_states(30, 300))
    arrays = StateArrays.of(states)
    workspace = np.full((30, 900), np.nan, np.float32)
    from_arrays = ensemble_of(arrays, workspace=workspace)
    for name, values in ensemble_of(states).arrays.items():
        np.testing.assert_array_equal(from_arrays.arrays[name], values)
    np.testing.assert_array_equal(arrays[-1].normals, states[-1].normals)
    assert generalization_error(arrays.aligned, workspace) == generalization_error(arrays.aligned)


def test_an_ensemble_of_many_needs_less_memory_than_their_states():
    arrays, places = StateArrays(3000, 100), count()
    for state in random_states(3000, 100):
        arrays[next(places)] = state
    workspace = np.empty((3000, 300), np.float32)
    tracemalloc.start()
    ensemble_of(arrays, workspace=workspace)
    generalization_error(arrays.aligned, workspace)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < arrays.local.nbytes + arrays.aligned.nbytes
