"""What is said of a reference, a patient and its later times, alike in every interface."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime

import numpy as np

from homolog.arrays import BoolArray
from homolog.errors import InputError, NumericalError
from homolog.geometry import rms_radius
from homolog.patient.checks import control_remarks
from homolog.patient.compare import PatientComparison, named_direction
from homolog.patient.distribution import Percentile
from homolog.patient.follow_up import Change, FollowUp
from homolog.patient.joint import JointComparison, JointReference, PatientPose
from homolog.patient.local import BEST_WIDTHS, Region
from homolog.patient.reference import Reference
from homolog.patient.typicality import Typicality, typicality

__all__ = [
    "GROUP_CAUTION",
    "GROUP_COLUMNS",
    "GroupRow",
    "beyond_limit",
    "change_sentence",
    "change_sentences",
    "finding",
    "findings",
    "group_rows",
    "group_sentence",
    "joint_finding",
    "limit_text",
    "measure_rows",
    "nearest_controls_text",
    "pairs_of",
    "pose_rows",
    "pose_sentence",
    "reference_rows",
    "reference_text",
    "region_rows",
    "times_text",
    "visible_rows",
    "who_text",
]

_USUALLY_NEAR = 0.95
"""Fraction of particles in place above which there is no caution."""
_COARSE = 0.12
"""Fraction of the size (root mean square radius); a larger limit detects gross changes only."""


def who_text(comparison: PatientComparison, reference: Reference) -> str:
    """Name the reference, the patient's covariates, and the day of the report."""
    given = _covariates(comparison)
    return f"{_source(reference)}.{f' Patient: {given}.' if given else ''} {_day()}"


def times_text(comparisons: Sequence[PatientComparison], reference: Reference) -> str:
    """Name a patient's times with their covariates, the reference, and the day of the report."""
    times = []
    for comparison in comparisons:
        given = _covariates(comparison)
        times.append(f"{comparison.name}{f' ({given})' if given else ''}")
    return f"Times: {'; '.join(times)}. {_source(reference)}. {_day()}"


def _covariates(comparison: PatientComparison) -> str:
    return ", ".join(f"{name} {value}" for name, value in comparison.covariates.items())


def _source(reference: Reference) -> str:
    about = reference.provenance
    group = f", {about.group}" if about.group else ""
    return f"Reference: {about.project}{group}, {about.controls} controls"


def _day() -> str:
    return f"Report of {datetime.now(UTC).date().isoformat()}."


def reference_text(reference: Reference | JointReference) -> list[str]:
    """Describe a reference of one or several structures in a few lines."""
    if isinstance(reference, JointReference):
        return _joint_reference_text(reference)
    about, quality = reference.provenance, reference.quality
    lines = [
        f"{about.controls} controls{f' ({about.group})' if about.group else ''} of {about.project}, "
        f"{about.particles} particles, {reference.modes} modes above chance"
        f"{', adjusted for ' + ' and '.join(reference.coding.names) if reference.coding.names else ''}",
        f"controls fitted as patients: {quality.outside:.2f} mm from the fitted model on average; "
        f"{100.0 * quality.near:.0f} % of particles within 0.3 spacings of their position in the joint run",
        f"limit: |z| = {reference.limit:.2f}, on average {quality.limit_mm:.1f} mm",
    ]
    if (change := reference.change) is not None:
        typical = float(change.limit * change.local.deviation.mean())
        lines.append(
            f"{change.pairs} controls scanned twice ({change.between}): a change of {typical:.1f} mm on "
            "average is beyond theirs"
        )
    if quality.near < _USUALLY_NEAR:
        lines.append(
            "caution: particles of a patient may differ from their positions in a joint run; maps, "
            "regions and percentiles do not depend on them"
        )
    size = float(rms_radius(reference.surface.vertices))
    if quality.limit_mm > _COARSE * size:
        lines.append(
            f"caution: controls vary much outside the modes; only differences of about "
            f"{quality.limit_mm:.1f} mm are detected (size {size:.0f} mm); more controls or particles may "
            "help"
        )
    lines += [f"caution: {remark}" for remark in control_remarks(reference)]
    if reference.mirrored is not None and reference.side_limit is None:
        lines.append("the side can't be determined from the shape: controls fit about as well mirrored")
    if about.controls < 20:
        lines.append(
            f"caution: {about.controls} controls are few; limits are wide and percentiles coarse (20 or "
            "more are better)"
        )
    if reference.scores is not None:
        lines.append(f"contains the controls' scores{' and names' if reference.names else ''}")
    return lines


