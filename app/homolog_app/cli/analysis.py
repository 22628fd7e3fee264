"""Analysis of a project (``homolog analyze``, ``check``, ``report``), and geodesic distances."""

import argparse
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from homolog.comparison.precision import AnalysisSettings
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.io.report_details import ReportDetails, read_details, write_details
from homolog_app.cli.options import (
    ANYWAY,
    PROGRESS,
    PROJECT,
    command,
    one_of,
    option,
    settings,
    show_progress,
    titled,
    with_options,
    write_lines,
)
from homolog_app.exports.settings import CutSettings

if TYPE_CHECKING:
    from homolog.comparison.question import Question
    from homolog.inspection import Inspection
    from homolog.io.results import Result
    from homolog.progress import Tick

__all__ = ["run_analyze", "run_check", "run_geodesics", "run_report"]


_ALIGNMENTS = ["shape", "form", "as-it-lies"]
_FORMER_ALIGNMENTS = {"similarity": "shape", "rigid": "form"}


def _alignment(word: str) -> str:
    """Return an alignment's name, also for its name in earlier versions."""
    return _FORMER_ALIGNMENTS.get(word, word)


_QUESTION = (
    one_of(
        option("--group", metavar="COLUMN", default="group", help="column of groups (default group)"),
        option("--regress", metavar="COLUMN", help="column of a continuous variable"),
        option(
            "--formula",
            metavar="FORMULA",
            help='terms to test, such as "~ group * age + sex": analysis of variance, differences, slopes',
        ),
    ),
    titled(
        "with --formula",
        option("--subject", metavar="COLUMN", help="column of the subject, for repeated measures"),
        option("--strata", metavar="COLUMN", help="column of strata, such as sites; effects are within"),
        option(
            "--squares",
            choices=["I", "II", "III"],
            help="sums of squares: each term adjusted for those before it (I), all that do not contain it "
            "(II, the default), or all others (III)",
        ),
        option("--out", type=Path, metavar="FOLDER", help="write the formula's tables also to this folder"),
    ),
    option(
        "--between",
        nargs="+",
        metavar="GROUP",
        help="groups to compare, the reference first (default: all, controls first)",
    ),
    option(
        "--pairs",
        metavar="COLUMN",
        help="column that identifies the pairs of two groups; with more groups, add --between A B",
    ),
    option(
        "--covariates",
        nargs="+",
        metavar="COLUMN",
        default=[],
        help="columns to adjust for; size is that of the shapes; COLUMN:c treats numbers as categories",
    ),
    option(
        "--complete-cases",
        action="store_true",
        help="exclude subjects with missing values in the columns used (default: stop)",
    ),
    option(
        "--alignment",
        choices=_ALIGNMENTS,
        type=_alignment,
        nargs="+",
        help="what is compared: shape (without size), form (size and shape), as-it-lies (pose as well) "
        "(default: shape; size is always tested as well)",
    ),
    option(
        "--pose",
        metavar="STRUCTURE",
        help="test how a structure of several lies to the reference (turn and shift), in place of shapes",
    ),
    option("--size", choices=["both", "with", "without"], help=argparse.SUPPRESS),
)


