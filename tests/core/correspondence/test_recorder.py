"""When an objective that fluctuates has stopped falling."""

import numpy as np
import pytest

from homolog.correspondence.recorder import RunRecorder


@pytest.mark.parametrize(
    ("slope", "noise", "stopped"), [(0.0, 0.003, True), (-1e-5, 0.0, True), (-0.001, 0.003, False)]
)
def test_a_level_objective_is_told_from_one_that_falls_although_it_fluctuates(slope, noise, stopped):
    log = RunRecorder(np.eye(4)[None], None, 1.0, None, None)
    random = np.random.default_rng(0)
    for k in range(20):
        log.iteration = 20 * k
        log.record(np.array([slope * k + noise * random.normal(), 0.0, 0.0]))
    assert log.has_plateaued(10, 2e-4) is stopped
