"""Faults at every stage of a run: programs, workers and schedulers ended, full disks.

    python tests/benchmarks/kill_stages.py FOLDER [--tries 20] [--only "SIGTERM"] [--minutes 60]

A small cohort is run twice without disturbance (a core set, and jointly), and its folder is copied whenever a
stage begins. Each try restores such a copy, resumes the run, and causes a fault at a random moment of the
stage: a random fraction of the processor time that the stage took the undisturbed program. Then the run is
resumed with another executor (one process, two processes, two Dask workers), and all files of the result
are compared with those of the undisturbed run. Before, the project has the result of another seed, which must
be read whole until it is replaced. Faults while pictures are drawn are tried on the finished run, those in
statistics by `homolog analyze`, whose tables are compared. The next try is one of the kind and stage with the
fewest. The folder keeps undisturbed runs and all tries, which can be made in several calls; each prints a
table of all: use a new folder for each version of Homolog. Programs are forked from a process that has
imported Homolog, so that a try takes few seconds. Disks are full tmpfs; Linux only, as root; needs
distributed.
"""

import argparse
import json
import pickle
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

import psutil
from fault_tries import CASES, SHARED, Cluster, Try, family, is_worker, left_over, print_table, read_log
from forked_programs import Program, Programs
from kill import contents, is_readable, write_cohort

from homolog.io.project import ProjectFolder

SETTINGS = (
    "--device cpu --alignment center --particles 16 --mesh-edge 4 --split-iterations 8 "
    "--anneal-iterations 20 --settle-iterations 10 --workers 2"
)
SUBJECTS, CORE, MEGABYTES = 5, 3, 48
JOINT = ("grooming", "tables", "optimizing", "writing")
"""Stages that a joint run has as well: three of four tries, as they take less time."""
OF_PHASE = {
    "grooming": "grooming",
    "geodesics": "tables",
    "splitting": "optimizing",
    "optimizing": "optimizing",
    "modeling": "writing",
    "writing": "writing",
}
DATE = re.compile(rb"\d{4}-\d\d-\d\dT[\d:]{8}\+00:00")
_WAIT_S = 300.0


@dataclass
class Undisturbed:
    """An undisturbed run: copies of the folder by stage, processor seconds of the stages, the result."""

    copies: dict[str, Path] = field(default_factory=dict)
    spans: dict[str, float] = field(default_factory=dict)
    result: dict[str, bytes] = field(default_factory=dict)
    before: dict[str, bytes] = field(default_factory=dict)


def stage_of(event: dict[str, object], project: ProjectFolder) -> str:
    """Return the stage that a line of the progress belongs to."""
    phase, message = event.get("phase"), str(event.get("message") or "")
    if phase == "fitting":
        if not message.startswith("fitting ") or message.startswith("fitting to"):
            return ""
        later = any(item.name != "pass0" for item in project.fits.glob("pass*"))
        return "passes" if later else "fitting"
    if phase is None:
        return "pictures" if "pictures" in message else ""
    return OF_PHASE.get(str(phase), "")


def wait_for(program: Program) -> str:
    """Let a program end; return its messages if it failed."""
    until = time.monotonic() + _WAIT_S
    while not program.has_ended():
        program.events()
        time.sleep(0.005)
        if time.monotonic() > until:
            program.send(signal.SIGKILL)
            return f"still ran after {_WAIT_S:.0f} s: {program.messages}"
    program.events()
    program.close()
    return program.messages if program.code else ""


