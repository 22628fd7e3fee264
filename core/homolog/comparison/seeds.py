"""Repetition of a question with correspondences from other seeds, and the variation of the answers."""

import csv
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from homolog.cohort import Cohort
from homolog.comparison.answer import Answer
from homolog.comparison.ask import ask
from homolog.comparison.findings import share_of_surface
from homolog.comparison.question import Question
from homolog.comparison.sample import Sample
from homolog.errors import Cancelled, InputError
from homolog.io.project import ProjectFolder
from homolog.io.records import ResultRecord
from homolog.io.results import Result, read_result
from homolog.io.tables import write_table
from homolog.progress import Tick, no_tick, part_of
from homolog.run import FinishReason, Run
from homolog.settings import RunSettings
from homolog.statistics.cautions import LEVEL, p_text
from homolog.statistics.effects import CONFIDENCE, STEIGER, Effect

__all__ = [
    "COLUMNS",
    "FILE",
    "SeedAnswer",
    "answer_by_seed",
    "level_of",
    "read_spread",
    "results_of_seeds",
    "spread_text",
    "stored_seeds",
    "write_spread",
]

FILE = "seeds.csv"
_FOLDER = "seeds"
_P = "p_permutation_corrected"
_NOT_NEGATIVE = ("mahalanobis_d_corrected", "omega_squared", "size_omega_squared")
_EFFECTS = {
    "mahalanobis_d_corrected": "",
    "balanced_accuracy": f"balanced_accuracy_{_P}",
    "auc": f"auc_{_P}",
    "size_effect_mm": f"size_{_P}",
}
"""Columns of estimates, and of their p-values, if any; intervals are in adjacent columns."""


def level_of(name: str) -> int:
    """Return the level of the interval of an effect's column [%]."""
    return round(100.0 * (STEIGER if name in _NOT_NEGATIVE else CONFIDENCE))


def _ends(name: str) -> tuple[str, str, str]:
    return "", f"_low_{level_of(name)}", f"_high_{level_of(name)}"


COLUMNS = [
    "comparison",
    "seed_of_correspondence",
    _P,
    "particles_p_fwe_corrected_05",
    "area_p_fwe_corrected_05_percent",
    *(f"{name}{end}" for name in _EFFECTS for end in _ends(name)),
    *filter(None, _EFFECTS.values()),
    "permutations",
    "result_fingerprint",
]


@dataclass(frozen=True, slots=True)
class SeedAnswer:
    """One comparison's answer from the correspondence of one seed; missing values are None.

    Effects have the corrected p. Earlier versions stored neither it nor intervals, which are then NaN.
    """

    comparison: str
    seed: int
    p: float
    distance: Effect | None
    particles: int
    percent: float
    accuracy: Effect | None
    auc: Effect | None
    size: Effect | None
    permutations: int
    fingerprint: str

    @property
    def effects(self) -> tuple[Effect | None, ...]:
        """Distance, accuracy, AUC and size."""
        return self.distance, self.accuracy, self.auc, self.size


def answer_by_seed(
    project: ProjectFolder,
    result: Result,
    questions: Sequence[Question],
    count: int,
    tick: Tick = no_tick,
) -> list[list[SeedAnswer]]:
    """Repeat the run of a result with other seeds and answer questions about each.

    The runs are stored in ``seeds/`` of the project and reused as long as the result's settings and
    surfaces are the same.

    Parameters
    ----------
    project : ProjectFolder
        Project of the result.
    result : Result
        The result as read, with the table's current columns.
    questions : sequence of Question
        The questions.
    count : int
        Total number of seeds, including the result's own.
    tick : Tick
        Progress and cancellation.

    Returns
    -------
    list of list of SeedAnswer
        Answers to each question: comparisons of the first seed, followed by those of the others.

    Raises
    ------
    InputError
        If the result can't be repeated, because it is from another program or files are missing.
    """
    record = project.read().result
    if record is None or record.source:
        raise InputError(
            f"{project.folder}: its particles were not placed by Homolog, so the run can't be repeated with "
            "other seeds"
        )
    first = record.settings.optimize.seed
    answers: list[list[SeedAnswer]] = [[] for _ in questions]
    for number in range(count):
        part = part_of(tick, number / count, (number + 1) / count)
        again, seed = result, first + number
        if number:
            repeated = _repeated(project, record, seed, part_of(part, 0.0, 0.8))
            again = _with_table(read_result(repeated), result)
        sample = Sample.of(again)
        for index, question in enumerate(questions):
            low, high = 0.8 + 0.2 * index / len(questions), 0.8 + 0.2 * (index + 1) / len(questions)
            single = ask(sample, question, part_of(part, low, high))
            answers[index] += _answers(single, seed, record.fingerprint)
    return answers


