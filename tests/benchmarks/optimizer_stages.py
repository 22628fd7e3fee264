"""Seconds of a whole optimization by stage, by the clock and of all processors.

    python tests/benchmarks/optimizer_stages.py FOLDER --sizes 10x1024 100x1024 500x1024

FOLDER as of `optimizer.py`. Shapes are copies of the beans that `--beans` says; with `--procrustes form` they
are aligned during the run. Every size is run in a process of its own, after a small run that loads the
kernels. Stages that a stage contains are not part of it, so that they add up to the whole; `rest` is what
none of them covers. A GPU is waited for at the end of a stage. `--functions N` also samples the main thread
and prints where it was most.
"""

import argparse
import collections
import functools
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import warp as wp
from optimizer import load, make_beans

from homolog.beans.generate import WIDE
from homolog.correspondence import divided, loop, optimize, prepared_cohort
from homolog.correspondence.engine import Engine
from homolog.correspondence.initialization import registration
from homolog.correspondence.loop import OptimizationLoop
from homolog.correspondence.recorder import RunRecorder
from homolog.device import choose_device, describe_device
from homolog.geodesics import solve
from homolog.geodesics.cuda import solver as cuda_solver
from homolog.settings import OptimizeSettings

STAGES = (
    (prepared_cohort, "field_array", "distance fields"),
    (prepared_cohort, "opening_array", "opening angles"),
    (divided, "opening_scale", "opening angles"),
    (solve, "plan_tables", "tables: check and plan"),
    (cuda_solver, "_upload", "tables: triangulate, cluster, copy"),
    (solve, "solve_on_cuda", "tables: solve"),
    (solve, "solve_on_cpu", "tables: solve"),
    (prepared_cohort, "build_surface_set", "surfaces to the device"),
    (divided, "prepare_cohort", "preparation, rest"),
    (loop, "InitialRegistration", "reference and its particles"),
    (registration.InitialRegistration, "particles", "registration"),
    (loop, "make_engine", "engines"),
    (OptimizationLoop, "split_particles", "splits"),
    (Engine, "iterate", "iterations"),
    (divided.DividedEngine, "iterate", "iterations"),
    (Engine, "energy", "energies"),
    (OptimizationLoop, "align", "poses"),
    (OptimizationLoop, "repair_misplaced", "misplaced particles"),
    (OptimizationLoop, "_relocate_lost", "lost particles"),
    (RunRecorder, "save", "checkpoints"),
    (RunRecorder, "emit_frame", "frames"),
    (OptimizationLoop, "result", "result"),
)


class Stopwatch:
    """Seconds of stages on the main thread, without those of stages inside."""

    def __init__(self, device):
        self.seconds, self.processor = collections.Counter(), collections.Counter()
        self.calls = collections.Counter()
        self._open, self._last, self._device = [], (0.0, 0.0), device

    @contextmanager
    def stage(self, name):
        """Time a stage."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        self._turn()
        self._open.append(name)
        self.calls[name] += 1
        try:
            yield
        finally:
            if self._device != "cpu":
                wp.synchronize()
            self._turn()
            self._open.pop()

    def _turn(self):
        now = time.perf_counter(), time.process_time()
        if self._open:
            self.seconds[self._open[-1]] += now[0] - self._last[0]
            self.processor[self._open[-1]] += now[1] - self._last[1]
        self._last = now


def watch(clock):
    """Time the calls of all stages with a stopwatch."""

    def timed(function, name):
        @functools.wraps(function, updated=())
        def call(*arguments, **named):
            with clock.stage(name):
                return function(*arguments, **named)

        return call

    for owner, attribute, name in STAGES:
        setattr(owner, attribute, timed(getattr(owner, attribute), name))


class Sampler(threading.Thread):
    """Counts the functions on the main thread's stack."""

    def __init__(self, interval=0.003):
        super().__init__(daemon=True)
        self.counts, self.total, self._interval = collections.Counter(), 0, interval
        self._main, self._stopped = threading.main_thread().ident, threading.Event()

    def run(self):
        """Take samples until stopped."""
        while not self._stopped.wait(self._interval):
            frame, seen = sys._current_frames().get(self._main), set()
            while frame is not None:
                code = frame.f_code
                seen.add(f"{Path(code.co_filename).name}:{code.co_firstlineno} {code.co_qualname}")
                frame = frame.f_back
            self.counts.update(seen)
            self.total += 1

    def stop(self):
        """Take no more samples."""
        self._stopped.set()
        self.join()


def one_size(shapes, device, particles, procrustes, functions):
    """Run, and print the stages."""
    settings = OptimizeSettings(particles=particles, procrustes=procrustes)
    optimize(shapes[: min(len(shapes), 10)], settings, device=device)
    clock = Stopwatch(device)
    watch(clock)
    sampler = Sampler() if functions else None
    if sampler:
        sampler.start()
    start, processor = time.perf_counter(), time.process_time()
    result = optimize(shapes, settings, device=device, checkpoint=lambda _: None)
    whole, processor = time.perf_counter() - start, time.process_time() - processor
    print(
        f"{len(shapes)} x {particles}, Procrustes {procrustes}: {whole:.2f} s, {processor:.2f} processor s, "
        f"{result.iterations} iterations, {result.reason.value}, "
        f"objective {result.energies[-1, 1:].sum():.6f}, checksum {result.local.sum():.9f}",
        flush=True,
    )
    clock.seconds["rest"] = whole - clock.seconds.total()
    clock.processor["rest"] = processor - clock.processor.total()
    print("   seconds      %  processor s   calls  stage")
    for name, seconds in clock.seconds.most_common():
        share, used = 100 * seconds / whole, clock.processor[name]
        print(f"  {seconds:8.3f} {share:6.1f} {used:12.3f} {clock.calls[name]:7d}  {name}", flush=True)
    if sampler:
        sampler.stop()
        for name, count in sampler.counts.most_common(functions):
            print(f"    {whole * count / sampler.total:8.2f} s  {name}", flush=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--device", default="auto")
    parser.add_argument("--sizes", nargs="+", default=["10x1024", "100x1024", "500x1024"])
    parser.add_argument("--beans", type=int, default=100, help="that shapes are copies of")
    parser.add_argument("--procrustes", default="off")
    parser.add_argument("--functions", type=int, default=0)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    path = arguments.folder / ("wide5.npz" if arguments.beans == 10 else f"wide5x{arguments.beans}.npz")
    if not path.exists():
        make_beans(arguments.folder, WIDE, 5, arguments.beans)
    device = choose_device(arguments.device)
    if len(arguments.sizes) > 1:
        print(describe_device(device), flush=True)
        for size in arguments.sizes:
            command = [sys.executable, __file__, str(arguments.folder), "--device", device, "--sizes", size]
            command += ["--beans", str(arguments.beans), "--functions", str(arguments.functions)]
            command += ["--procrustes", arguments.procrustes]
            subprocess.run(command, check=True)
        return 0
    count, particles = map(int, arguments.sizes[0].split("x"))
    beans = load(path)
    shapes = [replace(beans[k % len(beans)], name=f"copy{k}") for k in range(count)]
    one_size(shapes, device, particles, arguments.procrustes, arguments.functions)
    return 0


if __name__ == "__main__":
    sys.exit(main())
