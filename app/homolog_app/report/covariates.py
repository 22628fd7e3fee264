"""Effects of the covariates of a study, in sentences and as rows of a table."""

from collections.abc import Iterator

import numpy as np

from homolog.analysis.cautions import LEVEL, p_number, p_text
from homolog.analysis.comparison import Comparison
from homolog.analysis.effects import Effect
from homolog_app.report.study import Study

__all__ = ["covariate_effects", "covariate_rows", "covariate_sentences"]


def covariate_sentences(study: Study) -> Iterator[str]:
    """Yield a sentence on each covariate of a study."""
    for effect in study.overall.covariates:
        test = effect.test
        whole = "no mode exceeds chance"
        if test.modes:
            far = (
                ""
                if effect.distance is None
                else f"D = {_interval(effect.distance, f' SD{_unit(effect)}')}, "
            )
            whole = f"{far}whole shape {p_text(effect.p_adjusted, test.permutations)}"
        inside = int(np.count_nonzero(effect.p_fwe <= LEVEL))
        yield (
            f"Covariate {effect.title}: {whole}; {inside} of {len(effect.p_fwe)} particles, "
            f"{_percent(study, effect):.1f} % of the surface, are significant{_size_text(effect)}."
        )


def covariate_effects(study: Study) -> Iterator[str]:
    """Yield the significant effects of covariates on the whole shape or on size, in a few words."""
    for effect in study.overall.covariates:
        parts = []
        if effect.test.modes and effect.p_adjusted <= LEVEL:
            parts.append(f"whole shape {p_text(effect.p_adjusted, effect.test.permutations)}")
        size = _size_of(effect)
        if size is not None and size.p is not None and size.p <= LEVEL and np.isfinite(size.value):
            measured = _interval(size, f" mm{_unit(effect)}")
            parts.append(f"size {measured}, {p_text(size.p, size.permutations)}, not corrected")
        if parts:
            yield f"{effect.title}: {', '.join(parts)}"


def _size_of(effect: Comparison) -> Effect | None:
    """Return the effect on size, if it is reported."""
    return effect.size if effect.reports_size else None


def _size_text(effect: Comparison) -> str:
    """Return the effect on size with its p, or nothing where size is not reported."""
    size = _size_of(effect)
    if size is None or size.p is None or not np.isfinite(size.value):
        return ""
    return f"; size alone {_interval(size, f' mm{_unit(effect)}')}, {p_text(size.p, size.permutations)}"


def covariate_rows(study: Study) -> list[tuple[str, ...]]:
    """Return a row for each covariate: title, modes, D, p, particles, area, smallest p, size, p of size."""
    return [_row(study, effect) for effect in study.overall.covariates]


def _row(study: Study, effect: Comparison) -> tuple[str, ...]:
    test, size = effect.test, _size_of(effect)
    unit = _unit(effect)
    measured = size is not None and np.isfinite(size.value)
    return (
        f"{effect.title}{unit}",
        str(test.modes),
        _interval(effect.distance, "") if effect.distance is not None and test.modes else "–",
        p_number(effect.p_adjusted, test.permutations) if test.modes else "–",
        f"{np.count_nonzero(effect.p_fwe <= LEVEL)} of {len(effect.p_fwe)}",
        f"{_percent(study, effect):.1f}",
        p_number(float(effect.p_fwe.min()), effect.pointwise.permutations),
        _interval(size, "") if size is not None and measured else "–",
        p_number(size.p, size.permutations) if size is not None and size.p is not None else "–",
    )


def _unit(effect: Comparison) -> str:
    several = effect.pointwise.effect.shape[0] > 1
    return "" if several or " - " in effect.title else " per unit"


def _percent(study: Study, effect: Comparison) -> float:
    inside = float(study.areas[effect.p_fwe <= LEVEL].sum())
    return 100.0 * inside / max(float(study.areas.sum()), np.finfo(float).tiny)


def _interval(effect: Effect, unit: str) -> str:
    value, low, high = (f"{item:.3g}" for item in (effect.value, effect.low, effect.high))
    if not unit:
        return f"{value} ({low} to {high})"
    return f"{value}{unit} (95 % CI {low} to {high})"
