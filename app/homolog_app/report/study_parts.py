"""Parts of a study's report: where it found something, what its tests assume, false positives, settings."""

from collections.abc import Iterator, Mapping, Sequence
from math import floor, log10

from pydantic import BaseModel

from homolog.analysis.assumptions import Dispersion
from homolog.analysis.cautions import LOOSE, f_excess, p_number
from homolog.analysis.comparison import Comparison
from homolog.analysis.effects import Effect
from homolog.analysis.procrustes import Alignment
from homolog.files.records import ResultRecord
from homolog_app.report.findings import LEVEL, group_dispersions, p_text
from homolog_app.report.page import Page
from homolog_app.report.study import Study
from homolog_app.report.surface_maps import EDGE, INNER, OUTER, Region, SurfaceCarrier, significant_regions

__all__ = [
    "add_assumptions", "add_false_positives", "add_regions", "digits_of", "effect_cell", "interval_cell",
    "scale_text", "settings_rows", "values_of",
]  # fmt: skip


def scale_text(study: Study) -> str:
    """Return at what size millimetres are, where shapes were brought to one."""
    if study.request.alignment is not Alignment.SIMILARITY:
        return ""
    return " mm and mm² are those of shapes of the cohort's mean size."


def add_regions(
    page: Page, study: Study, carrier: SurfaceCarrier, pictured: Mapping[str, str]
) -> dict[str, str]:
    """Add the regions where particles are significant, a table for each comparison.

    `pictured` says which figure shows those of a comparison. Returns which table has them.
    """
    differing = [
        (comparison, regions)
        for comparison in study.comparisons
        if (regions := significant_regions(study, comparison, carrier))
    ]
    if not differing:
        return {}
    page.heading("Where", 3)
    hollow = any(regions[0].wall for _, regions in differing)
    page.paragraph(
        f"Connected regions of particles with p ≤ {LEVEL:g}, corrected over the surface, pairs and "
        "analyses; figures show them by the numbers of the tables. " + _axes_text(carrier)
        + (
            " The shape is hollow. Its inner surface mostly sees itself or faces itself across the cavity; "
            "the edge of the opening lies between the inner and the outer surface. Each region lies on one "
            "of these three."
            if hollow
            else ""
        )
        + scale_text(study)
    )  # fmt: skip
    tables = {}
    for comparison, regions in differing:
        tables[comparison.title] = page.following("Table")
        _add_table(page, study, comparison, regions, pictured.get(comparison.title, ""))
    page.paragraph(
        "Outward is along the normal of the mean surface, positive out of the tissue. Its mean is that over "
        "the region's area, and the interval of the mean is the mean of the particles' intervals, which is "
        "at least as wide. The peak is the particle with the largest studentized statistic. Intervals are "
        "not corrected over the surface; as regions and peaks were chosen by their statistics, their effects "
        "are overestimated. The position was tested in all directions, so that the interval of its outward "
        "part alone may contain zero. Where the displacement at the peak is much longer than its outward "
        "part, particles move along the surface, towards the side named. On a smooth surface this may be a "
        "different distribution of corresponding points rather than of tissue; claim it only near edges and "
        "landmarks."
        + (
            " The thickness of the wall was not tested; where both surfaces move out of the tissue, the wall "
            "is thicker."
            if hollow
            else ""
        )
    )
    if hollow:
        _add_walls(page, study, carrier)
    return tables


def _axes_text(carrier: SurfaceCarrier) -> str:
    if carrier.directions.are_the_patients:
        return (
            "Places are directions from the middle of the mean shape along the patient's axes, as the files "
            "state them: left is towards the patient's left, anterior towards the front, superior towards "
            "the head."
        )
    if carrier.directions.are_named:
        sides = zip(carrier.directions.sides, "xyz", strict=True)
        named = ", ".join(f"{low} and {high} of smaller and larger {axis}" for (low, high), axis in sides)
        return (
            f"Places are sides of the mean shape, seen from its middle, as the authors named them: {named}."
        )
    return (
        "Places are directions from the middle of the mean shape along the axes of the coordinates (of "
        "images: x to the left, y to the back, z to the head, as their headers have it), which are not taken "
        "to be those of the patient: +z is the side of larger z. Describe parts by their anatomical names "
        "from the figures."
    )


def _add_table(
    page: Page, study: Study, comparison: Comparison, regions: list[Region], pictured: str
) -> None:
    per = f" per unit of {study.request.column}" if study.request.kind == "regression" else ""
    rows = [
        (
            f"{number}",
            f"{region.area:.0f} ({len(region.particles)})",
            region.where,
            effect_cell(study, region.mean_outward),
            effect_cell(study, region.outward),
            f"{region.length:.{digits_of(study, region.outward.high - region.outward.low)}f}, {region.way}",
            p_number(region.p, comparison.pointwise.permutations),
        )
        for number, region in enumerate(regions, start=1)
    ]
    page.table(
        [
            "region", "area (mm²; particles)", "place of the peak", f"outward, mean (mm{per}, 95 % CI)",
            f"outward at the peak (mm{per}, 95 % CI)", f"moves at the peak (mm{per}), towards",
            "p at the peak",
        ],
        rows,
        as_text=True,
        caption=f"Regions of {comparison.title}" + (f" ({pictured})" if pictured else ""),
    )  # fmt: skip