def reference_rows(reference: Reference) -> list[tuple[str, str]]:
    """Describe a reference as a table."""
    about = reference.provenance
    groom = about.groom
    group = f", {about.group}" if about.group else ""
    structure = groom.segment or (f"label {groom.label}" if groom.label else "all labels")
    return [
        ("Reference", f"{about.project}{group} ({reference.fingerprint})"),
        ("Controls", str(about.controls)),
        ("Adjusted for", ", ".join(reference.coding.names) or "nothing"),
        ("Modes", f"{reference.modes} above chance; {len(reference.model.variances)} fitted"),
        ("Particles", str(about.particles)),
        ("Scores of controls", "stored, with names" if reference.names else "stored")
        if reference.scores is not None
        else ("Scores of controls", "not stored"),
        (
            "Controls scanned twice",
            "none" if reference.change is None else f"{reference.change.pairs}, {reference.change.between}",
        ),
        ("Particles in place", _placed_text(reference)),
        ("Limit of |z|", f"{reference.limit:.2f} (5 % of healthy subjects anywhere)"),
        ("Structure", structure),
        ("Side", _side_text(reference)),
        ("Made", f"{about.made}, Homolog {about.versions.get('homolog', '')}"),
        ("Result", f"{about.finished} ({about.result[:16]})"),
    ]


def _placed_text(reference: Reference) -> str:
    quality = reference.quality
    return (
        f"{100.0 * quality.near:.0f} % of those of held-out controls within 0.3 spacings of the joint run, "
        f"95 % within {quality.error_95:.2f}"
    )


def _side_text(reference: Reference) -> str:
    if reference.mirrored is None:
        return "not checked"
    if reference.side_limit is None:
        return "can't be determined from the shape: a mirrored file is not recognized"
    return "checked by the shape"


def finding(comparison: PatientComparison, reference: Reference) -> str:
    """Summarize the comparison in a sentence: size, whole shape, places, and what could have been found."""
    controls = reference.provenance.controls
    usual = "expected" if reference.coding.names else "mean"
    position, thickness = reference.detectable
    least, most = np.quantile(position, (0.05, 0.95)).tolist()
    return (
        f"Size is {100.0 * comparison.size.value:.0f} % of the {usual} size "
        f"({_rank(comparison.size, controls, 'larger', 'smaller')}), the whole shape is at percentile "
        f"{comparison.mahalanobis.percent:.0f} in the modes and {comparison.outside.percent:.0f} outside "
        f"them, and {_places(comparison, reference)}; smallest difference that could have been found: "
        f"{reference.quality.limit_mm:.1f} mm ({least:.1f} to {most:.1f} by place), or a wall thinner by "
        f"{-100.0 * np.expm1(-float(thickness.mean())):.0f} %."
    )


def pairs_of(
    comparison: PatientComparison | JointComparison, reference: Reference | JointReference
) -> dict[str, tuple[PatientComparison, Reference]]:
    """Return the comparison of each structure with its reference; that of a single one without a name."""
    if isinstance(comparison, PatientComparison):
        assert isinstance(reference, Reference), "a reference of a single structure"
        return {"": (comparison, reference)}
    assert isinstance(reference, JointReference), "a reference of several structures"
    return {name: (own, reference.structures[name]) for name, own in comparison.structures.items()}


def findings(
    comparison: PatientComparison | JointComparison, reference: Reference | JointReference
) -> list[str]:
    """Summarize a comparison of one or several structures, in one sentence for each."""
    if isinstance(comparison, JointComparison) and isinstance(reference, JointReference):
        return joint_finding(comparison, reference)
    return [finding(*pair) for pair in pairs_of(comparison, reference).values()]


def joint_finding(comparison: JointComparison, reference: JointReference) -> list[str]:
    """Summarize the comparison of several structures: a sentence for each, and for each pose."""
    lines = [
        f"{name}: {finding(own, reference.structures[name])}" for name, own in comparison.structures.items()
    ]
    lines += [pose_sentence(pose, reference) for pose in comparison.poses]
    return [*lines, *(f"{name} could not be compared: {text}" for name, text in comparison.problems.items())]


