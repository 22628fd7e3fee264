"""Going on from a result: more particles, or new subjects fitted to it. Knows no Qt."""

from dataclasses import dataclass

from homolog.files.records import ResultRecord
from homolog_app.window.study import Study

__all__ = ["Extension", "extension_of", "outdated_text"]

_CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Extension:
    """What a run can add to a result.

    Attributes
    ----------
    particles : int
        How many more, if that is what the study asks for.
    subjects : tuple of str
        New ones that can be fitted to it.
    message : str
        What would happen, or what to do so that something can.
    """

    particles: int
    subjects: tuple[str, ...]
    message: str


def extension_of(study: Study, result: ResultRecord) -> Extension:
    """Return what a run of a study can add to a result."""
    known = [subject.name for subject in result.subjects]
    names = [subject.name for subject in study.included]
    fresh = tuple(name for name in names if name not in known)
    gone = [name for name in known if name not in names]
    more = study.settings.optimize.particles - result.particles
    own = result.settings
    same = study.settings.optimize.model_copy(update={"particles": own.optimize.particles}) == own.optimize
    if gone:
        return _not(
            f"{_listed(gone)} of the result {_are(gone)} excluded; include {_them(gone)} to continue from it."
        )
    if study.settings.groom != own.groom:
        return _not(
            "The grooming settings differ from those of the result; a run places all particles from the "
            "start."
        )
    if fresh and more:
        return _not(
            f"New subjects get the result's {result.particles} particles: set that number and fit them; add "
            "particles afterwards."
        )
    if fresh:
        new = f"{_listed(list(fresh))} {'gets' if len(fresh) == 1 else 'get'}"
        return Extension(0, fresh, f"{new} the result's particles; those of the {len(known)} others stay.")
    if more > 0 and same and result.ended != _CANCELLED:
        return Extension(
            more, (), f"The result's {result.particles} particles are split further, not placed again."
        )
    if more > 0:
        return _not(
            "The settings differ from those of the result, or the run was cancelled: all particles are "
            "placed from the start."
        )
    return _not(
        f"To extend the result, set more than {result.particles} particles, or add subjects in Cohort."
    )


def outdated_text(study: Study, result: ResultRecord) -> str:
    """Say in what cohort and settings have changed since a result was computed; nothing if they have not."""
    known = [subject.name for subject in result.subjects]
    names = [subject.name for subject in study.included]
    gone, fresh = [name for name in known if name not in names], [name for name in names if name not in known]
    parts = [f"{_listed(gone)} {_are(gone)} excluded in Cohort but still part of it"] if gone else []
    parts += [f"{_listed(fresh)} {_are(fresh)} not part of it"] if fresh else []
    changed = [
        name.replace("_", " ")
        for now, own in (
            (study.settings.groom, result.settings.groom),
            (study.settings.optimize, result.settings.optimize),
        )
        for name in type(now).model_fields
        if getattr(now, name) != getattr(own, name)
    ]
    parts += [f"settings have changed ({_listed(changed)})"] if changed else []
    return f"This result is out of date: {'; '.join(parts)}. Run again to update it." if parts else ""


def _not(text: str) -> Extension:
    return Extension(0, (), text)


def _listed(names: list[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{', '.join(names[:2])} and {len(names) - 2} others"


def _are(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _them(names: list[str]) -> str:
    return "it" if len(names) == 1 else "them"
