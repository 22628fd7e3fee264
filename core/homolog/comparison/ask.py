"""Asking a question of any kind."""

from homolog.comparison.answer import Answer, ask_groups
from homolog.comparison.formula import ask_formula
from homolog.comparison.question import Question
from homolog.comparison.sample import Sample
from homolog.progress import Tick, no_tick

__all__ = ["ask"]


def ask(sample: Sample, question: Question, tick: Tick = no_tick) -> Answer:
    """Answer a question.

    Parameters
    ----------
    sample : Sample
        The shapes and what is known of them.
    question : Question
        The question; a formula has a `FormulaAnswer`.
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If a column or group does not exist, values are missing, there are too few subjects, or a design
        can't be estimated.
    """
    return (ask_formula if question.kind == "formula" else ask_groups)(sample, question, tick)
