"""Possible questions about groups or a number, and the texts of their tests."""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from homolog.cohort.column_types import CATEGORY
from homolog.comparison.answer import Answer
from homolog.comparison.findings import effect_text, share_of_surface
from homolog.comparison.formula import FormulaAnswer
from homolog.comparison.question import ALIGNED, Question
from homolog.comparison.sample import SHAPE_SIZE, SIZE
from homolog.errors import InputError
from homolog.statistics.assumptions import Dispersion
from homolog.statistics.cautions import LEVEL, p_text
from homolog.statistics.data_notes import PARTNER_MISSING
from homolog.statistics.design import is_missing, numbers
from homolog_app.rendering.text import short
from homolog_app.studies.study import Study

if TYPE_CHECKING:
    from homolog_app.studies.answers import GroupAnswer

__all__ = [
    "SIZE",
    "correction_text",
    "covariates_of",
    "has_missing",
    "number_rows",
    "numbers_of",
    "pairings_of",
    "question_text",
    "size_name",
    "strata_of",
    "subjects_of",
    "values_of",
]


_LEAST = 2
_FEWEST_NUMBERS = 3
_MOST_CATEGORIES = 12


def size_name(study: Study) -> str:
    """Return the name of the shapes' size: ``size``, unless the table has a column of that name."""
    return SHAPE_SIZE if SIZE in study.columns else SIZE


def values_of(study: Study, column: str) -> list[str]:
    """Return the values of a column that two or more included subjects have, sorted."""
    counts = Counter(_cells(study, column))
    return sorted(cell for cell, count in counts.items() if cell and count >= _LEAST)


def numbers_of(study: Study, *, complete: bool = False) -> dict[str, str]:
    """Return the numeric columns, each with the reason why it can't be used, or an empty text.

    Size is included; unusable columns come last. With `complete`, missing values are allowed.
    """
    own = size_name(study)
    problems = {own: ""}
    for column in study.columns:
        if column.endswith(CATEGORY):
            continue
        try:
            values = numbers([cell for cell in _cells(study, column) if cell])
        except InputError as error:
            problems[column] = str(error)
            continue
        if values is not None and len(set(values.tolist())) >= _FEWEST_NUMBERS:
            problems[column] = "" if complete else _missing(study, column)
    return dict(sorted(problems.items(), key=lambda item: (bool(item[1]), item[0] == own)))


def has_missing(study: Study) -> bool:
    """Return whether an included subject lacks a value of a column."""
    return any(_missing(study, column) for column in study.columns)


def covariates_of(study: Study, column: str, *, complete: bool = False) -> dict[str, str]:
    """Return the possible covariates for a column, each with a reason why it can't be used, or an empty text.

    Numbers with few values are also offered as codes of categories (``site:c``).
    """
    problems = {}
    own = size_name(study)
    for name in ("group", *study.columns, own):
        if name == column:
            continue
        cells = _cells(study, name)
        if name == own:
            problems[name] = ""
        elif any(cells):
            missing = "" if complete else _missing(study, name)
            problems[name] = missing or _unusable([cell for cell in cells if cell])
            if _are_codes(cells) and not name.endswith(CATEGORY):
                problems[f"{name}{CATEGORY}"] = problems[name]
    return problems


def _unusable(cells: list[str]) -> str:
    """Return why values can't be adjusted for: all equal, or too many categories."""
    several = len(set(cells))
    if several == 1:
        return "The same for all subjects"
    try:
        categorical = numbers(cells) is None
    except InputError as error:
        return str(error)
    return (
        f"{several} different values, too many for categories"
        if categorical and several > len(cells) / 2
        else ""
    )


def pairings_of(study: Study, column: str, between: tuple[str, str]) -> list[str]:
    """Return the columns that uniquely pair at least half of the subjects with two values of a column."""
    labels = _cells(study, column)
    offered = []
    for name in ("group", *study.columns):
        places = [
            (cell, label)
            for cell, label in zip(_cells(study, name), labels, strict=True)
            if cell and label in between
        ]
        pairs = list(Counter(cell for cell, _ in places).values()).count(2)
        alone = len(set(places)) == len(places)
        if name != column and alone and pairs >= max(_LEAST, sum(label in between for label in labels) / 4):
            offered.append(name)
    return offered