def pose_sentence(pose: PatientPose, reference: JointReference) -> str:
    """Tell how a structure lies to another one."""
    norm = next(item for item in reference.poses if item.structure == pose.structure)
    axis, way = named_direction(pose.rotation), named_direction(pose.translation)
    turned = _rank(pose.turn, len(norm.turns), "farther", "nearer")
    moved = _rank(pose.shift, len(norm.shifts), "farther", "nearer")
    return (
        f"{pose.structure} against {pose.against}: turned by {pose.angle:.1f}° about the axis to "
        f"{axis} ({turned}) and shifted by {pose.distance:.1f} mm to {way} ({moved}), relative to the "
        f"{'expected' if reference.first.coding.names else 'mean'} pose."
    )


def pose_rows(comparison: JointComparison) -> list[tuple[str, str, str, str]]:
    """Return the numbers of the poses: name, value, percentile with interval, p."""
    rows = []
    for pose in comparison.poses:
        turn, shift = (
            ", ".join(f"{value:+.1f}" for value in item.tolist())
            for item in (pose.rotation, pose.translation)
        )
        name = f"{pose.structure} against {pose.against}"
        rows += [
            (f"Turn of {name}", f"{pose.angle:.1f}° ({turn}), {pose.turn.value:.1f} SD", pose.turn),
            (f"Shift of {name}", f"{pose.distance:.1f} mm ({shift}), {pose.shift.value:.1f} SD", pose.shift),
        ]
    return [(name, value, _percent_text(item), f"{item.p:.2g}") for name, value, item in rows]


def _joint_reference_text(reference: JointReference) -> list[str]:
    """Describe a reference of several structures in a few lines."""
    lines = [
        f"{'caution: ' if line.startswith('caution') else ''}{name}: {line.removeprefix('caution: ')}"
        for name, own in reference.structures.items()
        for line in reference_text(own)
    ]
    for norm in reference.poses:
        turn, shift = (np.sqrt(np.trace(item)) for item in norm.covariances)
        lines.append(
            f"{norm.structure} against {norm.against}: controls differ by {turn:.1f}° and {shift:.1f} mm "
            f"(root mean square, {len(norm.turns)} controls)"
        )
    return lines


def _rank(size: Percentile, controls: int, above: str, below: str) -> str:
    if size.percent in (0.0, 100.0):
        return f"{above if size.percent else below} than all {controls} controls"
    return f"percentile {size.percent:.0f} of {controls} controls"


def _places(comparison: PatientComparison, reference: Reference) -> str:
    count = len(comparison.regions)
    if not count:
        return (
            f"no place differs by more than the limit (largest |z| {comparison.local.value:.1f}, limit "
            f"{reference.limit:.1f})"
        )
    first = comparison.regions[0]
    where = comparison.place(first)
    area = sum(region.area for region in comparison.regions)
    places = "1 place differs" if count == 1 else f"{count} places differ"
    return (
        f"{places} by more than the limit, {area:.0f} mm² in total, most of all {abs(first.peak):.1f} mm "
        f"{_side(first)} with a wall {abs(100.0 * first.thicker):.0f} % {_wall(first)} than expected"
        f"{f' ({where})' if where else ''}, |z| {abs(first.z):.1f} (limit {reference.limit:.1f})"
    )


def nearest_controls_text(comparison: PatientComparison, reference: Reference) -> str:
    """Name the controls that are most similar to the patient; empty if the reference has no scores."""
    nearest = reference.nearest(comparison.fit.scores)
    if not nearest:
        return ""
    listed = ", ".join(f"{name} ({apart:.1f} SD)" if name else f"{apart:.1f} SD" for name, apart in nearest)
    return f"Nearest controls by Mahalanobis distance in the modes: {listed}."