def _add_walls(page: Page, study: Study, carrier: SurfaceCarrier) -> None:
    """Add how much of each wall of a hollow shape is significant, and moves which way."""
    walls = carrier.walls_at_particles(len(study.areas))
    rows = []
    for comparison in study.comparisons:
        if len(comparison.pointwise.effect) > 1:
            continue
        ways = carrier.ways_at_particles(comparison)
        for wall in (INNER, OUTER, EDGE):
            own = [index for index, name in enumerate(walls) if name == wall]
            if not own:
                continue
            areas, inside = study.areas[own], comparison.p_fwe[own] <= LEVEL
            whole = float(areas.sum())
            rows.append(
                (
                    comparison.title, wall, f"{whole:.0f}",
                    *(
                        f"{areas[some].sum():.0f} ({100.0 * areas[some].sum() / whole:.1f} %)"
                        for some in (inside, *(inside & (ways[own] == way) for way in (1, -1, 0)))
                    ),
                )
            )  # fmt: skip
    page.table(
        ["comparison", "wall", "area (mm²)", "significant (mm²)", "out of the tissue (mm²)",
         "into the tissue (mm²)", "neither clearly (mm²)"],
        rows,
        as_text=True,
        caption="Significant area of each wall, and which way it moves",
    )  # fmt: skip
    page.paragraph(
        "Area counts as moving out of the tissue or into it where the 95 % interval of the outward "
        "displacement excludes zero, and otherwise as neither: there the displacement is significant as a "
        "whole, but not its outward part."
    )


def interval_cell(effect: Effect, digits: int = 2, scale: float = 1.0) -> str:
    """Return an estimate with its interval as tables have it, such as ``"1.27 (0.41 to 2.02)"``."""
    value, low, high = (f"{scale * item:.{digits}f}" for item in (effect.value, effect.low, effect.high))
    return f"{value} ({low} to {high})"


def effect_cell(study: Study, effect: Effect) -> str:
    """Return an effect with its interval; changes per unit have three digits of the interval's width."""
    return interval_cell(effect, digits_of(study, effect.high - effect.low))


def digits_of(study: Study, width: float) -> int:
    """Return the decimals of an effect whose interval is so wide."""
    if study.request.kind != "regression" or not width > 0.0:
        return 2
    return max(2, 2 - floor(log10(width)))


_EXCHANGE = {
    "groups": "Permutation tests assume that without an effect {who} are exchangeable between groups.",
    "regression": "Permutation tests assume that without an effect subjects (their residuals) are "
    "exchangeable along the variable.",
    "pairs": "Permutation tests assume that without an effect the differences of pairs are symmetric about "
    "zero, so that their signs are exchangeable, and that pairs are independent of each other.",
}
_DISPERSION = {
    "groups": "Dispersion is the mean distance of subjects from {centre}, root mean "
    "square over the particles, in the modes of the comparison. These modes and the alignment are the "
    "comparison's own, so that a group's value differs between comparisons. Dispersions are compared by "
    "permutation (PERMDISP); intervals come from the jackknife of their logarithms.",
    "regression": "Whether dispersion changes with the variable is tested by permutation of the distances "
    "from the fitted shapes (PERMDISP); the interval comes from the jackknife.",
    "pairs": "",
}
_DISPERSION_EFFECT = {
    "groups": "ratio of dispersions (95 % CI)",
    "regression": "change per unit (mm, 95 % CI)",
    "pairs": "ratio",
}
_FAR = {
    "groups": "the subject's distance from {mean}, divided by the group's median distance",
    "regression": "the subject's distance from the shape fitted to its value",
    "pairs": "the distance of a pair's difference from the mean difference (the first of the pair is named)",
}
_EXCHANGED = {
    "groups": "The labels of the groups were permuted",
    "regression": "The values of the variable were permuted",
    "pairs": "The signs of the differences were drawn at random",
}


def add_assumptions(page: Page, study: Study) -> None:
    """Add the assumptions of the tests, with dispersion, skewness and outliers of each comparison."""
    kind = study.request.kind
    page.heading("Assumptions", 3)
    adjusted = bool(study.request.covariates)
    who = "residuals (what covariates leave of subjects)" if adjusted else "subjects"
    centre = "the shape fitted to them" if adjusted else "the centroid of their group"
    sentences = [_EXCHANGE[kind].format(who=who), _DISPERSION[kind].format(centre=centre)]
    if any(comparison.size_skewness is not None for comparison in study.comparisons):
        sentences.append(
            "Skewness of size is tested by D'Agostino's test, that of shapes by the same test of the five "
            "leading modes (squared deviates summed), both within groups."
            if kind == "groups"
            else "Skewness of the differences of size is tested by D'Agostino's test, that of the "
            "differences of shape by the same test of their five leading modes (squared deviates summed)."
        )
    mean = "the shape fitted to it" if adjusted else "the mean of its group"
    sentences.append(
        "Outliers have r above median(r) + 5 x 1.4826 MAD(r) of all that are compared: MAD is the median "
        "absolute deviation, 1.4826 MAD the standard deviation of normal data, r "
        f"{_FAR[kind].format(mean=mean)}. No p of this table is corrected; F of dispersion is compared with "
        "its permutations and needs no degrees of freedom."
    )
    page.paragraph(" ".join(filter(None, sentences)))
    page.table(
        [
            "comparison", "dispersion (mm, 95 % CI)", _DISPERSION_EFFECT[kind], "F of dispersion",
            "p of dispersion", "skewness of size", "p of skewness of shapes", "outliers",
        ],
        [_row(study, comparison) for comparison in study.comparisons],
        as_text=True,
        omit="–",
        caption="Assumptions of the tests",
    )  # fmt: skip


