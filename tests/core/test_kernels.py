"""Kernels for GPUs, compiled without one."""

import sys
from importlib import import_module
from pathlib import Path

import pytest
import warp as wp

import homolog

ROOT = Path(homolog.__file__).parent
MODULES = sorted(
    ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
    for path in ROOT.rglob("*.py")
    if "@wp.kernel" in path.read_text(encoding="utf-8")
)
TURING = 75  # the oldest GPUs that CUDA 13, so Warp, supports


@pytest.mark.skipif(sys.platform == "darwin", reason="Warp has no CUDA compiler there")
@pytest.mark.parametrize("name", MODULES)
def test_kernels_compile_for_the_oldest_gpus_too(name, tmp_path):
    parts = vars(import_module(name)).values()
    kernel = next(part for part in parts if isinstance(part, wp.Kernel) and part.module.name == name)
    wp.compile_aot_module(kernel.module, arch=TURING, module_dir=tmp_path, use_ptx=True)
    assert list(tmp_path.glob("*.ptx"))
