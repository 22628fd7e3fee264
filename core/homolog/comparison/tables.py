"""An answer as tidy CSV tables, with a dictionary of the columns."""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import numpy as np

from homolog.comparison.answer import Answer
from homolog.comparison.findings import Seen, step_of
from homolog.comparison.places import Directions, SurfaceCarrier, directions_of, significant_regions
from homolog.comparison.question import Question
from homolog.comparison.sample import SHAPE_SIZE, Sample
from homolog.comparison.sample_rows import sample_rows
from homolog.comparison.seeds import COLUMNS, FILE, level_of, read_spread
from homolog.comparison.stored import PRIMARY, Provenance, folder_of, is_primary, write_question
from homolog.io.names import file_stems
from homolog.io.project import ProjectFolder
from homolog.io.report_details import read_details
from homolog.io.results import Result
from homolog.io.tables import write_table
from homolog.statistics.cautions import LEVEL
from homolog.statistics.comparison import Comparison, prepare_shapes
from homolog.statistics.effects import Effect
from homolog.statistics.welch import WelchMap, welch_map

__all__ = ["data_digest", "store", "write_tables"]

_Cell = str | float | int | None
_Table = tuple[str, Sequence[str], Iterable[Sequence[_Cell]]]


def store(
    project: ProjectFolder, answer: Answer, result: Result, carrier: SurfaceCarrier | None = None
) -> Path:
    """Write an answer's tables and its question into the project; return their folder.

    Stored answers of other seeds are deleted if they don't belong to this answer.

    Parameters
    ----------
    project : ProjectFolder
    answer : Answer
    result : Result
        Result of the answer.
    carrier : SurfaceCarrier, optional
        Carrier of the result, if it exists already.

    Raises
    ------
    InputError
        If the project can't be written to.
    """
    folder = folder_of(project, answer.question)
    if carrier is None:
        carrier = SurfaceCarrier.of(result, directions_of(read_details(project)))
    provenance = Provenance.now(project, data_digest(result, carrier.directions))
    if not read_spread(folder, provenance.fingerprint, answer):
        (folder / FILE).unlink(missing_ok=True)
    write_tables(folder, answer, result, carrier, provenance, is_primary=is_primary(folder))
    write_question(answer.question, folder, provenance)
    return folder


def data_digest(result: Result, directions: Directions) -> str:
    """Return a digest of the data of tables: shapes, groups, columns, names of directions."""
    whole = sha256(repr((result.names, result.groups, result.columns, directions.sides)).encode())
    for array in (result.world, result.alignments, result.mean_surface.vertices):
        whole.update(np.ascontiguousarray(array).tobytes())
    return whole.hexdigest()


def write_tables(
    folder: Path,
    answer: Answer,
    result: Result,
    carrier: SurfaceCarrier,
    provenance: Provenance,
    *,
    is_primary: bool = False,
) -> None:
    """Write the tables of an answer; ``columns.csv`` describes each column.

    Parameters
    ----------
    folder : Path
        Created if necessary.
    answer : Answer
    result : Result
        Result from which it was computed.
    carrier : SurfaceCarrier
        Carrier of that result.
    provenance : Provenance
        Result, time and version of the answer.
    is_primary : bool
        Whether it is the primary answer.

    Raises
    ------
    InputError
        If the folder can't be written to.
    """
    written: dict[str, list[str]] = {}
    origin = _provenance(answer.question, provenance, is_primary)
    for name, columns, lines in _tables(answer, result, carrier, origin):
        write_table(folder / name, columns, lines)
        written[name] = list(columns)
    own: list[list[str]] = []
    for name, described, lines in answer.tables:
        write_table(folder / name, list(described), lines)
        own += [[name, *item] for item in described.items()]
    if (folder / FILE).is_file():
        written[FILE] = COLUMNS
    meanings = _meanings()
    write_table(
        folder / "columns.csv",
        ["file", "column", "meaning"],
        [
            *(
                [name, column, _meaning(column, meanings)]
                for name, columns in written.items()
                for column in columns
            ),
            *own,
        ],
    )