@command(
    "Compare the groups of a column (the default), test the linear effect of a column, "
    "compare paired subjects, or test the terms of a formula. Prints the results, writes tables to "
    "PROJECT/analysis and adds the study to homolog report.",
    PROJECT,
    *_QUESTION,
    settings(AnalysisSettings),
    option(
        "--primary",
        nargs="?",
        const="",
        choices=["", *_ALIGNMENTS, "none"],
        type=_alignment,
        metavar="ALIGNMENT",
        help="make this the primary study: reports begin with it, and the others follow in a fixed "
        "sequence. With several alignments it is the named one, or else the first. none: no study is primary",
    ),
    settings(ReportDetails),
    ANYWAY,
    PROGRESS,
)
def run_analyze(arguments: argparse.Namespace) -> int:
    """Run the tests; return the exit code."""
    if arguments.formula is None:
        for name in ("subject", "strata", "squares", "out"):
            if getattr(arguments, name) is not None:
                raise InputError(f"--{name} belongs to --formula; add the formula, or leave it out")
    for name in ("between", "pairs", "covariates"):
        if arguments.formula is not None and getattr(arguments, name):
            raise InputError(
                f"--{name} can't be combined with --formula, which names all columns; leave it out"
            )
    if arguments.pose is not None:
        return _analyze_pose(arguments)
    from homolog.comparison.formula import FormulaAnswer, design_of
    from homolog.comparison.project import analyze_result, primary_of
    from homolog.comparison.sample import Sample
    from homolog.comparison.stored import name_primary
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result
    from homolog.progress import part_of

    project = ProjectFolder(arguments.project)
    alignments = _alignments(arguments)
    if arguments.out is not None and len(alignments) > 1:
        raise InputError("--out takes the tables of one alignment; leave it out, or give one alignment")
    settings = with_options(AnalysisSettings(), arguments)
    lines = []
    if arguments.size == "with":
        lines.append(
            "Note: --size with aligns shapes rigidly; versions before 0.2 behaved "
            "like --alignment as-it-lies."
        )
    with project.locked(new=False), show_progress(arguments.progress) as progress:
        result = read_result(project)
        requested = _asked(arguments, result, alignments, settings)
        if arguments.formula is not None:
            design_of(Sample.of(result), requested[0])  # refuses before anything is computed
        if not arguments.anyway:
            refuse_unusable(project, result.world, part_of(progress.tick, 0.0, 0.05))
        write_details(project, with_options(read_details(project), arguments))
        chosen = primary_of(requested, arguments.primary)
        rest = part_of(progress.tick, 0.05, 1.0)
        answers = analyze_result(project, result, requested, settings.seeds, rest)
        if arguments.primary is not None:
            name_primary(project, chosen)
        for answer in answers if arguments.out is not None else ():
            assert isinstance(answer.answer, FormulaAnswer)
            answer.answer.write(arguments.out)
    write_lines(*lines, *(answer.text for answer in answers), aside=arguments.progress == "json")
    return 0


def _analyze_pose(arguments: argparse.Namespace) -> int:
    """Test the pose of a structure; return the exit code."""
    from homolog.comparison.ask import ask
    from homolog.comparison.pose import NUMBERS, PoseSample
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result

    for name in ("alignment", "size", "primary", "out"):
        if getattr(arguments, name) is not None:
            raise InputError(f"--{name} is of shapes and can't be combined with --pose; leave it out")
    project = ProjectFolder(arguments.project)
    settings = with_options(AnalysisSettings(), arguments)
    settings = settings.model_copy(update={"modes": settings.modes or NUMBERS})
    with project.locked(new=False), show_progress(arguments.progress) as progress:
        result = read_result(project)
        record = project.read().result
        assert record is not None, "a result was read"
        poses = PoseSample.of(result, arguments.pose, record.settings.optimize.align_by)
        (question,) = _asked(arguments, result, ["as-it-lies"], settings, pose=arguments.pose)
        if not arguments.anyway:
            refuse_unusable(project, result.world, progress.tick)
        answer = ask(poses.sample, question, progress.tick)
        folder = poses.store(project, answer)
    write_lines(poses.text(answer), f"  tables: {folder}", aside=arguments.progress == "json")
    return 0


def _asked(
    arguments: argparse.Namespace,
    result: "Result",
    alignments: Sequence[str],
    settings: AnalysisSettings,
    **more: str,
) -> "tuple[Question, ...]":
    """Return the questions of the command line, one for each alignment."""
    from homolog.comparison.project import questions_of

    return questions_of(
        result,
        alignments,
        group=arguments.group,
        regress=arguments.regress,
        between=arguments.between or [],
        pairs=arguments.pairs,
        covariates=tuple(arguments.covariates),
        formula=arguments.formula,
        subject=arguments.subject,
        strata=arguments.strata,
        squares=arguments.squares or "II",
        complete_cases=arguments.complete_cases,
        **settings.model_dump(exclude={"seeds"}),
        **more,
    )


def _alignments(arguments: argparse.Namespace) -> list[str]:
    if arguments.size and arguments.alignment:
        raise InputError("--size is short for --alignment; give one of them")
    by_size = {"with": ["form"], "both": ["shape", "form"]}.get(arguments.size, ["shape"])
    return list(dict.fromkeys(arguments.alignment or by_size))