def write_spread(folder: Path, answers: Sequence[SeedAnswer]) -> None:
    """Write the answers of all seeds to the folder of an answer's tables."""
    write_table(
        folder / FILE,
        COLUMNS,
        (
            [
                answer.comparison,
                answer.seed,
                answer.p,
                answer.particles,
                answer.percent,
                *(
                    cell
                    for effect in answer.effects
                    for cell in ((effect.value, effect.low, effect.high) if effect else (None,) * 3)
                ),
                *(effect.p if effect else None for effect in answer.effects[1:]),
                answer.permutations,
                answer.fingerprint,
            ]
            for answer in answers
        ),
    )


def read_spread(folder: Path, fingerprint: str, answer: Answer) -> list[SeedAnswer]:
    """Return the stored answers of all seeds; none if they belong to other particles, data or settings."""
    path = folder / FILE
    if not path.is_file():
        return []
    try:
        with path.open(newline="", encoding="utf-8") as stream:
            # Version 0.2 wrote p_family for p_fwe.
            rows = [
                {str(column).replace("p_family", "p_fwe"): value for column, value in row.items()}
                for row in csv.DictReader(stream)
            ]
        repeats = [
            SeedAnswer(
                row["comparison"],
                int(row["seed_of_correspondence"]),
                float(row[_P]),
                distance,
                int(row["particles_p_fwe_corrected_05"]),
                float(row["area_p_fwe_corrected_05_percent"]),
                accuracy,
                auc,
                size,
                int(row["permutations"]),
                row["result_fingerprint"],
            )
            for row in rows
            for distance, accuracy, auc, size in [[_effect_of(row, name) for name in _EFFECTS]]
        ]
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise InputError(f"{path}: can't be read: {error}; delete it and analyze again with seeds") from error
    first = {(item.comparison, item.p) for item in repeats if item.seed == repeats[0].seed}
    own = {(item.title, item.p_adjusted) for item in answer.comparisons}
    is_current = first <= own and all(item.fingerprint == fingerprint for item in repeats)
    return repeats if is_current else []


def spread_text(answers: Sequence[SeedAnswer]) -> list[str]:
    """Return a sentence for each comparison: the range of its answers."""
    sentences = []
    for title in dict.fromkeys(answer.comparison for answer in answers):
        own = [answer for answer in answers if answer.comparison == title]
        low, high = min(item.p for item in own), max(item.p for item in own)
        significant = sum(item.p <= LEVEL for item in own)
        lowest, highest = (p_text(limit, own[0].permutations) for limit in (low, high))
        text = (
            f"{title}: over {len(own)} seeds of the correspondence {_range_of_p(lowest, highest)} "
            f"({significant} of {len(own)} significant)"
        )
        distances = [item.distance.value for item in own if item.distance is not None]
        if distances:
            text += f", D {_range(f'{min(distances):.2f}', f'{max(distances):.2f}')} SD"
        percents = [item.percent for item in own]
        text += f", {_range(f'{min(percents):.1f}', f'{max(percents):.1f}')} % of the surface"
        accuracies = [item.accuracy.value for item in own if item.accuracy is not None]
        if accuracies:
            percents_right = [f"{100 * limit:.0f}" for limit in (min(accuracies), max(accuracies))]
            text += f", balanced accuracy {_range(*percents_right)} %"
        sentences.append(f"{text}.")
    return sentences


def _range_of_p(low: str, high: str) -> str:
    """Return a range such as "p = 0.002 to 0.004", "p < 0.001" or "p ≤ 0.004"."""
    if low != high and low.startswith("p <"):
        return high.replace("=", "≤")
    return _range(low, high).replace(" to p = ", " to ")