def subjects_of(study: Study) -> list[str]:
    """Return the columns that may name subjects of repeated measures: more values than rows of one value."""
    counts = {name: Counter(_cells(study, name)) for name in study.columns}
    return [
        name for name, own in counts.items() if "" not in own and 1 < max(own.values(), default=0) < len(own)
    ]


def strata_of(study: Study) -> list[str]:
    """Return the columns that may be strata: each value stands in two rows or more."""
    counts = {name: Counter(_cells(study, name)) for name in study.columns}
    return [
        name for name, own in counts.items() if "" not in own and len(own) > 1 and min(own.values()) >= _LEAST
    ]


def _are_codes(cells: list[str]) -> bool:
    try:
        values = numbers([cell for cell in cells if cell])
    except InputError:
        return False
    return values is not None and 2 < len(set(values.tolist())) <= min(_MOST_CATEGORIES, len(cells) // 2)


def _missing(study: Study, column: str) -> str:
    """Name the subjects without a value, if any."""
    cells = _cells(study, column)
    names = [subject.name for subject, cell in zip(study.included, cells, strict=True) if not cell]
    return f"No value for {', '.join(names[:3])}{' …' * (len(names) > 3)}" if names else ""


def _cells(study: Study, column: str) -> list[str]:
    """Return a column of the included subjects, missing values as empty text."""
    cells = [
        subject.group or "" if column == "group" else subject.columns.get(column, "")
        for subject in study.included
    ]
    return ["" if is_missing(cell) else cell for cell in cells]


def correction_text(answer: Answer) -> str:
    """Return the correction of p-values for pairs of groups, or nothing."""
    return f"corrected for {len(answer.pairwise)} pairs of groups (Holm)" if answer.pairwise else ""


def question_text(request: Question) -> str:
    """Return alignment, covariates and exclusions, for the line below the headline."""
    how = ALIGNED[request.alignment]
    parts = [f"{how[0].upper()}{how[1:]}"]
    parts += [f"paired by {request.pairs}"] if request.pairs else []
    parts += [f"adjusted for {', '.join(request.covariates)}"] if request.covariates else []
    parts += [f"repeated within {request.subject}"] if request.subject else []
    parts += [f"within {request.strata}"] if request.strata else []
    parts += ["subjects with missing values excluded"] if request.complete_cases else []
    return f"{', '.join(parts)}."


def number_rows(answers: "list[GroupAnswer]") -> list[tuple[str, ...]]:
    """Return the rows of the table: a name and a value for each answer."""
    columns = [dict(_rows(answer)) for answer in answers]
    names = list(dict.fromkeys(name for column in columns for name in column))
    return [(name, *(column.get(name, "–") for column in columns)) for name in names]


def _rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    pair, study = answer.pair, answer.study
    slope = answer.values is not None
    rows = [*_subject_rows(answer), *_test_rows(answer)]
    if pair.dispersion is not None:
        rows.append(("Dispersion", _dispersion_text(pair.dispersion)))
    inside = int(np.count_nonzero(pair.p_fwe <= LEVEL))
    share = f"{inside} of {len(pair.p_fwe)} particles, {share_of_surface(study, pair):.1f} % of the surface"
    rows.append((f"Significant area (FWE-corrected p ≤ {LEVEL:g})", share))
    likely = int(np.count_nonzero(pair.pointwise.q <= LEVEL))
    rows.append(("At a false discovery rate of 5 %", f"{likely} particles"))
    if slope:
        most = float(np.linalg.norm(answer.difference.ways, axis=1).max())
        rows.append(("Change", f"up to {short(most)} mm from {answer.first} to {answer.second}"))
    if isinstance(study, FormulaAnswer):
        row = study.coordinates[study.terms.index(pair) - len(study.terms) - 2]
        rows.append(("Degrees of freedom, sum of squares", f"{row.dof}, {row.squares:.4g} mm²"))
        rows.append(("R², F, Z", f"{row.r_squared:.3f}, {row.f or 0.0:.2f}, {row.z or 0.0:.2f}"))
    if study.question.covariates:
        rows.append(("Adjusted for", ", ".join(study.question.covariates)))
    rows += [*_classification_rows(answer), *_size_rows(answer)]
    return rows


def _subject_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    study, slope = answer.study, answer.values is not None
    counts = answer.pair.counts.items()
    is_one = slope or study.question.kind == "formula"
    rows = [("Subjects", ", ".join(f"{count}{'' if is_one else f' {name}'}" for name, count in counts))]
    if study.left_out and study.question.complete_cases:
        incomplete = sum(why.startswith("no value") for why in study.left_out.values())
        alone = sum(why == PARTNER_MISSING for why in study.left_out.values())
        partners = f", {alone} whose partner is missing" if alone else ""
        rows.append(("Excluded", f"{incomplete} with missing values{partners} (complete cases)"))
    return rows


def _test_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    """Return the rows on the test of the whole shape."""
    pair, test = answer.pair, answer.pair.test
    rows = [("Modes retained (parallel analysis)", str(test.modes))]
    if pair.distance is not None and test.modes:
        name = "Mahalanobis D" if answer.values is None else "Change per unit"
        rows.append((name, effect_text(pair.distance, " SD", ci="90 % CI ")))
    if pair.explained is not None:
        rows.append(("Explained variance ω²", effect_text(pair.explained, ci="90 % CI ")))
    if not test.modes:
        return rows
    how = f"All {test.permutations + 1} permutations" if test.exact else f"{test.permutations} permutations"
    rows.append((how, p_text(test.p_permutation, test.permutations)))
    if correction := correction_text(answer.study):
        rows.append(("Corrected", f"{p_text(pair.p_adjusted, test.permutations)}, {correction}"))
    if test.t_squared is not None:
        rows += [
            ("Hotelling's T²", f"{test.t_squared:.1f}"),
            (f"F({test.dof[0]:g}, {test.dof[1]:.4g})", f"{test.f:.2f}, {p_text(test.p)}"),
        ]
    return rows


def _classification_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    pair, discriminant = answer.pair, answer.pair.discriminant
    if discriminant is None:
        return []
    right = ", ".join(
        f"{round(own, 1):g} of {count} {name}"
        for own, (name, count) in zip(discriminant.right, pair.counts.items(), strict=True)
    )
    known = ((p, discriminant.auc.permutations) for p in (pair.accuracy_p_adjusted, pair.auc_p_adjusted))
    accuracy, auc = ("" if p is None else f", {p_text(p, count)}" for p, count in known)
    return [
        (
            "Balanced accuracy",
            f"{effect_text(discriminant.accuracy, ' %', ci='95 % CI ', step=100.0)}{accuracy}",
        ),
        ("Classified correctly", right),
        ("AUC", f"{effect_text(discriminant.auc, ci='95 % CI ')}{auc}"),
    ]


def _size_rows(answer: "GroupAnswer") -> list[tuple[str, str]]:
    pair, rows = answer.pair, list[tuple[str, str]]()
    overall, between = answer.study.overall.size, answer.study.overall.size_variance
    if overall is not None and overall.p is not None and between is not None:
        p, share = p_text(overall.p, overall.permutations), between.omega_squared
        f = f"F({between.dof[0]:g}, {between.dof[1]:.3g}) = {between.f:.2f}"
        rows.append(("Size of all groups", f"{f}, ω² = {effect_text(share, ci='90 % CI ')}, {p}"))
    if pair.size is not None and pair.size_p_adjusted is not None:
        unit = f" mm per unit of {pair.title}" if answer.values is not None else " mm"
        p = p_text(pair.size_p_adjusted, pair.size.permutations)
        rows.append(("Size", f"{effect_text(pair.size, unit, ci='95 % CI ', sign=True)}, {p}"))
    return rows


def _dispersion_text(dispersion: Dispersion) -> str:
    """Return the dispersion of groups, or its change along a variable, with interval and p."""
    groups = ", ".join(f"{name} {value:.2g} mm" for name, value in dispersion.by_group.items())
    ratio = "" if dispersion.effect is None else effect_text(dispersion.effect, ci="95 % CI ")
    second = f"{'ratio' if groups else 'mm per unit'} {ratio}" if ratio else ""
    return ", ".join(filter(None, (groups, second, p_text(dispersion.p, dispersion.permutations))))
