"""Processor and wall seconds of each step of comparing one patient, its report included.

    python tests/benchmarks/patient_speed.py REFERENCE FILE

REFERENCE is a file of `homolog reference`, FILE a segmentation or mesh. Kernels should have been compiled
before (by any run). Prints a table in Markdown.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path

ROWS: list[tuple[str, float, float]] = []
_last = [0.0, time.perf_counter() - time.process_time()]


def done(step: str) -> None:
    """Note what has passed since the step before."""
    now = [time.process_time(), time.perf_counter()]
    ROWS.append((step, now[0] - _last[0], now[1] - _last[1]))
    _last[:] = now


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("reference", type=Path)
    parser.add_argument("file", type=Path)
    arguments = parser.parse_args()
    from homolog.cohort import Subject
    from homolog.grooming import groom_subject
    from homolog.patient import compare_groomed
    from homolog.patient.reference import Reference

    done("imports")
    reference = Reference.load(arguments.reference)
    done("reading the reference")
    groomed = groom_subject(
        Subject(arguments.file.name.split(".")[0], arguments.file), reference.provenance.groom
    )
    done("grooming")
    compare_groomed(reference, groomed, force=True)
    done("fits, maps and particles")
    from homolog_app.report.patient import PatientRequest, write_patients

    done("imports of the report")
    with tempfile.TemporaryDirectory() as folder:
        request = PatientRequest((arguments.file,), {}, "", None, True, (), False, ())
        write_patients(Path(folder), reference, request, lambda fraction, message: None)
    done("all again, with the report")
    ROWS[-1] = ("report", *(ROWS[-1][k] - ROWS[2][k] - ROWS[3][k] for k in (1, 2)))
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}\n")
    print("| step | processor s | wall s |\n|---|---|---|")
    for step, processor, wall in [*ROWS, ("whole", *(sum(row[k] for row in ROWS) for k in (1, 2)))]:
        print(f"| {step} | {processor:.2f} | {wall:.2f} |")


if __name__ == "__main__":
    main()