def measure_rows(comparison: PatientComparison, reference: Reference) -> list[tuple[str, str, str, str]]:
    """Return the global numbers: name, value, percentile with interval, p."""
    named: list[tuple[str, str, Percentile]] = [
        ("Distance in the modes", f"{comparison.mahalanobis.value:.2f} SD", comparison.mahalanobis),
        ("Distance outside the modes", f"{comparison.outside.value:.2f} mm", comparison.outside),
        ("Size, relative to expected", f"{100.0 * comparison.size.value:.0f} %", comparison.size),
        ("Largest |z| on the surface", f"{comparison.local.value:.1f}", comparison.local),
    ]
    return [(name, value, _percent_text(item), f"{item.p:.2g}") for name, value, item in named]


def region_rows(comparison: PatientComparison, reference: Reference) -> list[tuple[str, ...]]:
    """Return a row for each region: number, area, mean, peak, wall, z, place, particles."""
    return [
        (
            str(number),
            f"{region.area:.0f}",
            f"{region.mean:+.1f}",
            f"{region.peak:+.1f}",
            f"{100.0 * region.thicker:+.0f}",
            f"{region.z:+.1f}",
            _place(comparison, region),
            " ".join(map(str, comparison.nearest_particles(region, reference).tolist())),
        )
        for number, region in enumerate(comparison.regions, start=1)
    ]


def _place(comparison: PatientComparison, region: Region) -> str:
    x, y, z = comparison.position(region)
    side = comparison.place(region)
    return f"{side + ', ' if side else ''}LPS {x:.0f} {y:.0f} {z:.0f}"


def visible_rows(reference: Reference) -> list[tuple[str, ...]]:
    """Return the share of the surface on which differences are found: size, and share at three widths [%].

    The first row is the head.
    """
    edges = [*BEST_WIDTHS, 2.0 * BEST_WIDTHS[-1]]
    widths = [float(f"{width * reference.surface.mean_edge:.2g}") for width in edges]
    usual = reference.quality.limit_mm
    heights = [float(f"{factor * usual:.2g}") for factor in (0.5, 1.0, 2.0)]
    sizes = [
        *((f"{height:g} mm", height, 0) for height in heights),
        *((f"wall thinner by {100.0 * share:.0f} %", np.log1p(-share), 1) for share in (0.2, 0.4, 0.6)),
    ]
    return [
        ("difference", *(f"{width:g} mm wide" for width in widths)),
        *(
            (name, *(f"{100.0 * reference.visible(size, width, kind).mean():.0f}" for width in widths))
            for name, size, kind in sizes
        ),
    ]


def _wall(region: Region) -> str:
    return "thicker" if region.thicker > 0.0 else "thinner"


def _side(region: Region) -> str:
    return "outward" if region.peak > 0.0 else "inward"


GroupRow = tuple[str, int, float | None, float | None, float | None, int | None, int | None, str]
"""A line of ``groups.csv``."""

GROUP_COLUMNS = (
    "group",
    "controls",
    "p_modes",
    "p_outside",
    "p",
    "controls_within_modes",
    "controls_within_outside",
    "problem",
)

GROUP_CAUTION = (
    "Not a diagnosis: a shape can be typical of several groups or of none, and groups that were scanned or "
    "segmented differently differ for that reason. p is the probability that a member of the group is at "
    "least as far from its mean; at most 5 % of members have 0.05 or less."
)
_LEVEL = 0.05


def group_rows(
    comparison: PatientComparison,
    reference: Reference,
    others: Sequence[Reference],
    compare: Callable[..., PatientComparison],
) -> list[GroupRow]:
    """Return the typicality of a patient for the groups of several references; none for a single reference.

    Parameters
    ----------
    comparison : PatientComparison
        Comparison with `reference`.
    reference : Reference
    others : sequence of Reference
    compare : callable
        Compares the patient with the reference in its argument ``reference``.
    """
    if not others:
        return []
    rows = [_row(typicality(comparison, reference))]
    for other in others:
        about = other.provenance
        try:
            rows.append(_row(typicality(compare(reference=other), other)))
        except (InputError, NumericalError) as error:
            name = about.group or about.project
            rows.append((name, about.controls, None, None, None, None, None, str(error)))
    return rows


def group_sentence(row: GroupRow) -> str:
    """State the typicality of a patient for a group, and the calibration."""
    group, controls, modes, outside, p, held_modes, held_outside, problem = row
    if p is None:
        return f"{group}: can't be compared: {problem}"
    verdict = "within" if p > _LEVEL else "beyond"
    return (
        f"{group}: p = {p:.2g} (modes {modes:.2g}, outside of them {outside:.2g}), {verdict} the range of 95 "
        f"% of the group. When each is held out, {held_modes} and {held_outside} of {controls} controls are "
        "within."
    )


