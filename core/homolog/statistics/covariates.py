"""Effects of the covariates of a study, each adjusted for the tested effect and for the others."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from homolog.arrays import FloatArray
from homolog.progress import Tick, no_tick, part_of
from homolog.statistics.comparison import Comparison, Options, run_comparison
from homolog.statistics.design import adjusted_design, covariate_columns, indicators, numbers

__all__ = ["with_covariate_effects", "with_unadjusted"]


def with_unadjusted(
    pairs: Sequence[Comparison], table: Mapping[str, Sequence[str | float]]
) -> tuple[Comparison, ...]:
    """Return comparisons of pairs of groups, with notes on covariates that are constant within a pair.

    Parameters
    ----------
    pairs : sequence of Comparison
        Their `subjects` are indices into the values of `table`.
    table : mapping of str to sequences
        Values of each covariate.
    """
    noted = []
    for pair in pairs:
        same = [
            title
            for title, values in table.items()
            if len({str(values[index]).strip() for index in pair.subjects.tolist()}) == 1
        ]
        note = f"{' and '.join(same)}: the same for all subjects of these two groups, not adjusted for here."
        noted.append(replace(pair, notes=(*pair.notes, note)) if same else pair)
    return tuple(noted)


def with_covariate_effects(
    comparison: Comparison,
    shapes: FloatArray,
    tested: Sequence[str] | FloatArray,
    table: Mapping[str, Sequence[str | float]],
    *,
    categories: Collection[str] = (),
    options: Options,
    tick: Tick = no_tick,
) -> Comparison:
    """Return a comparison with the effects of its covariates.

    Each covariate is tested like the comparison itself, but in its own modes. Effects of numbers are per
    unit. Effects of two categories are the second minus the first in alphabetical order.

    Parameters
    ----------
    comparison : Comparison
        Comparison of groups or along a continuous variable, adjusted for the covariates.
    shapes : (M, N, 3) array
        Positions of the whole cohort [mm].
    tested : sequence of str, or (m,) array
        Group of each of the comparison's m subjects, or the variable.
    table : mapping of str to sequences
        Values of each covariate for the m subjects.
    categories : collection of str
        Covariates whose numbers are codes of categories.
    options : Options
        Options of the comparison.
    tick : Tick
        Progress and cancellation.
    """
    if isinstance(tested, np.ndarray) and tested.dtype.kind == "f":
        main = tested[:, None]
    else:
        main = indicators(tested)
    effects = []
    for number, (title, values) in enumerate(table.items()):
        plain = None if title in categories else numbers(values)
        block = indicators(values) if plain is None else plain[:, None]
        name = title
        if plain is None and block.shape[1] == 1:
            name = f"{title}: {' - '.join(sorted({str(value).strip() for value in values})[::-1])}"
        others = {other: column for other, column in table.items() if other != title}
        nuisance = main
        if others:
            own = [item for item in categories if item in others]
            nuisance = np.column_stack([main, covariate_columns(others, categories=own)])
        effects.append(
            run_comparison(
                shapes,
                comparison.subjects,
                adjusted_design(block, nuisance, title),
                name,
                {"all": len(main)},
                options,
                part_of(tick, number / len(table), (number + 1) / len(table)),
                nested=False,
            )
        )
    return replace(comparison, covariates=tuple(effects))
