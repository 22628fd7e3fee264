"""How long a run takes to stop when it is told to, in every phase.

    python tests/benchmarks/cancel.py FOLDER --subjects 10 --particles 1024 --times 4

Makes coffee beans in FOLDER, runs them once, then cancels runs at moments spread over each phase. A run has
stopped when its observer hears so; what is written first (a checkpoint, say) counts. `between ticks` is the
longest time between two chances to cancel in the run that was not cancelled; in processor seconds of the
working thread it is what remains on an idle machine.
"""

import argparse
import os
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path

from homolog.beans.files import write_beans
from homolog.beans.generate import draw_beans
from homolog.io.project import ProjectFolder
from homolog.run import FinishReason, Phase, Run
from homolog.run.control import Control
from homolog.settings import GroomSettings, OptimizeSettings, RunSettings


def watched(run):
    """Execute a run; return by phase its seconds and the longest wait for a tick, wall and processor."""
    seconds, between = defaultdict(float), defaultdict(lambda: (0.0, 0.0))
    last = [time.perf_counter(), time.thread_time()]
    tick, enter = Control.tick, Control.move_to
    phase = [Phase.READING]

    def note(control):
        now = [time.perf_counter(), time.thread_time()]
        gap = tuple(b - a for a, b in zip(last, now, strict=True))
        seconds[phase[0]] += gap[0]
        between[phase[0]] = tuple(map(max, gap, between[phase[0]]))
        last[:] = now

    def ticking(control, fraction, message):
        note(control)
        tick(control, fraction, message)

    def moving(control, following):
        note(control)
        phase[0] = following
        enter(control, following)

    Control.tick, Control.move_to = ticking, moving
    try:
        if run.execute() is not FinishReason.COMPLETED:
            raise RuntimeError("the run did not complete")
    finally:
        Control.tick, Control.move_to = tick, enter
    return seconds, between


def stopped(run, phase, delay):
    """Cancel a run so many seconds after a phase has begun; return the seconds until it stopped, or None."""
    begun, questions, messages = threading.Event(), [], []

    def observer(status):
        if status.phase is phase and not begun.is_set():
            begun.set()
        if status.reason is not None:
            messages.append((time.perf_counter(), status))

    def ask():
        if begun.wait(600):
            time.sleep(delay)
            questions.append(time.perf_counter())
            run.cancel()

    worker = threading.Thread(target=ask, daemon=True)
    worker.start()
    run.execute(observer)
    ((when, status),) = messages
    if status.reason is not FinishReason.CANCELLED or status.phase is not phase:
        return None
    return when - questions[0]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--subjects", type=int, default=10)
    parser.add_argument("--particles", type=int, default=1024)
    parser.add_argument("--times", type=int, default=4)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    cohort = write_beans(arguments.folder / "beans", draw_beans(arguments.subjects), 5)
    short = OptimizeSettings(
        particles=arguments.particles, split_iterations=10, anneal_iterations=40, settle_iterations=20
    )
    settings = RunSettings(groom=GroomSettings(), optimize=short, device="cpu")
    project = ProjectFolder(arguments.folder / "project")
    seconds, between = watched(Run(project, cohort, settings))
    print(f"{arguments.subjects} subjects x {arguments.particles} particles, load {os.getloadavg()[0]:.1f}")
    print("| phase | takes s | between ticks s | processor s | stopped after s, worst of | load |")
    print("|---|---|---|---|---|---|", flush=True)
    for phase in Phase:
        if phase is Phase.GROOMING:
            for file in project.groomed.iterdir():
                file.unlink()
        waits = []
        for number in range(arguments.times):
            wait = stopped(Run(project, cohort, settings), phase, seconds[phase] * number / arguments.times)
            waits += [] if wait is None else [wait]
        worst = f"{max(waits):.2f} of {len(waits)}" if waits else "over before"
        wall, processor = between[phase]
        figures = f"{seconds[phase]:.2f} | {wall:.2f} | {processor:.2f} | {worst} | {os.getloadavg()[0]:.1f}"
        print(f"| {phase} | {figures} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
