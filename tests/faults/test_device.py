"""A GPU that is lost or full: the run stops with its state saved and says how to go on."""

import numpy as np
import pytest

from homolog.correspondence.engine import Engine
from homolog.device import device_faults
from homolog.errors import InputError

LOST = "Warp CUDA error 719: unspecified launch failure (in function wp_cuda_launch_kernel)"
FULL = "Failed to allocate 8589934592 bytes on device 'cuda:0'"


def test_a_run_that_loses_its_gpu_is_resumed_on_the_cpu(project, run_of, results, monkeypatch):
    whole, launches = results(project.folder), 0

    def iterate(self, times, real=Engine.iterate):
        nonlocal launches
        launches += 1
        if launches > 5:
            raise RuntimeError(LOST)
        real(self, times)

    with monkeypatch.context() as machine:
        machine.setattr(Engine, "iterate", iterate)
        machine.setattr("homolog.run.run.device_faults", lambda alias: device_faults("cuda:0"))
        with pytest.raises(InputError, match=r"cuda:0: failed \(Warp CUDA error 719.*on the device cpu"):
            run_of(project).execute()
    assert project.read().unfinished
    assert project.checkpoint.is_file()
    assert results(project.folder) == whole
    run_of(project, resume=True).execute()
    assert results(project.folder) == whole


def test_a_full_gpu_is_told_with_what_helps():
    words = r"cuda:0: has too little memory \(Failed to allocate .*free memory, or use fewer .*device cpu"
    with pytest.raises(InputError, match=words), device_faults("cuda:0"):
        raise RuntimeError(FULL)


def test_memory_that_is_full_is_told_on_the_cpu_too():
    with pytest.raises(InputError, match=r"cpu: has too little memory"), device_faults("cpu"):
        np.empty(2**59)
    with pytest.raises(InputError, match=r"cpu: has too little memory"), device_faults("cpu"):
        raise RuntimeError(FULL)


@pytest.mark.parametrize(("alias", "error"), [("cpu", RuntimeError), ("cuda:0", NotImplementedError)])
def test_defects_of_the_program_are_not_blamed_on_the_device(alias, error):
    with pytest.raises(error, match="a defect"), device_faults(alias):
        raise error("a defect")
