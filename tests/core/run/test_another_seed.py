"""The quick second run with another seed."""

from types import SimpleNamespace

import numpy as np

from homolog.run import another_seed


def outcome_of(count, subjects):
    settings = SimpleNamespace(placing=SimpleNamespace(seed=7, model_copy=lambda update: update))
    local = np.random.default_rng(0).normal(size=(subjects, count, 3))
    return SimpleNamespace(
        inputs=SimpleNamespace(shapes=list(range(subjects)), settings=settings),
        local=local,
        world=local,
        alignments=np.tile(np.eye(4), (subjects, 1, 1)),
    )


def test_few_particles_are_not_placed_again():
    assert another_seed.agreement_of_seeds(outcome_of(128, 5), "cpu", lambda *_: None) is None


def test_another_seed_places_fewer_particles_on_at_most_eight_subjects(monkeypatch):
    given = []

    def optimize(shapes, settings, **_):
        given.append((shapes, settings))
        return SimpleNamespace(local=outcome.local[shapes][:, :50])

    outcome = outcome_of(300, 30)
    monkeypatch.setattr(another_seed, "optimize", optimize)
    assert another_seed.agreement_of_seeds(outcome, "cpu", lambda *_: None) is not None
    ((shapes, settings),) = given
    assert (len(shapes), shapes[0], shapes[-1]) == (8, 0, 29)
    assert (settings["seed"], settings["particles"]) == (8, 128)
