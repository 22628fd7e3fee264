"""A GPU that is lost or full: the run stops with its state saved and says how to go on."""

from dataclasses import replace

import numpy as np
import pytest

from homolog.correspondence.engine import Engine
from homolog.device import device_faults
from homolog.errors import InputError
from homolog.io.particles import read_particles
from homolog.run.repair import read_inputs, repair_result

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
        machine.setattr("homolog.run.steps.device_faults", lambda alias: device_faults("cuda:0"))
        with pytest.raises(InputError, match=r"cuda:0: .* 719.*device cpu"):
            run_of(project).execute()
    assert project.read().unfinished
    assert project.checkpoint.is_file()
    assert results(project.folder) == whole
    run_of(project, resume=True).execute()
    assert results(project.folder) == whole


@pytest.mark.parametrize(
    ("place", "fault", "text"),
    [
        ("homolog.run.steps.load_kernels", LOST, "failed"),
        ("homolog.run.table_cache.load_table", LOST, "failed"),
        ("homolog.run.table_cache.each_table", FULL, "has too little memory"),
        ("homolog.correspondence.prepared_cohort.field_array", FULL, "has too little memory"),
        ("homolog.correspondence.prepared_cohort.build_surface_set", LOST, "failed"),
    ],
)
def test_a_gpu_that_is_lost_or_full_at_any_other_moment_leaves_the_last_result(
    project, run_of, results, monkeypatch, place, fault, text
):
    def fail(*_, **__):
        raise RuntimeError(fault)

    whole = results(project.folder)
    with monkeypatch.context() as machine:
        machine.setattr(place, fail)
        machine.setattr("homolog.run.steps.device_faults", lambda alias: device_faults("cuda:0"))
        with pytest.raises(InputError, match=rf"cuda:0: {text} .*kept: .*device cpu"):
            run_of(project).execute()
    assert project.read().unfinished
    assert results(project.folder) == whole


def test_a_gpu_that_is_lost_while_particles_are_repaired_changes_nothing(project, results, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError(LOST)

    whole, study = results(project.folder), read_inputs(project)
    monkeypatch.setattr("homolog.run.repair.repair", fail)
    local = np.stack([read_particles(path) for path in sorted(project.particles.glob("*_local.particles"))])
    movable = np.full(local.shape[:2], True)
    with pytest.raises(InputError, match=r"cuda:0: .*CUDA error 719"):
        repair_result(replace(study, device="cuda:0"), local, movable, movable)
    assert results(project.folder) == whole


def test_memory_that_is_full_while_grooming_is_told(project, run_of, results, monkeypatch):
    def fail(*_, **__):
        raise MemoryError("Unable to allocate 9.31 GiB for an array")

    whole = results(project.folder)
    monkeypatch.setattr("homolog.run.run.groom_cohort", fail)
    with pytest.raises(InputError, match=r"cpu: .* memory \(.* 9\.31 GiB"):
        run_of(project).execute()
    assert results(project.folder) == whole


def test_a_full_gpu_is_told_with_what_helps():
    text = r"cuda:0: has too little memory \(Failed to allocate .*free memory, or use fewer .*device cpu"
    with pytest.raises(InputError, match=text), device_faults("cuda:0"):
        raise RuntimeError(FULL)


def test_memory_that_is_full_is_told_on_the_cpu_too():
    with pytest.raises(InputError, match=r"cpu: .* too little memory"), device_faults("cpu"):
        np.empty(2**59)
    with pytest.raises(InputError, match=r"cpu: .* too little memory"), device_faults("cpu"):
        raise RuntimeError(FULL)


@pytest.mark.parametrize(("alias", "error"), [("cpu", RuntimeError), ("cuda:0", NotImplementedError)])
def test_defects_of_the_program_are_not_blamed_on_the_device(alias, error):
    with pytest.raises(error, match="a defect"), device_faults(alias):
        raise error("a defect")


def test_kernels_that_a_lost_gpu_cannot_load_are_a_fault_of_the_device_and_other_errors_are_not():
    with pytest.raises(InputError, match="cuda:0: failed"), device_faults("cuda:0"):
        raise Exception("Failed to load CUDA module 'x' (device='cuda:0')")
    with pytest.raises(IndexError), device_faults("cuda:0"):
        raise IndexError
    with pytest.raises(RuntimeError, match="a mistake"), device_faults("cpu"):
        raise RuntimeError("a mistake")
