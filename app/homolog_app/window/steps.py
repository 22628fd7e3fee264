"""How far each of the four steps is."""

from homolog_app.window.rail import Step
from homolog_app.window.session import Session
from homolog_app.window.work import Work

__all__ = ["steps_of"]


def steps_of(session: Session, work: Work) -> dict[str, Step]:
    """Return the state of the steps, with a few words each; exactly one open one is next."""
    included = len(session.study.included)
    groomed = len(session.groomed_names)
    result = session.result
    done = {
        "cohort": included >= 2,
        "groom": session.is_groomed or result is not None,
        "correspond": result is not None,
        "explore": False,
    }
    enabled = {
        "cohort": session.is_open,
        "groom": included > 0,
        "correspond": included >= 2,
        "explore": result is not None or work.preliminary is not None,
    }
    texts = {
        "cohort": f"{included} subjects" if session.is_open else "",
        "groom": f"{groomed} of {included}" if groomed else "",
        "correspond": f"{result.result.world.shape[1]} particles" if result else "",
        "explore": "preliminary" if work.preliminary is not None else "",
    }
    if work.status is not None and work.kind in ("groom", "run"):
        texts["groom" if work.kind == "groom" else "correspond"] = f"{100 * work.status.fraction:.0f} %"
    following = next((name for name, is_done in done.items() if not is_done), "") if session.is_open else ""
    return {
        name: Step(enabled[name], done[name], name == following and enabled[name], texts[name])
        for name in done
    }