class Trial:
    """The cohort, the undisturbed runs, and the disk on which tries are made."""

    def __init__(self, folder: Path, temporary: Path, disk: Path) -> None:
        self.folder, self.disk, self.project = folder, disk, ProjectFolder(disk / "project")
        self.programs, self.cluster = Programs(temporary), Cluster()
        self.known: dict[tuple[bool, bool], Undisturbed] = {}
        self.tables: dict[str, bytes] = {}
        self.pictures: dict[str, bytes] = {}
        self.harmed = False

    def end(self) -> None:
        """End all processes."""
        self.cluster.end()
        self.programs.end()

    def run(self, *how: object) -> Program:
        """Start or resume the run."""
        return self.programs.start("run", self.project.folder, *how, "--progress", "json")

    def done(self, *how: object) -> None:
        """Run without disturbance."""
        if said := wait_for(self.run(*how, "--no-figures")):
            raise RuntimeError(said)

    def prepare(self) -> None:
        """Read or make the undisturbed runs."""
        path = self.folder / "undisturbed.pickle"
        if not path.is_file():
            self.make()
            path.write_bytes(pickle.dumps((self.known, self.tables, self.pictures)))
        self.known, self.tables, self.pictures = pickle.loads(path.read_bytes())

    def make(self) -> None:
        """Make the undisturbed runs."""
        scans = self.folder / "scans"
        write_cohort(scans, SUBJECTS)
        rows = [f"shape{k},shape{k}.nrrd,{'ab'[k % 2]}" for k in range(SUBJECTS)]
        (scans / "cohort.csv").write_text("\n".join(["name,file,group", *rows]) + "\n")
        for joint in (False, True):
            self.clear()
            core = [] if joint else ["--core-set", CORE]
            first = ["run", scans, "--out", self.project.folder, *SETTINGS.split(), *core]
            if said := wait_for(self.programs.start(*first, "--seed", 1, "--no-figures")):
                raise RuntimeError(said)
            shutil.copytree(self.project.folder, self.folder / f"base{joint}")
            for dask in (False,) if joint else (False, True):
                self.watch(joint=joint, dask=dask)
        self.watch_statistics()

    def watch(self, *, joint: bool, dask: bool) -> None:
        """Run anew with another seed; copy the folder when each stage begins."""
        self.restore(self.folder / f"base{joint}")
        known = Undisturbed(before=contents(self.project.folder))
        for archive in sorted(self.project.groomed.glob("*.npz"))[::2]:
            archive.unlink()
        program = self.run("--restart", "--seed", 2, *self.executor(dask=dask))
        since: dict[str, float] = {}
        spent, now = 0.0, ""
        while not program.has_ended():
            for event in program.events():
                stage = stage_of(event, self.project)
                if stage != now and stage and stage not in since:
                    program.send(signal.SIGSTOP)
                    copy = self.folder / f"{joint}{dask}{stage}"
                    if stage != "pictures":
                        shutil.copytree(self.project.folder, copy, ignore=shutil.ignore_patterns(".lock"))
                        known.copies[stage] = copy
                    since[stage] = program.cpu_s()
                    program.send(signal.SIGCONT)
                if now != stage and now:
                    known.spans[now] = max(spent - since[now], 0.02)
                now = stage
            with suppress(OSError, IndexError):
                spent = program.cpu_s()
            time.sleep(0.002)
        if now:
            known.spans[now] = max(spent - since[now], 0.02)
        if said := wait_for(program):
            raise RuntimeError(said)
        known.result = contents(self.project.folder)
        if not (joint or dask):
            self.pictures = self.files("figures")
            shutil.copytree(self.project.folder, self.folder / "finished")
        known.copies["pictures"] = known.copies["writing"]
        self.known[joint, dask] = known
        print("joint" if joint else "core set", "Dask" if dask else "processes", known.spans, flush=True)

    def watch_statistics(self) -> None:
        """Analyze without disturbance."""
        self.restore(self.folder / "finished")
        began = time.monotonic()
        program = self.analyze()
        spent = 0.0
        while not program.has_ended():
            with suppress(OSError, IndexError):
                spent = program.cpu_s()
            program.events()
            time.sleep(0.002)
        if said := wait_for(program):
            raise RuntimeError(said)
        self.tables = self.files("analysis")
        known = self.known[False, False]
        known.spans["statistics"], known.copies["statistics"] = spent, self.folder / "finished"
        print(f"statistics: {spent:.1f} of {time.monotonic() - began:.1f} s", flush=True)

    def analyze(self) -> Program:
        """Start the statistics."""
        how = ["--permutations", 999, "--modes", 1, "--progress", "json"]
        return self.programs.start("analyze", self.project.folder, *how)

    def files(self, name: str) -> dict[str, bytes]:
        """Return the files in a folder of the project; without dates."""
        folder = self.project.folder / name
        every = sorted(path for path in folder.rglob("*") if path.is_file() and path.suffix != ".json")
        return {str(path.relative_to(folder)): DATE.sub(b"", path.read_bytes()) for path in every}

    def executor(self, *, dask: bool) -> list[object]:
        """Return the options for processes or for the cluster, which is started if it does not run."""
        if dask:
            self.cluster.start()
        return ["--cluster", self.cluster.address if dask else "none", "--workers", random.choice([1, 2])]

    def clear(self) -> None:
        """Empty the disk."""
        for item in self.disk.iterdir():
            shutil.rmtree(item) if item.is_dir() else item.unlink()

    def restore(self, copy: Path) -> None:
        """Restore a copy of the project."""
        self.clear()
        shutil.copytree(copy, self.project.folder)

    def harm(self, kind: str, program: Program) -> None:
        """Cause the fault."""
        if kind.startswith("kill -9"):
            program.send(signal.SIGKILL)
        elif kind.startswith("SIGTERM"):
            program.send(signal.SIGTERM)
        elif kind.startswith("full disk"):
            program.send(signal.SIGSTOP)
            with (self.disk / "filler").open("wb", buffering=0) as stream:
                for size in (1 << 20, 1 << 12):
                    with suppress(OSError):
                        while stream.write(bytes(size)) == size:
                            pass
            program.send(signal.SIGCONT)
        elif kind.endswith("Dask"):
            parts = self.cluster.parts
            (parts[0] if kind.startswith("scheduler") else random.choice(parts[1:])).kill()
        else:
            workers = [item for item in family(program.pid) if is_worker(item)]
            random.choice(workers).kill()

    def one(self, kind: str, stage: str, *, joint: bool) -> Try | None:
        """Make a try; None if the stage was over before the fault."""
        dask = kind.endswith("Dask")
        known = self.known[joint, dask and not joint]
        self.restore(known.copies[stage])
        for item in self.programs.temporary.iterdir():
            shutil.rmtree(item) if item.is_dir() else item.unlink()
        figures = [] if stage == "pictures" else ["--no-figures"]
        executor = self.executor(dask=dask) if stage in SHARED else []
        program = self.analyze() if stage == "statistics" else self.run("--resume", *executor, *figures)
        children = self.until_harmed(
            program, kind, stage, self.known[joint and not dask, dask].spans[stage] * random.random()
        )
        failed = wait_for(program)
        ended = {0: "finished", -signal.SIGKILL: "killed", -signal.SIGTERM: "killed"}.get(
            program.code or 0, "message"
        )
        if ended == "message" and (
            "Traceback" in failed or not ("homolog: " in failed or "cancelled" in failed)
        ):
            ended = f"ended badly ({program.code}): {failed[-600:]}"
        remaining = left_over(children)
        litter = len([item for item in self.programs.temporary.iterdir() if item.name.startswith("pymp-")])
        (self.disk / "filler").unlink(missing_ok=True)
        if not self.harmed:
            return None
        readable = is_readable(self.project) and self.is_whole(known)
        return Try(ended, readable, self.completed(stage, known), remaining, litter)

    def is_whole(self, known: Undisturbed) -> bool:
        """Return whether the project has the whole result from before or the whole new one."""
        found = contents(self.project.folder)
        own = {name: data for name, data in found.items() if not name.startswith(".")}
        begun = sorted(found.keys() - own.keys())
        if begun:
            print("begun:", len(begun), begun[0], flush=True)
        return own in (known.before, known.result)

    def until_harmed(self, program: Program, kind: str, stage: str, after_s: float) -> set[psutil.Process]:
        """Wait for the stage and some processor time in it, and cause the fault; return the processes."""
        self.harmed = False
        begun = 0.0 if stage == "statistics" else None
        while not program.has_ended():
            for event in program.events():
                if begun is None and stage_of(event, self.project) == stage:
                    with suppress(OSError, IndexError):
                        begun = program.cpu_s()
            with suppress(OSError, IndexError, psutil.Error):
                if begun is not None and program.cpu_s() - begun >= after_s:
                    children = family(program.pid)
                    self.harm(kind, program)
                    self.harmed = True
                    return children
            time.sleep(0.002)
        return set()

    def completed(self, stage: str, known: Undisturbed) -> bool:
        """Complete what was disturbed, with another executor, and compare the files."""
        if stage == "statistics":
            wait_for(self.analyze())
            tables = self.files("analysis")
            return tables == self.tables and contents(self.project.folder) == known.result
        if self.project.read().unfinished:
            way = random.choice([("none", 1), ("none", 2), *[(self.cluster.address, 2)] * 6])
            if way[0] != "none":
                self.cluster.start()
            self.done("--resume", "--cluster", way[0], "--workers", way[1])
        drawn = self.files("figures") if stage == "pictures" else {}
        whole = all(self.pictures.get(name) == data for name, data in drawn.items())
        return whole and contents(self.project.folder) == known.result