def _row(item: Typicality) -> GroupRow:
    return (
        item.group,
        item.controls,
        item.modes,
        item.outside,
        item.p,
        item.held_modes,
        item.held_outside,
        "",
    )


def beyond_limit(change: Change, follow_up: FollowUp) -> BoolArray | None:
    """Return the vertices (V,) beyond the controls' limit or, without one, beyond the measurement error.

    None if neither is known.
    """
    if change.expected is not None and follow_up.expected is not None:
        return np.abs(change.expected.z) > follow_up.expected.limit
    if change.z is not None and follow_up.limit is not None:
        return np.abs(change.z) > follow_up.limit
    return None


def limit_text(follow_up: FollowUp) -> str:
    """Name the limit in the maps."""
    return f"the limit of {'controls' if follow_up.expected is not None else 'measuring'}"


def change_sentence(change: Change, follow_up: FollowUp) -> str:
    """Describe the change from the first time to a later one."""
    since = f"{change.name} since {follow_up.comparisons[0].name}: "
    since += "" if np.isnan(change.volume) else f"volume {100.0 * (change.volume - 1.0):+.1f} %; "
    if change.z is None:
        return (
            f"{since}surface {change.distance.min():+.1f} to "
            f"{change.distance.max():+.1f} mm, without a limit."
        )
    if not change.regions:
        return f"{since}no part of the surface changed by more than the limit."
    most = change.regions[0]
    count = len(change.regions)
    return (
        f"{since}{count} region{'s' * (count != 1)} beyond the limit, the most extreme by "
        f"{most.peak:+.1f} mm (|z| {abs(most.z):.1f}, limit {follow_up.limit:.1f})."
    )


def _expected_sentence(change: Change, follow_up: FollowUp) -> str:
    """Compare a change with those of the controls; empty if these are not known."""
    against, expected = change.expected, follow_up.expected
    if against is None or expected is None:
        return ""
    rms, volume = against.beyond, against.volume
    local = "no part of the surface is beyond their limit"
    if against.regions:
        most, count = against.regions[0], len(against.regions)
        local = (
            f"{count} region{'s' * (count != 1)} beyond their limit, the most extreme by "
            f"{most.peak:+.1f} mm (|z| {abs(most.z):.1f}, limit {expected.limit:.1f})"
        )
    return (
        f"Against {expected.pairs} controls scanned twice ({expected.between}): {rms.value:.2f} mm (rms) "
        f"from their mean change, percentile {_percent_text(rms)}; "
        + ("" if np.isnan(volume.value) else f"volume percentile {_percent_text(volume)}; ")
        + f"{local}."
    )


def _percent_text(rank: Percentile) -> str:
    return f"{rank.percent:.0f} ({rank.low:.0f} to {rank.high:.0f})"


def _error_text(follow_up: FollowUp) -> str:
    """Describe the measurement error and the scope of its limit."""
    if follow_up.error is None:
        return (
            "No measurement error is known: no repeated segmentations were given. A difference may be "
            "due to scanning or segmenting twice."
        )
    repeats = f"{follow_up.repeats} repeated segmentation{'s' * (follow_up.repeats != 1)}"
    size = f"{float(follow_up.error.mean()):.2f} mm on average"
    if follow_up.everywhere:
        return (
            f"Measurement error from {repeats}: standard deviation {size}. The limit (|z| = "
            f"{follow_up.limit:.1f}) is exceeded anywhere on the surface in 5 % of repeated measurements."
        )
    return (
        f"Measurement error from {repeats}: standard deviation {size}. The limit (|z| = "
        f"{follow_up.limit:.2f}) applies to each position separately: some positions exceed it by chance. "
        "Three or more repeats give a limit for the whole surface."
    )


def change_sentences(follow_up: FollowUp) -> list[str]:
    """Return the findings, followed by the measurement error."""
    sentences = []
    for change in follow_up.changes:
        sentences += [change_sentence(change, follow_up), _expected_sentence(change, follow_up)]
    return [*filter(None, sentences), _error_text(follow_up)]