def _tables(
    answer: Answer, result: Result, carrier: SurfaceCarrier, provenance: dict[str, _Cell]
) -> Iterator[_Table]:
    """Yield the tables of an answer: name, columns, rows."""
    yield from _tests(answer, provenance)
    covariates = [_test_row(answer, item) | _unit(item) for item in answer.overall.covariates]
    if covariates:
        yield "covariates.csv", list(covariates[0]), (list(row.values()) for row in covariates)
    yield (
        "dispersion.csv",
        [
            "comparison",
            "group",
            "n",
            "mean_distance_mm",
            "mean_distance_low_95_mm",
            "mean_distance_high_95_mm",
        ],
        (
            [
                comparison.title,
                group,
                count,
                None if spread is None else spread.by_group.get(group),
                *_bounds(None if spread is None else spread.intervals.get(group)),
            ]
            for comparison in answer.comparisons
            for spread in [comparison.dispersion]
            for group, count in comparison.counts.items()
        ),
    )
    yield (
        "sample.csv",
        [
            "group",
            "variable",
            "category",
            "n",
            "mean",
            "standard_deviation",
            "minimum",
            "maximum",
            "unit_of_variable",
        ],
        (astuple(row) for row in sample_rows(answer, result)),
    )
    yield "regions.csv", _REGION_COLUMNS, _regions(answer, carrier)
    stems = file_stems([comparison.title for comparison in answer.comparisons])
    for item, stem in zip(answer.comparisons, stems, strict=True):
        yield f"particles_{stem}.csv", *_particles(answer, item, result, carrier)
    yield "subjects.csv", *_subjects(answer, result)


def _tests(answer: Answer, provenance: dict[str, _Cell]) -> Iterator[_Table]:
    """Yield the tests of each comparison, with and without outliers."""
    rows = [_test_row(answer, comparison) | provenance for comparison in answer.comparisons]
    yield "tests.csv", list(rows[0]), (list(row.values()) for row in rows)
    without = (
        own
        | _test_row(answer, comparison.without_outliers)
        | {"pairs_corrected_for": own["pairs_corrected_for"]}
        | {"without": "; ".join(answer.names[index] for index in comparison.outliers)}
        for own, comparison in zip(rows, answer.comparisons, strict=True)
        if comparison.without_outliers is not None
    )
    yield "tests_without_outliers.csv", [*rows[0], "without"], (list(row.values()) for row in without)


def _unit(covariate: Comparison) -> dict[str, _Cell]:
    is_difference = len(covariate.pointwise.effect) > 1 or " - " in covariate.title
    return {"unit": "difference" if is_difference else f"per unit of {covariate.title}"}


def _unit_text(answer: Answer, comparison: Comparison) -> str:
    _, per = step_of(answer, comparison.title)
    return f"per unit of {per.rpartition(' of ')[2]}" if per else "difference"


def _provenance(question: Question, provenance: Provenance, is_primary: bool) -> dict[str, _Cell]:
    return {
        "question": question.title,
        PRIMARY: int(is_primary),
        "alignment": question.alignment.value,
        "covariates": "; ".join(question.covariates),
        "complete_cases": int(question.complete_cases),
        "seed": question.seed,
        "result_fingerprint": provenance.fingerprint,
        "result_finished": provenance.result_finished,
        "homolog_version": provenance.homolog,
        "date": provenance.date,
    }


