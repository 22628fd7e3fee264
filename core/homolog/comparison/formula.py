"""Questions written as formulas: the analysis of variance of shapes, and what differs."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from homolog.arrays import FloatArray, IntArray
from homolog.cohort.column_types import CATEGORY, plain_name
from homolog.comparison.precision import Precision
from homolog.comparison.question import ALIGNED
from homolog.comparison.sample import SHAPE_SIZE, SIZE, Sample
from homolog.errors import InputError
from homolog.io.project import OUT_OF_DATE
from homolog.io.tables import write_table
from homolog.parameters import fault_text
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.anova import AnovaRow, Difference, differences, mode_scores, procrustes_anova
from homolog.statistics.cautions import LEVEL, p_text
from homolog.statistics.design import (
    Design,
    Hypothesis,
    Squares,
    is_missing,
    make_design,
    parsed,
    refuse_repeated,
)
from homolog.statistics.procrustes import Alignment, aligned
from homolog.statistics.randomization import Randomization

__all__ = ["Differences", "FormulaAnswer", "FormulaQuestion", "ask_formula", "design_of", "formula_questions"]

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
    "p": "p of residual randomization, not corrected",
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
    "p": _ANOVA["p"],
    "p_corrected": "p corrected for the number of differences in the same column `of` (Holm)",
}


class FormulaQuestion(Precision):
    """A linear model of shapes, as a formula.

    Attributes
    ----------
    formula : str
        Such as ``"~ group * age + sex"``; see `homolog.statistics.design.make_design`.
    subject, strata : str or None
        Columns of the subject of repeated measures, and of strata such as sites.
    squares : Squares
        Type of the sums of squares.
    alignment : Alignment
        Alignment of the shapes before the comparison.
    complete_cases : bool
        Whether rows without a value in one of these columns are excluded.
    """

    formula: str
    subject: str | None = None
    strata: str | None = None
    squares: Squares = Squares.MARGINAL
    alignment: Alignment = Alignment.SIMILARITY
    complete_cases: bool = False

    @property
    def name(self) -> str:
        """A name of a folder for the question, of its words and a digest of all that it says."""
        file_stem = re.sub(r"[^\w.-]+", "_", self.formula).strip("._")[:60]
        digest = sha256(self.model_dump_json(exclude={"permutations"}).encode()).hexdigest()[:8]
        return f"formula_{file_stem}_{digest}"


def formula_questions(
    alignments: Sequence[str],
    **given: Any,  # noqa: ANN401 - checked
) -> tuple[FormulaQuestion, ...]:
    """Return the question for each of several alignments; raises InputError if a value is invalid.

    `squares` is written ``I``, ``II`` or ``III``.
    """
    types = {"I": Squares.SEQUENTIAL, "II": Squares.MARGINAL, "III": Squares.PARTIAL}
    if given["squares"] not in types:
        raise InputError(f"squares {given['squares']!r}: choose I, II or III")
    known = [item.value for item in Alignment]
    for alignment in alignments:
        if alignment not in known:
            raise InputError(f"alignment {alignment!r}: choose one or several of {', '.join(known)}")
    given = {**given, "squares": types[given["squares"]]}
    try:
        return tuple(FormulaQuestion.model_validate({**given, "alignment": item}) for item in alignments)
    except ValidationError as error:
        first = error.errors()[0]
        raise InputError(f"{first['loc'][0]} {first['input']}: {fault_text(first)}") from error


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


@dataclass(frozen=True, slots=True, eq=False)
class FormulaAnswer:
    """The analysis of variance of a formula, and what differs. Arrays are read-only.

    Attributes
    ----------
    question : FormulaQuestion
        The question.
    design : Design
        Its terms, with degrees of freedom and variance inflation.
    names : tuple of str
        The rows, M in number.
    coordinates : tuple of AnovaRow
        The terms, tested on all coordinates; squares in mm².
    modes : tuple of AnovaRow
        The same on the retained modes, squares in SD²; empty if no mode is retained.
    differences : tuple of Differences
        Differences of adjusted means, slopes, and differences of slopes.
    notes : tuple of str
        Remarks, each a sentence.
    """

    question: FormulaQuestion
    design: Design
    names: tuple[str, ...]
    coordinates: tuple[AnovaRow, ...]
    modes: tuple[AnovaRow, ...]
    differences: tuple[Differences, ...]
    notes: tuple[str, ...]

    @property
    def text(self) -> str:
        """What ``homolog analyze --formula`` prints, a line for each term first."""
        kind = {1: "I", 2: "II", 3: "III"}[self.question.squares]
        lines = [f"{self.design.formula}; {ALIGNED[self.question.alignment]}"]
        lines += [f"  {len(self.names)} shapes, sums of squares of type {kind}, on all coordinates"]
        lines += [f"  {line}" for line in _aligned_lines(self.coordinates)]
        lines += [f"  {sentence}" for sentence in self._said()]
        return "\n".join([*lines, *(f"  Note: {note}" for note in self.notes)])

    def _said(self) -> Iterator[str]:
        """Yield what the terms and the differences say."""
        for row in self.coordinates:
            if row.p is None:
                continue
            shown, p = row.p <= LEVEL, p_text(row.p, self.question.permutations)
            if ":" not in row.term:
                effect = "Shapes differ with" if shown else "No difference of shapes is shown with"
                yield f"{effect} {row.term} ({p})."
                continue
            last, *others = reversed(row.term.split(":"))
            effect = "depends" if shown else "is not shown to depend"
            yield f"The effect of {last} {effect} on {' and '.join(reversed(others))} ({p})."
        for family in self.differences:
            for item in family.each:
                per = "" if family.number is None else f" per unit of {family.number}"
                far = item.distance
                d = f" (D = {far.value:.2g}, 90 % CI {far.low:.2g} to {far.high:.2g})" if far else ""
                p = p_text(item.p_adjusted, self.question.permutations)
                name = "" if item.name == family.number else f": {item.name}"
                yield f"{family.of[0].upper()}{family.of[1:]}{name}: {item.length:.2g} mm{d}{per}, {p}."

    def write(self, folder: Path) -> None:
        """Write ``anova.csv``, ``differences.csv`` and their dictionary ``columns.csv``.

        Raises
        ------
        InputError
            If the folder can't be written to.
        """
        tables: list[tuple[str, dict[str, str], list[list[str | float | int | None]]]] = [
            (
                "anova.csv",
                _ANOVA,
                [
                    [on, row.term, row.dof, row.squares, row.mean_square, row.r_squared, row.f, row.z, row.p]
                    for on, rows in (("coordinates", self.coordinates), ("modes", self.modes))
                    for row in rows
                ],
            ),
            (
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
                    ]
                    for family in self.differences
                    for item in family.each
                ],
            ),
        ]
        for name, columns, lines in tables:
            write_table(folder / name, list(columns), lines)
        meanings = [[name, *item] for name, columns, _ in tables for item in columns.items()]
        write_table(folder / "columns.csv", ["file", "column", "meaning"], meanings)
        (folder / OUT_OF_DATE).unlink(missing_ok=True)


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


def design_of(sample: Sample, question: FormulaQuestion) -> tuple[Design, IntArray]:
    """Return the design of a question and its rows of the sample; refuse what can't be estimated.

    Raises
    ------
    InputError
        If the formula or a column is wrong, rows of one subject are not declared, or as `make_design`.
    """
    titles = {plain_name(name) if name.endswith(CATEGORY) else name: name for name in sample.columns}
    categories = {plain for plain, name in titles.items() if name.endswith(CATEGORY)}
    columns = {plain: sample.column(name) for plain, name in titles.items()}
    columns |= {name: sample.column(name) for name in (SIZE, SHAPE_SIZE) if name not in columns}
    named = [item for item in (question.subject, question.strata) if item is not None]
    for name in named:
        if name not in columns:
            raise InputError(f"no column {name!r}; the cohort has: {', '.join(columns)}")
    in_question = {name for term in parsed(question.formula) for name in term}
    used = [*named, *(name for name in columns if name in in_question)]
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
        unused = {name: own for name, own in table.items() if name not in {*used, SIZE, SHAPE_SIZE}}
        refuse_repeated(names, unused, {name: table[name] for name in used})
    return design, rows


def ask_formula(
    sample: Sample, question: FormulaQuestion, designed: tuple[Design, IntArray], tick: Tick = no_tick
) -> FormulaAnswer:
    """Answer a question.

    Parameters
    ----------
    sample : Sample
        The shapes and what is known of them.
    question : FormulaQuestion
        The question.
    designed : Design and (M,) array
        From `design_of`.
    tick : Tick
        Progress and cancellation.
    """
    design, rows = designed
    shapes = aligned(sample.compared(question.alignment)[rows], question.alignment)
    notes = []
    if len(rows) < len(sample.names):
        out = [name for row, name in enumerate(sample.names) if row not in rows]
        notes.append(f"{len(out)} without values are not used: {', '.join(out)}.")
    draws, seed, squares = question.permutations, question.seed, question.squares
    coordinates = procrustes_anova(
        shapes, design, squares=squares, permutations=draws, seed=seed, tick=part_of(tick, 0.0, 0.4)
    )
    modes: tuple[AnovaRow, ...] = ()
    scores: FloatArray | None = None
    try:
        scores = mode_scores(shapes, design, modes=question.modes, seed=question.seed)
    except InputError as error:
        notes.append(f"On modes nothing is tested: {error}.")
    else:
        modes = procrustes_anova(
            scores, design, squares=squares, permutations=draws, seed=seed, tick=part_of(tick, 0.4, 0.5)
        )
    repeated = design.rows > int(design.units.max()) + 1
    if repeated:
        notes.append("Intervals of D need one row for each subject; they are not given.")
    in_question = list(_families(design))
    comparisons = []
    for number, (of, along, hypotheses) in enumerate(in_question):
        part = part_of(
            tick, 0.5 + 0.4 * number / len(in_question), 0.5 + 0.4 * (number + 1) / len(in_question)
        )
        each = differences(
            shapes, None if repeated else scores, hypotheses, permutations=draws, seed=seed, tick=part
        )
        comparisons.append(Differences(of, along, each))
    notes += _unequal_slopes(shapes, design, question, part_of(tick, 0.9, 1.0))
    names = tuple(sample.names[row] for row in rows)
    return FormulaAnswer(question, design, names, coordinates, modes, tuple(comparisons), tuple(notes))


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


def _unequal_slopes(shapes: FloatArray, design: Design, question: FormulaQuestion, tick: Tick) -> list[str]:
    """Return a note for each number whose slope differs between levels, although the design has one slope."""
    rows = shapes.reshape(len(shapes), -1)
    together = {frozenset(pair) for term in design.terms for pair in permutations(term.factors, 2)}
    notes = []
    for number in design.numbers:
        for factor in design.levels:
            if frozenset((number, factor)) in together:
                continue
            try:
                hypothesis = design.common_slope(number, factor)
            except InputError:
                notes.append(
                    f"Whether {number} has one slope in all of {factor} can't be tested: too few rows."
                )
                continue
            test = Randomization(
                hypothesis, rows, draws=question.permutations, seed=question.seed, tick=tick
            ).ratio(rows)
            if test.p <= LEVEL:
                p = p_text(test.p, question.permutations)
                notes.append(
                    f"The slope of {number} differs between levels of {factor} ({p}): their "
                    f"means differ otherwise elsewhere along {number}; ask for {factor}:{number}."
                )
    return notes