@contextmanager
def mounted(folder: Path) -> Iterator[Path]:
    """Mount a small disk."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={MEGABYTES}m", "tmpfs", folder], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def main() -> None:
    """Make the tries and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tries", type=int, default=20, help="of each kind at each stage")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="kinds with this word")
    parser.add_argument("--stage", default="", help="stages with this word")
    parser.add_argument("folder", type=Path, help="folder of the undisturbed runs and the tries")
    parser.add_argument("--minutes", type=float, default=1e6, help="time after which no try is begun")
    options = parser.parse_args()
    random.seed(options.seed)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # clean up
    until, rows = time.monotonic() + 60.0 * options.minutes, read_log(options.folder / "tries.jsonl")
    options.folder.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name, mounted(Path(name) / "disk") as disk:
        trial = Trial(options.folder, Path(name), disk)
        try:
            trial.prepare()
            cells = [(kind, stage) for kind, stages in CASES.items() for stage in stages]
            cells = [cell for cell in cells if options.only in cell[0] and options.stage in cell[1]]
            while time.monotonic() < until:
                kind, stage = min(cells, key=lambda cell: len(rows[cell]))
                number = len(rows[kind, stage])
                if number >= options.tries:
                    break
                joint = number % 4 > 0 and stage in JOINT
                went = trial.one(kind, stage, joint=joint)
                if went is None:  # the stage was over
                    continue
                print(kind, "|", stage, "|", "joint" if joint else "core set", "|", went, flush=True)
                rows[kind, stage].append(went)
                with (options.folder / "tries.jsonl").open("a") as log:
                    log.write(json.dumps({"kind": kind, "stage": stage, **asdict(went)}) + "\n")
        finally:
            trial.end()
    print_table(rows)
    every = [item for tries in rows.values() for item in tries]
    sys.exit(any(item.ended.startswith("ended badly") or not item.equal for item in every))


if __name__ == "__main__":
    main()