def _row(study: Study, comparison: Comparison) -> tuple[str, ...]:
    dispersion, skewness = comparison.dispersion, comparison.size_skewness
    tested = ("–", "–", "–", "–")
    if dispersion is not None:
        tested = (
            group_dispersions(dispersion) or "–",
            _ratio_cell(study, dispersion),
            f"{dispersion.f:.2f}",
            p_number(dispersion.p, dispersion.permutations),
        )
    return (
        comparison.title,
        *tested,
        "–" if skewness is None else f"{skewness.value:.2f} ({p_text(skewness.p)})",
        "–" if skewness is None else p_number(skewness.shape_p),
        ", ".join(
            f"{study.names[index]} (r {far:.3f}; limit {comparison.outlier_limit:.3f})"
            for index, far in zip(comparison.outliers, comparison.outlier_distances, strict=True)
        )
        or "none",
    )


def _ratio_cell(study: Study, dispersion: Dispersion) -> str:
    if dispersion.effect is None:
        return "–"
    cell = effect_cell(study, dispersion.effect)
    return f"{' / '.join(list(dispersion.by_group)[::-1])} {cell}".strip()


def add_false_positives(page: Page, study: Study) -> None:
    """Add the type I error rates of the null simulation, if there was one."""
    rows = [
        (
            comparison.title,
            test.test,
            f"{100 * test.rate:.1f}",
            f"{100 * test.low:.1f} – {100 * test.high:.1f}",
        )
        for comparison in study.comparisons
        for test in comparison.false_positives
    ]
    if not rows:
        return
    page.heading("Type I error rates on this cohort", 3)
    page.paragraph(
        f"{_EXCHANGED[study.request.kind]} {study.request.null_repeats} times, so that there is nothing to "
        "find, and tested without scaling of dispersions. Permutation tests then have a type I error rate of "
        "5 % by construction, but for chance in the draws: their rows check the software and do not validate "
        "the comparison. F is computed from the same draws, so that its rate is compared with that of the "
        f"permutation test: {_f_verdict(study)} The table shows neither whether groups are normally "
        "distributed nor what differences in dispersion do; see Assumptions."
    )
    page.table(
        ["comparison", "test", "type I error (%)", "95 % bounds"],
        rows,
        as_text=True,
        caption="Type I error rates where there is no effect",
    )


def _f_verdict(study: Study) -> str:
    """Return in which comparisons F of the whole shape has more false positives than permutations."""
    off = [comparison.title for comparison in study.comparisons if f_excess(comparison) > LOOSE]
    most = f"more than {100.0 * LOOSE:g} percentage points above it"
    if not off:
        return f"it is nowhere {most}."
    return f"it is {most} in {'; '.join(off)}, so that p (F) is not to be used there."


_NOT_GIVEN = {"core_set": "none", "segment": "none", "pairs": "none", "label": "all above 0"}
"""What settings are that are not given; others are then chosen by the program."""


def values_of(settings: BaseModel) -> Iterator[tuple[str, str]]:
    """Yield the name and the value, with its unit, of each setting."""
    for name, value in settings.model_dump(mode="json").items():
        extra = type(settings).model_fields[name].json_schema_extra
        unit = f" {extra['unit']}" if isinstance(extra, dict) and "unit" in extra else ""
        if value is None:
            yield name, _NOT_GIVEN.get(name, "automatic")
        elif isinstance(value, bool):
            yield name, "yes" if value else "no"
        elif isinstance(value, list):
            yield name, ", ".join(map(str, value)) or "none"
        else:
            yield name, f"{value}{unit}"


def settings_rows(record: ResultRecord, studies: Sequence[Study]) -> list[tuple[str, str, str]]:
    """Return every setting and version: part, name, value."""
    rows = [
        (part, name, value)
        for part, model in (("groom", record.settings.groom), ("optimize", record.settings.optimize))
        for name, value in values_of(model)
    ]
    rows += [("run", "alignment by particles", record.settings.placing.procrustes.value)]
    rows += [("run", "device", record.device), ("run", "fingerprint", record.fingerprint)]
    for number, study in enumerate(studies, start=1):
        rows += [
            (f"Study {number}", name, value)
            for name, value in values_of(study.request)
            if name != "earlier" and not (name in ("pairs", "covariates", "between") and value == "none")
        ]
    return rows + [("version", name, number) for name, number in record.versions.items()]
