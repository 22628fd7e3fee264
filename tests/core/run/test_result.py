"""What a result says about particles that were put right."""

from dataclasses import replace

import numpy as np
import pytest

from homolog.correspondence import OptimizedParticles, Reason
from homolog.run.repair import read_inputs
from homolog.run.result import add_repair_notes


@pytest.fixture
def inputs(finished):
    return read_inputs(finished)


@pytest.fixture
def result(inputs):
    """Return an optimization of the study's subjects in which nothing was put right."""
    shapes = len(inputs.shapes)
    energies = np.array([[20, -1.0, 0.5, 0.2], [40, -1.0, 0.4, 0.2], [60, -1.0, 0.3, 0.1]])
    points = np.zeros((shapes, 8, 3))
    repaired = np.zeros((shapes, 8), np.int32)
    poses = np.stack([np.eye(4)] * shapes)
    return OptimizedParticles(points, points, points, energies, poses, 60, Reason.CONVERGED, repaired)


def test_subjects_with_repaired_particles_say_so(inputs, result):
    repaired = result.repaired.copy()
    repaired[1, [2, 5]] = 40
    repaired[2, 3] = 60
    add_note = add_repair_notes(inputs, replace(result, repaired=repaired))
    notes = [
        item.report.notes[len(old.report.notes) :]
        for item, old in zip(add_note.groomed, inputs.groomed, strict=True)
    ]
    assert [len(each) for each in notes] == [int(k in (1, 2)) for k in range(len(inputs.shapes))]
    particles = repaired.shape[1]
    assert f"2 of {particles}" in notes[1][0]
    assert f"1 of {particles}" in notes[2][0]


def test_a_subject_with_many_repaired_particles_may_be_another_structure(inputs, result):
    repaired = result.repaired.copy()
    repaired[1, :2], repaired[2, :3] = 40, 40
    changed = add_repair_notes(inputs, replace(result, repaired=repaired)).groomed
    assert [any("same structure" in note for note in item.report.notes) for item in changed] == [
        k == 2 for k in range(len(inputs.shapes))
    ]


def test_where_nothing_was_repaired_nothing_is_noted(inputs, result):
    assert add_repair_notes(inputs, result) is inputs
