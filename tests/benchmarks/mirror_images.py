"""How many mirror images are found among subjects, each subject of a cohort being mirrored in turn.

    python tests/benchmarks/mirror_images.py shared/data/zoo/brain_ventricle shared/data/zoo/brain_hippocampus

Others that get a note, and those that get one when nobody is mirrored, are counted, too. With --half every
other subject is mirrored at once.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

from homolog.cohort import Cohort, read_cohort
from homolog.grooming import groom_cohort
from homolog.progress import no_tick
from homolog.registration.align import register
from homolog.registration.icp import registered
from homolog.registration.mirror_images import better_mirrored
from homolog.settings import GroomSettings
from homolog.surfaces.mirroring import MIRROR


def flagged(subjects, settings):
    """Return the names that get a note, with ICP as in a run."""
    alignments = register(subjects, settings).alignments
    return better_mirrored(subjects, alignments, (), True, registered, no_tick)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("cohorts", type=Path, nargs="+")
    parser.add_argument("--subjects", type=int, default=12, help="use the first N subjects (default 12)")
    parser.add_argument("--half", action="store_true", help="mirror every other subject at once")
    arguments = parser.parse_args()
    settings = GroomSettings()
    for folder in arguments.cohorts:
        cohort = read_cohort(folder)
        subjects = groom_cohort(Cohort(cohort.subjects[: arguments.subjects], cohort.folder), settings)
        start = time.process_time()
        none = flagged(subjects, settings)
        seconds = (time.process_time() - start) / len(subjects)
        images = [
            replace(item, mesh=item.mesh.placed(MIRROR), coarse_mesh=item.coarse_mesh.placed(MIRROR))
            for item in subjects
        ]
        if arguments.half:
            mixed = [pair[k % 2] for k, pair in enumerate(zip(subjects, images, strict=True))]
            names = sorted(flagged(mixed, settings))
            print(f"{folder.name}: every other one mirrored: {len(names)} flagged ({names})", flush=True)
            continue
        hits = others = 0
        for k, item in enumerate(subjects):
            names = flagged([*subjects[:k], images[k], *subjects[k + 1 :]], settings)
            hits += item.name in names
            others += len(names - {item.name})
        print(
            f"{folder.name}: {hits} of {len(subjects)} mirror images found, {others} others flagged; "
            f"{len(none)} flagged if nobody is mirrored; {seconds:.2f} CPU s a subject with alignment",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
