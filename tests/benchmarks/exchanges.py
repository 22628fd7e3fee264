"""Exchanged particles of results: by distances alone, by the objective too, and after all exchanges.

``python tests/benchmarks/exchanges.py PROJECT…`` prints for each how many pairs `homolog check` would call
exchanged by distances alone, how many of them an exchange of which lowers the objective (what it calls
exchanged), and how many are left when all exchanges that lower the objective are made, as a run does at its
end; with the number and the summed severity of all suspects, before and after.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from homolog.correspondence.exchanges import Exchanges
from homolog.inspection import Kind, assess, inspect
from homolog.inspection.energies import rows_of
from homolog.io.project import ProjectFolder
from homolog.run.repair import inspect_project


def exchanged(inspection):
    return sum(suspect.kind is Kind.EXCHANGED for suspect in inspection.suspects)


def severity(inspection):
    return sum(suspect.severity for suspect in inspection.suspects)


def by_distances_alone(located):
    lower, Exchanges.lower = Exchanges.lower, lambda *_: True
    try:
        return assess(located)
    finally:
        Exchanges.lower = lower


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("projects", nargs="+", type=Path)
    for folder in parser.parse_args().projects:
        result, before = inspect_project(ProjectFolder(folder))
        located = before.located
        exchanges = Exchanges(rows_of(located, before.consensus))
        begun = time.process_time()
        exchanges.make_all(np.ones(exchanges.order.shape, dtype=bool))
        seconds = time.process_time() - begun
        local = np.take_along_axis(located.local, exchanges.order[..., None], axis=1)
        after = inspect(local, located.meshes, located.alignments, names=result.names)
        moved = np.count_nonzero(exchanges.order != np.arange(exchanges.order.shape[1]))
        print(
            f"{folder.name}: exchanged {exchanged(by_distances_alone(located))} by distances, "
            f"{exchanged(before)} by the objective too, {exchanged(after)} after exchanges of {moved} of "
            f"{exchanges.order.size} particles ({seconds:.1f} CPU s); suspects {len(before.suspects)} to "
            f"{len(after.suspects)}, severity {severity(before):.0f} to {severity(after):.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