@command(
    "Say how much of the model is reproducible (sound, doubtful or not usable, and why), and "
    "list places where the correspondence may be wrong, the most severe first: exchanged particles, "
    "swapped neighbourhoods, normals that disagree with the other subjects, folded triangles, uncovered "
    "regions.",
    PROJECT,
    option("--out", type=Path, metavar="FILE", help="write the list to FILE.csv or FILE.json"),
    option(
        "--min-severity",
        type=float,
        default=1.0,
        metavar="SEVERITY",
        help="lowest severity to list (default 1)",
    ),
    option(
        "--repair",
        type=int,
        default=0,
        metavar="COUNT",
        help="optimize the particles around the COUNT most severe suspects again, and keep what improves",
    ),
    option("--workers", type=int, help="number of processes (default: one per core)"),
    PROGRESS,
)
def run_check(arguments: argparse.Namespace) -> int:
    """List the suspects; return the exit code."""
    from homolog.inspection.verdict import read_verdict
    from homolog.io.results import read_result
    from homolog.progress import part_of
    from homolog.run.repair import inspect_project, rows, write_suspects

    if arguments.repair < 0 or not arguments.min_severity >= 0.0:
        raise InputError("--repair and --min-severity must be 0 or more")
    if arguments.workers is not None and arguments.workers < 1:
        raise InputError("--workers must be 1 or more")
    if arguments.out is not None and arguments.out.suffix.lower() not in (".csv", ".json"):
        raise InputError(
            f"--out {arguments.out}: the list can be written as .csv or .json; use one of these suffixes"
        )
    project = ProjectFolder(arguments.project)
    project.recover()
    with show_progress(arguments.progress) as progress:
        share = 0.2 if arguments.repair else 1.0
        inspections = inspect_project(project, part_of(progress.tick, 0.0, share), workers=arguments.workers)
        notes: list[str] = []
        if arguments.repair:
            notes = _repair(project, inspections, arguments.repair, part_of(progress.tick, share, 1.0))
        result = read_result(project)
        verdicts = [read_verdict(project, result.world).line]
        for name in filter(None, inspections):
            own = project.structure(name)
            verdicts.append(f"{name}: {read_verdict(own, read_result(own).world).line}")
    tables = {
        name: rows(
            inspection,
            [suspect for suspect in inspection.suspects if suspect.severity >= arguments.min_severity],
            own.names,
        )
        for name, (own, inspection) in inspections.items()
    }
    if arguments.out is not None:
        write_suspects(arguments.out, tables)
    lines = [
        f"{severity:6.2f}  {kind:<22} {' '.join(filter(None, (subject, name)))}: {description}"
        for name, table in tables.items()
        for kind, subject, severity, *_, description in table
    ]
    suspects = "1 suspect" if len(lines) == 1 else f"{len(lines)} suspects"
    ending = f"{suspects} of {len(result.names)} subjects x {result.local.shape[1]} particles"
    write_lines(*verdicts, *notes, *lines, ending, aside=arguments.progress == "json")
    return 0


def _repair(
    project: ProjectFolder, inspections: "dict[str, tuple[Result, Inspection]]", count: int, tick: "Tick"
) -> list[str]:
    """Repair the most severe suspects one by one, keep what improves, and return what happened."""
    from homolog.progress import part_of
    from homolog.run.repair import repaired, write_repaired

    suspects = [(name, item) for name, (_, inspection) in inspections.items() for item in inspection.suspects]
    chosen = sorted(suspects, key=lambda pair: -pair[1].severity)[:count]
    lines: list[str] = []
    notes: dict[str, str] = {}
    for number, (structure, suspect) in enumerate(chosen):
        part = part_of(tick, 0.9 * number / len(chosen), 0.9 * (number + 1) / len(chosen))
        result, inspection = inspections[structure]
        own = project.structure(structure) if structure else project
        after = repaired(own, inspection, suspect, part)
        name = result.names[suspect.subject]
        better = after is not inspection
        what = " ".join(filter(None, (name, structure)))
        lines.append(f"{'repaired' if better else 'unchanged'}: {what}: {suspect.description}")
        if better:
            inspections[structure] = result, after
            notes[name] = "particles of suspects were optimized again"
    if notes:
        local = {name: inspection.located.local for name, (_, inspection) in inspections.items()}
        write_repaired(project, local, notes, part_of(tick, 0.9, 1.0))
    return lines


