"""Two groups compared for an export, as ``homolog analyze`` compares them."""

from homolog.analysis.procrustes import Alignment
from homolog.files.results import Result
from homolog.progress import Tick, no_tick
from homolog_app.report.request import StudyRequest
from homolog_app.report.study import Study, run_study

__all__ = ["compare"]


def compare(
    result: Result,
    groups: tuple[str, str, str],
    permutations: int,
    seed: int,
    tick: Tick = no_tick,
    *,
    alignment: Alignment = Alignment.RIGID,
) -> Study:
    """Compare two groups of a column: (column, first, second); raises as `run_study` does."""
    column, first, second = groups
    request = StudyRequest(
        column=column,
        between=(first, second),
        alignment=alignment,
        permutations=permutations,
        null_repeats=0,
        seed=seed,
    )
    return run_study(result, request, tick)
