"""A study as CSV tables: tests, particles, subjects."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from homolog.analysis.comparison import Comparison, Options, prepared
from homolog.analysis.welch_map import WelchMap, welch_map
from homolog.files.names import file_stems
from homolog.files.results import Result
from homolog.files.tables import write_table
from homolog_app.report.study import Study
from homolog_app.report.surface_maps import SurfaceCarrier

__all__ = ["write_study_tables"]

_Cell = str | float | int | None


def write_study_tables(folder: Path, study: Study, result: Result, carrier: SurfaceCarrier) -> None:
    """Write ``tests.csv``, ``null_simulation.csv``, ``subjects.csv`` and a table of particles a comparison.

    Parameters
    ----------
    folder : Path
        Made if need be.
    study : Study
        What to write.
    result : Result
        That it was computed from.
    carrier : SurfaceCarrier
        Of that result.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    write_table(folder / "tests.csv", _TEST_COLUMNS, (_test_row(one) for one in study.comparisons))
    write_table(
        folder / "null_simulation.csv",
        ["comparison", "test", "false_alarms", "repeats", "rate", "low_95", "high_95"],
        (
            [one.title, test.test, test.alarms, test.repeats, test.rate, test.low, test.high]
            for one in study.comparisons
            for test in one.false_alarms
        ),
    )
    stems = file_stems([one.title for one in study.comparisons])
    for one, stem in zip(study.comparisons, stems, strict=True):
        columns, rows = _particles(study, one, result, carrier)
        write_table(folder / f"particles_{stem}.csv", columns, rows)
    _write_subjects(folder / "subjects.csv", study, result)


_TEST_COLUMNS = [
    "comparison", "subjects", "modes", "wilks", "pillai", "t_squared", "mahalanobis", "f", "dof_1", "dof_2",
    "p", "p_permutation", "p_holm", "permutations", "particles_p_family_05", "particles_q_05",
    "size_difference_mm", "size_p", "accuracy", "auc",
]  # fmt: skip


def _test_row(one: Comparison) -> list[_Cell]:
    test, local, line = one.test, one.local, one.discriminant
    return [
        one.title,
        "; ".join(f"{name} {count}" for name, count in one.counts.items()),
        test.modes,
        test.wilks,
        test.pillai,
        test.t_squared,
        test.mahalanobis,
        test.f,
        *test.dof,
        test.p,
        test.p_permutation,
        one.p_adjusted,
        test.permutations,
        int(np.count_nonzero(local.p_family <= 0.05)),
        int(np.count_nonzero(local.q <= 0.05)),
        float(one.size_effect[0]) if len(one.size_effect) == 1 else None,
        one.size_p,
        None if line is None else line.accuracy,
        None if line is None else line.auc,
    ]


def _particles(
    study: Study, one: Comparison, result: Result, carrier: SurfaceCarrier
) -> tuple[list[str], Iterator[list[_Cell]]]:
    """Columns and rows of a comparison's particles: mean position, effects, p and q."""
    columns = ["particle", "mean_x_mm", "mean_y_mm", "mean_z_mm"]
    values = [one.mean]
    for index, effect in enumerate(one.local.effect, start=1):
        suffix = f"_{index}" if len(one.local.effect) > 1 else ""
        columns += [f"effect_{axis}{suffix}_mm" for axis in "xyz"] + [f"outward{suffix}_mm"]
        values += [effect, carrier.outward_at_particles(one, effect)[:, None]]
    if one.discriminant is not None:
        columns += ["discriminant_outward_mm"]
        values += [carrier.outward_at_particles(one, one.discriminant.displacement)[:, None]]
    columns += ["explained", "p", "p_family", "q"]
    local = one.local
    values += [np.column_stack([local.explained, local.p, local.p_family, local.q])]
    if one.discriminant is not None and not study.request.covariates:
        welch = _outward_test(study, one, result, carrier)
        columns += ["outward_t_welch", "outward_p_welch", "outward_p_family", "outward_q"]
        values += [np.column_stack([welch.t, welch.p, welch.p_family, welch.q])]
    table = np.hstack(values).tolist()
    return columns, ([number, *row] for number, row in enumerate(table))


def _outward_test(study: Study, one: Comparison, result: Result, carrier: SurfaceCarrier) -> WelchMap:
    """Test two groups for outward displacement alone, with its sign and for unequal variances."""
    request = study.request
    shapes = prepared(result.world[one.subjects], Options(scaling=request.scaling))
    second = np.array([study.labels[subject] for subject in one.subjects]) == list(one.counts)[1]
    outward = carrier.outward_at_particles(one, shapes - one.mean)
    return welch_map(outward, second, permutations=request.permutations, seed=request.seed)


def _write_subjects(path: Path, study: Study, result: Result) -> None:
    """Write each subject's label, and its place along each discriminant as a root mean square [mm]."""
    lines = [one for one in study.comparisons if one.discriminant is not None]
    places: list[dict[int, float]] = []
    for one in lines:
        assert one.discriminant is not None
        rms = one.discriminant.scores / np.sqrt(len(one.mean))
        places.append(dict(zip(one.subjects.tolist(), rms.tolist(), strict=True)))
    taking_part = set(study.overall.subjects.tolist())
    write_table(
        path,
        ["name", study.request.column, "takes_part", *(f"discriminant_{one.title}_mm" for one in lines)],
        (
            [name, label, int(index in taking_part), *(one.get(index) for one in places)]
            for index, (name, label) in enumerate(zip(result.names, study.labels, strict=True))
        ),
    )