@command(
    "Write one page about a project's shape model and its studies (see homolog analyze) to "
    "PROJECT/report, as HTML and PDF, with its figures as SVG and PDF. It opens in a browser without a "
    "network.",
    PROJECT,
    settings(ReportDetails),
    settings(CutSettings),
    ANYWAY,
    PROGRESS,
)
def run_report(arguments: argparse.Namespace) -> int:
    """Write the report; return the exit code."""
    from homolog.inspection.verdict import refuse_unusable
    from homolog.io.results import read_result
    from homolog_app.report.write import write_report

    clip = with_options(CutSettings(), arguments).cutting
    project = ProjectFolder(arguments.project)
    with project.locked(new=False), show_progress(arguments.progress) as progress:
        if not arguments.anyway:
            refuse_unusable(project, read_result(project).world)
        write_details(project, with_options(read_details(project), arguments))
        path = write_report(project, progress.tick, clip)
    write_lines(str(path))
    return 0


@command(
    "Geodesic distances between all vertices of a closed surface, as a sparse matrix.",
    option("mesh", type=Path, help="closed surface: .vtp, .vtk, .ply, .stl or .obj"),
    option(
        "--d-max", type=float, required=True, metavar="MM", help="largest distance to compute; inf for all"
    ),
    option(
        "--out", type=Path, metavar="FILE.npz", help="write a SciPy sparse matrix (scipy.sparse.load_npz)"
    ),
    option("--device", default="auto", help="auto, cpu, cuda:0 …; auto takes the first GPU"),
    option("--memory-limit", type=float, default=8.0, metavar="GB", help="largest table allowed (default 8)"),
    option(
        "--verify",
        type=int,
        nargs="?",
        const=32,
        metavar="SOURCES",
        help="compare this number of random rows (default 32) with exact distances; needs tvb-gdist",
    ),
    PROGRESS,
)
def run_geodesics(arguments: argparse.Namespace) -> int:
    """Compute, write and verify as requested; return the exit code."""
    from homolog.cluster import read_apart
    from homolog.device import choose_device, describe_device, device_faults
    from homolog.geodesics import each_table, measure_accuracy, plan_tables
    from homolog.io.meshes import read_mesh

    if arguments.out is not None and arguments.out.suffix != ".npz":
        raise InputError(f"{arguments.out}: the matrix is written as .npz; use that suffix")
    if arguments.verify is not None and arguments.verify < 1:
        raise InputError(f"--verify {arguments.verify}: at least one source is needed")
    mesh = read_apart(read_mesh, arguments.mesh, arguments.mesh)
    plan = plan_tables(
        [mesh],
        arguments.d_max,
        names=[str(arguments.mesh)],
        memory_limit=int(1e9 * arguments.memory_limit),
    )
    device = choose_device(arguments.device)
    say = partial(write_lines, aside=True)
    say(
        f"{len(mesh.vertices)} vertices, mean edge {mesh.mean_edge:.3g} mm; table of about "
        f"{plan.nbytes / 1e6:.0f} MB on {describe_device(device)}"
    )
    with show_progress(arguments.progress) as progress, device_faults(device):
        start = time.perf_counter()
        ((_, table),) = each_table(plan, device=device, tick=progress.tick)
        seconds = time.perf_counter() - start
        say(f"solved in {seconds:.2f} s, {table.nbytes / 1e6:.0f} MB, steps of {table.unit:.3g} mm")
        if arguments.out is not None:
            say(f"{_write(arguments.out, table)} distances in {arguments.out}")
        if arguments.verify is not None:
            say(str(measure_accuracy(mesh, table, arguments.verify, tick=progress.tick)))
    return 0


def _write(path: Path, table: Any) -> int:  # noqa: ANN401 - a GeodesicTable, slow to import
    """Write the matrix atomically; return its number of entries."""
    import scipy.sparse

    from homolog.io.atomic import atomic_write

    matrix = table.to_csr()
    with atomic_write(path) as part:
        scipy.sparse.save_npz(part, matrix, compressed=False)
    return int(matrix.nnz)