def _range(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"


def _repeated(project: ProjectFolder, record: ResultRecord, seed: int, tick: Tick) -> ProjectFolder:
    """Return the project of another seed's run; compute it if missing."""
    again, settings = _place(project, seed), _settings(record, seed)
    if _is_stored(project, record, seed):
        return again
    if not again.groomed.is_dir() and project.groomed.is_dir():
        shutil.copytree(project.groomed, again.groomed)  # avoids grooming again
        again.write(project.read().model_copy(update={"result": None, "subjects": [], "unfinished": False}))
    cohort = project.cohort()
    names = {subject.name for subject in record.subjects}
    kept = tuple(subject for subject in cohort.subjects if subject.name in names)
    if len(kept) < len(names):
        lost = sorted(names - {item.name for item in kept})
        raise InputError(f"{lost[0]}: is no longer among the project's subjects; run the project again first")
    job = Run(again, Cohort(kept, cohort.folder), settings)

    def observe(fraction: float, message: str) -> None:
        try:
            tick(fraction, f"seed {seed}: {message}")
        except Cancelled:
            job.cancel()

    reason = job.execute(lambda status: observe(status.fraction, status.message))
    if reason is not FinishReason.COMPLETED:
        raise Cancelled
    return again


def _place(project: ProjectFolder, seed: int) -> ProjectFolder:
    return ProjectFolder(project.folder / _FOLDER / f"seed_{seed}")


def _settings(record: ResultRecord, seed: int) -> RunSettings:
    optimize = record.settings.optimize.model_copy(update={"seed": seed})
    return record.settings.model_copy(update={"optimize": optimize})


def _is_stored(project: ProjectFolder, record: ResultRecord, seed: int) -> bool:
    """Return whether a seed's run with the settings and surfaces of a result exists."""
    again = _place(project, seed)
    stored = again.read().result if again.exists else None
    if stored is None or stored.settings != _settings(record, seed):
        return False
    contents = {subject.name: subject.content for subject in stored.subjects}
    return contents == {subject.name: subject.content for subject in record.subjects}


def stored_seeds(project: ProjectFolder) -> int:
    """Return the number of seeds with a stored correspondence, including the result's own."""
    record = project.read().result
    if record is None or record.source:
        return 1
    count = 1
    while _is_stored(project, record, record.settings.optimize.seed + count):
        count += 1
    return count


def results_of_seeds(project: ProjectFolder) -> list[Result]:
    """Return the stored results of other seeds than the result's own."""
    record = project.read().result
    first = 0 if record is None else record.settings.optimize.seed
    return [read_result(_place(project, first + number)) for number in range(1, stored_seeds(project))]


def _with_table(again: Result, result: Result) -> Result:
    """Return a repeated result with the groups and columns of the first one."""
    order = [result.names.index(name) for name in again.names]
    return replace(
        again,
        groups=tuple(result.groups[index] for index in order),
        columns=tuple(result.columns[index] for index in order),
    )


def _answers(answer: Answer, seed: int, fingerprint: str) -> list[SeedAnswer]:
    rows = []
    for comparison in answer.comparisons:
        significant = comparison.p_fwe <= LEVEL
        line, size = comparison.discriminant, comparison.size
        rows.append(
            SeedAnswer(
                comparison=comparison.title,
                seed=seed,
                p=comparison.p_adjusted,
                distance=comparison.distance,
                particles=int(np.count_nonzero(significant)),
                percent=share_of_surface(answer, comparison),
                accuracy=None if line is None else _plain(line.accuracy, comparison.accuracy_p_adjusted),
                auc=None if line is None else _plain(line.auc, comparison.auc_p_adjusted),
                size=_plain(size, comparison.size_p_adjusted)
                if size is not None and np.isfinite(size.value)
                else None,
                permutations=comparison.test.permutations,
                fingerprint=fingerprint,
            )
        )
    return rows


def _plain(effect: Effect, p: float | None) -> Effect:
    """Return the estimate and its interval with the corrected p."""
    return replace(effect, p=p, permutations=0)


def _effect_of(row: Mapping[str, str], name: str) -> Effect | None:
    """Return the effect in the columns of a name, None if it has no value."""
    if not row[name]:
        return None
    level = level_of(name) if f"{name}_low_{level_of(name)}" in row else 95  # all of earlier versions
    low, high = (float(row.get(f"{name}_{end}_{level}") or "nan") for end in ("low", "high"))
    p = row.get(_EFFECTS[name])
    return Effect(float(row[name]), low, high, float(p) if p else None, level=level / 100.0)