def _test_row(answer: Answer, comparison: Comparison) -> dict[str, _Cell]:
    test, local, separation = comparison.test, comparison.pointwise, comparison.discriminant
    spread, between = comparison.dispersion, comparison.size_variance
    significant = comparison.p_fwe <= LEVEL
    area = float(answer.areas[significant].sum())
    seen = Seen.of(answer, comparison)
    return {
        "comparison": comparison.title,
        "n": sum(comparison.counts.values()),
        "unit": _unit_text(answer, comparison),
        "modes": test.modes,
        "modes_chosen_by": "option" if answer.question.modes is not None else "parallel analysis",
        **_effect("mahalanobis_d_corrected", comparison.distance),
        "rms_found_in_80_percent_mm": seen.whole,
        "displacement_found_in_80_percent_mm": seen.displacement,
        **_effect("omega_squared", comparison.explained),
        "mahalanobis_d_plain": test.mahalanobis,
        "studentized_statistic": test.studentized,
        "p_permutation": test.p_permutation,
        "p_permutation_corrected": comparison.p_adjusted,
        "pairs_corrected_for": len(answer.pairwise) if comparison in answer.pairwise else 1,
        "permutations": test.permutations,
        "permutations_exhaustive": int(test.exact),
        "t_squared": test.t_squared,
        "wilks_lambda": test.wilks,
        "pillai_trace": test.pillai,
        "f": test.f,
        "f_dof_numerator": test.dof[0],
        "f_dof_denominator": test.dof[1],
        "p_f": test.p,
        "dispersion_largest_to_smallest": None if spread is None else spread.ratio,
        **_effect("dispersion_second_to_first", spread.effect if spread and spread.by_group else None),
        **_effect("dispersion_per_unit_mm", spread.effect if spread and not spread.by_group else None),
        "dispersion_f": None if spread is None else spread.f,
        "dispersion_p": None if spread is None else spread.p,
        "particles": len(comparison.p_fwe),
        "particles_p_fwe_corrected_05": int(np.count_nonzero(significant)),
        "area_p_fwe_corrected_05_mm2": area,
        "area_p_fwe_corrected_05_percent": 100.0 * area / max(float(answer.areas.sum()), 1e-300),
        "particles_q_05": int(np.count_nonzero(local.q <= LEVEL)),
        **_effect("size_effect_mm", comparison.size),
        "size_f": None if between is None else between.f,
        **_effect("size_omega_squared", None if between is None else between.omega_squared),
        "size_p_permutation": None if comparison.size is None else comparison.size.p,
        "size_p_permutation_corrected": comparison.size_p_adjusted,
        **_effect("balanced_accuracy", None if separation is None else separation.accuracy),
        "balanced_accuracy_p_permutation": None if separation is None else separation.accuracy.p,
        "balanced_accuracy_p_permutation_corrected": comparison.accuracy_p_adjusted,
        "classified_correctly_first_group": None if separation is None else separation.right[0],
        "classified_correctly_second_group": None if separation is None else separation.right[1],
        **_effect("auc", None if separation is None else separation.auc),
        "auc_p_permutation": None if separation is None else separation.auc.p,
        "auc_p_permutation_corrected": comparison.auc_p_adjusted,
    }


def _effect(name: str, effect: Effect | None) -> dict[str, _Cell]:
    is_known = effect is not None and np.isfinite(effect.value)
    return {
        name: effect.value if effect is not None and is_known else None,
        f"{name}_low_{level_of(name)}": effect.low if effect is not None and is_known else None,
        f"{name}_high_{level_of(name)}": effect.high if effect is not None and is_known else None,
    }


def _bounds(effect: Effect | None) -> tuple[float | None, float | None]:
    return (None, None) if effect is None else (effect.low, effect.high)


def _particles(
    answer: Answer, comparison: Comparison, result: Result, carrier: SurfaceCarrier
) -> tuple[list[str], Iterator[list[_Cell]]]:
    """Return columns and rows of a comparison's particles: mean position, effects with intervals, p and q."""
    per = "_per_unit" if step_of(answer, comparison.title)[1] else ""
    columns = ["particle", "area_mm2", "mean_x_mm", "mean_y_mm", "mean_z_mm"]
    values = [answer.areas[:, None], comparison.mean]
    for index, effect in enumerate(comparison.pointwise.effect, start=1):
        suffix = f"_{index}" if len(comparison.pointwise.effect) > 1 else ""
        columns += [f"effect_{axis}{suffix}_mm{per}" for axis in "xyz"] + [f"outward{suffix}_mm{per}"]
        values += [effect, carrier.outward_at_particles(comparison, effect)[:, None]]
    if len(comparison.pointwise.effect) == 1:
        columns += [f"outward_low_95_mm{per}", f"outward_high_95_mm{per}"]
        values += [np.column_stack(comparison.pointwise.bounds(carrier.normals_at_particles(comparison)))]
    if comparison.discriminant is not None:
        columns += ["discriminant_outward_mm"]
        values += [carrier.outward_at_particles(comparison, comparison.discriminant.displacement)[:, None]]
    columns += ["explained", "p_f", "studentized_statistic", "p", "p_fwe", "p_fwe_corrected", "q"]
    local = comparison.pointwise
    values += [
        np.column_stack(
            [
                local.explained,
                local.p_f,
                local.studentized,
                local.p,
                local.p_fwe,
                comparison.p_fwe,
                local.q,
            ]
        )
    ]
    if comparison.discriminant is not None and not answer.question.covariates:
        welch = _outward_test(answer, comparison, result, carrier)
        columns += ["outward_t_welch", "outward_p_welch", "outward_p_fwe", "outward_q"]
        values += [np.column_stack([welch.t, welch.p, welch.p_fwe, welch.q])]
    table = np.hstack(values).tolist()
    return columns, ([number, *row] for number, row in enumerate(table))


