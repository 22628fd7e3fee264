"""Questions written as formulas: each term tested as size, shape and place, and the analysis of variance."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray, IntArray
from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.comparison.answer import Answer, TextTable, column_notes, steps_of, surface_areas
from homolog.comparison.findings import answer_text, effect_text, findings, step_of
from homolog.comparison.question import Question
from homolog.comparison.sample import LOG_SIZE, SHAPE_SIZE, SIZE, Sample
from homolog.errors import InputError
from homolog.io.project import OUT_OF_DATE
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.anova import (
    Allometry,
    AnovaRow,
    Difference,
    allometry,
    differences,
    mode_scores,
    procrustes_anova,
    unequal_slopes,
)
from homolog.statistics.cautions import p_text
from homolog.statistics.checks import refuse_duplicates
from homolog.statistics.comparison import Comparison, prepare_shapes, run_comparison
from homolog.statistics.data_notes import exclusion_notes
from homolog.statistics.design import (
    Design,
    Hypothesis,
    Term,
    is_missing,
    make_design,
    parsed,
    refuse_repeated,
)
from homolog.statistics.procrustes import rms_radii

__all__ = ["Differences", "FormulaAnswer", "ask_formula", "columns_of", "design_of", "difference_rows"]

_ANOVA = {
    "on": "coordinates: all coordinates of the particles; modes: scores in the retained modes, each with a "
    "standard deviation of 1",
    "term": "term of the formula, or strata, residuals, total",
    "df": "degrees of freedom",
    "SS": "sum of squares, of coordinates [mm²] or of scores [SD²]",
    "MS": "mean square, SS / df",
    "R2": "share of the total sum of squares",
    "F": "mean square over that of the residuals",
    "Z": "effect size: standard deviates of the statistic's logarithm from its null distribution",
    "p": "p of residual randomization, not corrected; on modes too small for few subjects of unequal "
    "dispersion, and along a skewed number along which dispersion grows",
}
_DIFFERENCES = {
    "of": "what is compared: means of a category, or slopes along a number",
    "difference": "second minus first level, or the slope itself",
    "unit": "unit of the difference: difference, or per unit of a number",
    "length_mm": "root mean square of the difference over the particles [mm or mm per unit]",
    "mahalanobis_d_corrected": "length of the difference in the retained modes, corrected for bias [SD, or "
    "SD per unit]; empty for repeated measures, if no mode is retained, and for too few degrees of freedom",
    "mahalanobis_d_corrected_low_90": "lower bound of its 90 % confidence interval",
    "mahalanobis_d_corrected_high_90": "upper bound of its 90 % confidence interval",
    "Z": _ANOVA["Z"],
    "p": "p of residual randomization on all coordinates, not corrected",
    "p_corrected": "p corrected for the number of differences in the same column `of` (Holm)",
    "size_effect_mm": "difference of size [mm, or mm per unit]; empty if size is a column of the formula",
    "size_effect_mm_low_95": "lower bound of its 95 % confidence interval",
    "size_effect_mm_high_95": "upper bound of its 95 % confidence interval",
    "size_p_permutation": "permutation p of size, not corrected",
}
_ALLOMETRY = {
    "number": "number of the formula along which shape changes",
    "name": "subject",
    "value": "the subject's number",
    "regression_score_mm": "its shape along the mean slope (Drake and Klingenberg 2008), as root mean square "
    "over the particles [mm]",
    "predicted_mm": "first principal component of the shape that the design predicts (Adams and Nistri 2010) "
    "[mm]",
}


@dataclass(frozen=True, slots=True)
class Differences:
    """The differences of one kind, corrected for their number.

    Attributes
    ----------
    of : str
        Such as ``"means of group"``, or ``"slopes of age by group"``.
    number : str or None
        The number along which slopes are told; None for means.
    each : tuple of Difference
        The differences, in mm or mm per unit of the number.
    """

    of: str
    number: str | None
    each: tuple[Difference, ...]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FormulaAnswer(Answer):
    """The answer to a formula: what each term does to size, shape and places. Arrays are read-only.

    Attributes
    ----------
    design : Design
        The terms, with degrees of freedom and variance inflation.
    terms : tuple of Comparison
        The tests of each term.
    coordinates : tuple of AnovaRow
        Analysis of variance on all coordinates; squares in mm².
    modes : tuple of AnovaRow
        The same on the retained modes, squares in SD²; empty if no mode is retained.
    differences : tuple of Differences
        Differences of adjusted means, slopes, and differences of slopes.
    allometry : tuple of (str, Allometry)
        How shape changes along each number of the design.
    rows : (m,) int array
        Subjects of the sample that the design has.
    """

    design: Design
    terms: tuple[Comparison, ...]
    coordinates: tuple[AnovaRow, ...]
    modes: tuple[AnovaRow, ...]
    differences: tuple[Differences, ...]
    allometry: tuple[tuple[str, Allometry], ...]
    rows: IntArray

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """The tests of each term."""
        return self.terms

    @property
    def between_two(self) -> tuple[Comparison, ...]:
        """The tests of each term."""
        return self.terms

    @property
    def text(self) -> str:
        """What ``homolog analyze --formula`` prints, without the place of the tables."""
        return answer_text(self, findings(self))

    @property
    def table_lines(self) -> list[str]:
        """The analysis of variance as lines of equally wide columns."""
        kind = self.question.type_of_squares
        head = f"{self.design.formula}: {len(self.rows)} shapes, squares of type {kind}, on all coordinates"
        return [head, *_aligned_lines(self.coordinates)]

    @property
    def further_lines(self) -> list[str]:
        """The differences of means and slopes, a line each."""
        return [f"{name}: {'; '.join(filter(None, rest))}." for name, *rest in difference_rows(self)]

    @property
    def tables(self) -> Iterator[TextTable]:
        """Analysis of variance, differences and allometry, with the meaning of their columns."""
        yield (
            "anova.csv",
            _ANOVA,
            [
                [on, row.term, row.dof, row.squares, row.mean_square, row.r_squared, row.f, row.z, row.p]
                for on, rows in (("coordinates", self.coordinates), ("modes", self.modes))
                for row in rows
            ],
        )
        yield (
            "differences.csv",
            _DIFFERENCES,
            [
                [
                    family.of,
                    item.name,
                    "difference" if family.number is None else f"per unit of {family.number}",
                    item.length,
                    *((far.value, far.low, far.high) if (far := item.distance) else (None, None, None)),
                    item.z,
                    item.p,
                    item.p_adjusted,
                    *((of.value, of.low, of.high, of.p) if (of := item.size) else (None,) * 4),
                ]
                for family in self.differences
                for item in family.each
            ],
        )
        if self.allometry:
            names = [self.names[row] for row in self.rows.tolist()]
            yield (
                "allometry.csv",
                _ALLOMETRY,
                [
                    [number, *row]
                    for number, along in self.allometry
                    for row in zip(
                        names,
                        self.design.numbers[number].tolist(),
                        along.scores.tolist(),
                        along.predicted.tolist(),
                        strict=True,
                    )
                ],
            )

    def write(self, folder: Path) -> None:
        """Write ``anova.csv``, ``differences.csv``, ``allometry.csv`` and their dictionary ``columns.csv``.

        Raises
        ------
        InputError
            If the folder can't be written to.
        """
        meanings = []
        for name, columns, lines in self.tables:
            write_table(folder / name, list(columns), lines)
            meanings += [[name, *item] for item in columns.items()]
        write_table(folder / "columns.csv", ["file", "column", "meaning"], meanings)
        (folder / OUT_OF_DATE).unlink(missing_ok=True)


def difference_rows(answer: FormulaAnswer) -> Iterator[tuple[str, str, str]]:
    """Yield each difference: its name; its length in mm, D, p; that of size, if it was tested."""
    draws = answer.question.permutations
    for family in answer.differences:
        step, per = step_of(answer, family.number or "")
        for item in family.each:
            far, size = item.distance, item.size
            d = f", D = {effect_text(far, ci='90 % CI ', step=step)}" if far else ""
            larger = effect_text(size, " mm", ci="95 % CI ", step=step, sign=True) if size else ""
            name = family.of if item.name == family.number else f"{family.of}: {item.name}"
            p = p_text(item.p_adjusted, draws)
            yield name, f"{step * item.length:.2g} mm{d}{per}, {p}", larger and f"size {larger}{per}"


def _aligned_lines(rows: Sequence[AnovaRow]) -> list[str]:
    """Return the analysis of variance as lines of equally wide columns."""
    cells = [["term", "df", "SS", "R2", "F", "Z", "p"]]
    for row in rows:
        tested = ["", "", ""]
        if row.f is not None and row.z is not None and row.p is not None:
            tested = [f"{row.f:.3g}", f"{row.z:.2f}", p_text(row.p).removeprefix("p ").removeprefix("= ")]
        cells.append([row.term, str(row.dof), f"{row.squares:.5g}", f"{row.r_squared:.3f}", *tested])
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = []
    for first, *others in cells:
        numbers = (cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))
        lines.append("  ".join([first.ljust(widths[0]), *numbers]).rstrip())
    return lines


def columns_of(sample: Sample) -> tuple[dict[str, list[str | float]], set[str]]:
    """Return the columns that a formula may name, and which are declared categories."""
    titles = {plain_name(name) if name.endswith(CATEGORY) else name: name for name in sample.columns}
    categories = {plain for plain, name in titles.items() if name.endswith(CATEGORY)}
    columns = {plain: sample.column(name) for plain, name in titles.items()}
    columns |= {name: sample.column(name) for name in (SIZE, SHAPE_SIZE, LOG_SIZE) if name not in columns}
    return columns, categories


def design_of(sample: Sample, question: Question) -> tuple[Design, IntArray]:
    """Return the design of a question and its rows of the sample; refuse what can't be estimated.

    Raises
    ------
    InputError
        If the formula or a column is wrong, rows of one subject are not declared, or as `make_design`.
    """
    columns, categories = columns_of(sample)
    named = [item for item in (question.subject, question.strata) if item is not None]
    for name in named:
        if name not in columns:
            raise InputError(f"no column {name!r}; the cohort has: {', '.join(columns)}")
    factors = {name for term in parsed(question.formula) for name in term}
    used = [*named, *(name for name in columns if name in factors)]
    rows = np.arange(len(sample.names))
    if question.complete_cases:
        rows = np.flatnonzero([not any(is_missing(columns[name][row]) for name in used) for row in rows])
    if not len(rows):
        raise InputError(f"no row has a value in each of the columns {', '.join(used)}")
    names = [sample.names[row] for row in rows]
    table = {name: [values[row] for row in rows] for name, values in columns.items()}

    def texts(name: str | None) -> list[str] | None:
        return None if name is None else [str(value) for value in table[name]]

    if question.strata is not None and any(is_missing(value) for value in table[question.strata]):
        raise InputError(f"{question.strata}: a value is missing; fill it in, or use complete cases")
    design = make_design(
        question.formula,
        table,
        subject=texts(question.subject),
        strata=texts(question.strata),
        categories=categories,
        names=names,
    )
    if question.modes is not None and question.modes >= design.rows - design.matrix.shape[1]:
        raise InputError(
            f"modes {question.modes}: {design.rows} rows and {design.formula} leave "
            f"{design.rows - design.matrix.shape[1]} degrees of freedom; use fewer modes"
        )
    if question.subject is None:
        own = {SIZE, SHAPE_SIZE, LOG_SIZE}
        unused = {name: values for name, values in table.items() if name not in {*used, *own}}
        refuse_repeated(names, unused, {name: table[name] for name in used}, question.formula)
    return design, rows


def ask_formula(sample: Sample, question: Question, tick: Tick = no_tick) -> FormulaAnswer:
    """Answer a formula.

    Parameters
    ----------
    sample : Sample
        The shapes and what is known of them.
    question : Question
        The question, of the kind ``formula``.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        As `design_of`, and if two subjects have the same shape.
    """
    design, rows = design_of(sample, question)
    compared = sample.compared(question.alignment)
    refuse_duplicates(compared[rows], [sample.names[row] for row in rows])
    shapes, size = prepare_shapes(compared[rows], question.options), rms_radii(compared[rows])
    if LOG_SIZE in design.numbers and LOG_SIZE not in sample.columns:
        size = np.log(size)  # which the design then explains, so that size is not tested
    draws, seed, squares = question.permutations, question.seed, question.squares
    terms = []
    for number, term in enumerate(design.terms):
        low, high = 0.6 * number / len(design.terms), 0.6 * (number + 1) / len(design.terms)
        hypothesis = design.hypothesis(term.name, squares)
        terms.append(
            run_comparison(
                compared,
                rows,
                hypothesis,
                _title(design, term),
                {"all": len(rows)},
                question.options,
                part_of(tick, low, high),
                data=shapes,
                size=size,
                nested=False,
            )
        )
    tests = {term.name: item.test.whole for term, item in zip(design.terms, terms, strict=True)}
    coordinates = procrustes_anova(shapes, design, squares=squares, tested=tests)
    notes = exclusion_notes(
        left_out := {
            name: "no value in a column of the formula"
            for row, name in enumerate(sample.names)
            if row not in rows
        }
    )
    notes += column_notes(sample, list(design.levels), list(design.numbers))
    modes: tuple[AnovaRow, ...] = ()
    scores: FloatArray | None = None
    try:
        scores = mode_scores(shapes, design, modes=question.modes, seed=seed)
    except InputError as error:
        notes.append(f"On modes nothing is tested: {error}.")
    else:
        modes = procrustes_anova(
            scores, design, squares=squares, permutations=draws, seed=seed, tick=part_of(tick, 0.6, 0.65)
        )
    if design.rows > int(design.units.max()) + 1:
        notes.append("D needs one row for each subject; it is not given.")
        scores = None
    families = list(_families(design))
    apart = []
    for number, (of, along, hypotheses) in enumerate(families):
        low, high = 0.65 + 0.3 * number / len(families), 0.65 + 0.3 * (number + 1) / len(families)
        each = differences(
            shapes, scores, size, hypotheses, permutations=draws, seed=seed, tick=part_of(tick, low, high)
        )
        apart.append(Differences(of, along, each))
    notes += unequal_slopes(shapes, design, permutations=draws, seed=seed, tick=part_of(tick, 0.95, 1.0))
    labels = sample.texts(next(iter(design.levels))) if design.levels else [""] * len(sample.names)
    return FormulaAnswer(
        question=question,
        overall=terms[0],
        pairwise=(),
        labels=tuple(labels),
        left_out=left_out,
        areas=surface_areas(sample),
        names=sample.names,
        notes=tuple(notes),
        steps=steps_of(design.numbers),
        edge=sample.edge,
        design=design,
        terms=tuple(terms),
        coordinates=coordinates,
        modes=modes,
        differences=tuple(apart),
        allometry=tuple((number, allometry(shapes, design, number)) for number in design.numbers),
        rows=rows,
    )


def _title(design: Design, term: Term) -> str:
    """Return the name of a term, with the levels whose difference it is."""
    if term.dof > 1 or len(term.factors) > 1 or term.name not in design.levels:
        return term.name
    first, second = design.levels[term.name]
    return f"{term.name}: {second} - {first}"


def _families(design: Design) -> Iterator[tuple[str, str | None, list[Hypothesis]]]:
    """Yield the differences that a design's terms ask for: what of, along which number, hypotheses."""
    joined = {pair for term in design.terms for pair in permutations(term.factors, 2)}
    mains = {name for term in design.terms for name in term.factors}
    for factor in (name for name in design.levels if name in mains):
        yield f"means of {factor}", None, design.differences(factor)
        for other in (name for name in design.levels if (factor, name) in joined):
            within = [
                replace(item, name=f"{item.name}, {other} {level}")
                for level in design.levels[other]
                for item in design.differences(factor, {other: level})
            ]
            yield f"means of {factor} by {other}", None, within
    for number in design.numbers:
        yield f"slope of {number}", number, design.slopes(number)
        for factor in (name for name in design.levels if (number, name) in joined):
            yield f"slopes of {number} by {factor}", number, design.slopes(number, factor)
            between = design.slope_differences(number, factor)
            yield f"differences of slopes of {number} by {factor}", number, between