_REGION_COLUMNS = (
    "comparison",
    "region",
    "particles",
    "area_mm2",
    "mean_outward_mm",
    "mean_outward_low_95_mm",
    "mean_outward_high_95_mm",
    "least_outward_mm",
    "largest_outward_mm",
    "peak_particle",
    "peak_x_mm",
    "peak_y_mm",
    "peak_z_mm",
    "peak_wall",
    "peak_place",
    "peak_outward_mm",
    "peak_outward_low_95_mm",
    "peak_outward_high_95_mm",
    "peak_displacement_mm",
    "peak_p_fwe_corrected",
    "peak_q",
    "peak_displacement_towards",
)


def _regions(answer: Answer, carrier: SurfaceCarrier) -> Iterator[list[_Cell]]:
    for comparison in answer.comparisons:
        for number, region in enumerate(significant_regions(answer, comparison, carrier), start=1):
            yield [
                comparison.title,
                number,
                len(region.particles),
                region.area,
                region.mean_outward.value,
                region.mean_outward.low,
                region.mean_outward.high,
                *region.outward_range,
                region.peak,
                *region.position.tolist(),
                region.wall,
                region.place,
                region.outward.value,
                region.outward.low,
                region.outward.high,
                region.length,
                region.p,
                region.q,
                region.way,
            ]


def _outward_test(
    answer: Answer, comparison: Comparison, result: Result, carrier: SurfaceCarrier
) -> WelchMap:
    """Test two groups for signed outward displacement only, with unequal variances."""
    question = answer.question
    shapes = prepare_shapes(
        Sample.of(result).compared(question.alignment)[comparison.subjects], question.options
    )
    second = (
        np.array([answer.labels[subject] for subject in comparison.subjects]) == list(comparison.counts)[1]
    )
    outward = carrier.outward_at_particles(comparison, shapes - comparison.mean)
    return welch_map(outward, second, permutations=question.permutations, seed=question.seed)


def _subjects(answer: Answer, result: Result) -> tuple[list[str], Iterator[list[_Cell]]]:
    """Return columns and rows of the subjects: label, part, and position along each discriminant."""
    lines = [comparison for comparison in answer.comparisons if comparison.discriminant is not None]
    places: list[dict[int, float]] = []
    for item in lines:
        assert item.discriminant is not None
        scores = item.discriminant.cross_validated.tolist()
        places.append(dict(zip(item.subjects.tolist(), scores, strict=True)))
    size = [float(cell) for cell in Sample.of(result).texts(SHAPE_SIZE)]
    labelled = [answer.question.column] if answer.question.column else []
    columns = ["name", *labelled, "takes_part", "left_out_because", "shape_size_mm"]
    columns += [f"discriminant_{line.title}_mm" for line in lines]
    return columns, (
        [
            name,
            *([answer.labels[index]] if labelled else []),
            int(name not in answer.left_out),
            answer.left_out.get(name, ""),
            size[index],
            *(place.get(index) for place in places),
        ]
        for index, name in enumerate(result.names)
    )


def _meanings() -> dict[str, str]:
    """Return the meaning of each column of an answer's tables."""
    source = files("homolog.comparison") / "columns.csv"
    with source.open(encoding="utf-8") as stream:
        return {row["column"]: row["meaning"] for row in csv.DictReader(stream)}


def _meaning(column: str, meanings: Mapping[str, str]) -> str:
    """Return the meaning of a column, from the dictionary or from its suffix."""
    plain = column.removesuffix("_per_unit")
    unit = ", per unit of the variable" if plain != column else ""
    interval = re.fullmatch(r"(.+)_(low|high)_(\d+)(_mm)?", plain)
    if interval:
        bound = "lower" if interval[2] == "low" else "upper"
        return f"{bound} bound of the {interval[3]} % confidence interval of {interval[1]}{unit}"
    if plain.startswith("discriminant_") and plain != "discriminant_outward_mm":
        return "cross-validated position along the discriminant, root mean square over the particles"
    several = re.fullmatch(r"(effect_[xyz]|outward)_(\d+)_mm", plain)
    if several:
        return f"{meanings[f'{several[1]}_mm']}, group {int(several[2]) + 1} minus group 1"
    return meanings.get(plain, "the column of the question") + unit
