"""Restores the contents of views from the project, without a window."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from homolog.cohort import Subject
from homolog.errors import InputError
from homolog.io.project import ProjectFolder
from homolog.progress import Tick, part_of
from homolog_app.rendering.content import Content, SubjectContents, ViewContents
from homolog_app.scenes.check import ENERGIES, Marks, checked_scene
from homolog_app.scenes.file_survey import surveys
from homolog_app.scenes.loaded_result import LoadedResult, load_result
from homolog_app.scenes.shapes import group_scene, measured_scene, mode_scene
from homolog_app.scenes.states import CheckView, GroupsView, MeasureView, ModesView, Snapshot
from homolog_app.scenes.structures import aspect_of, part_of_aspect, project_of_aspect
from homolog_app.scenes.subjects import Groomed, moment_of, single_subject, subject_contents

if TYPE_CHECKING:
    from homolog.inspection import Inspection
    from homolog_app.scenes.model_shape import ModelShape

__all__ = ["view_contents_of"]


def view_contents_of(project: ProjectFolder, wanted: Snapshot, tick: Tick) -> ViewContents:
    """Return the contents of the views.

    Parameters
    ----------
    project : ProjectFolder
    wanted : Snapshot
    tick : Tick
        Progress and cancellation.

    Raises
    ------
    InputError
        If the project has no result to show, or no such subject, mode, group, particle or recorded frame.
    """
    tick(0.0, "reading the project")
    project.recover()
    wanted = wanted.model_copy(update={"title": wanted.title or project.folder.name})
    loaded = load_result(project) if project.read().result is not None else None
    whole, project = loaded, project_of_aspect(project, wanted.aspect)
    loaded = None if whole is None else part_of_aspect(whole, wanted.aspect)
    match wanted.view:
        case ModesView() as view:
            models = _models(_aspect(project, whole, wanted), wanted, part_of(tick, 0.1, 0.8))
            _check(view.subject in ("", *models[0].result.names), f"no subject {view.subject!r}")
            own = _contents(project, loaded, wanted, tick, view.subject) if view.subject else []
            return mode_scene(view, models, single_subject(own[0]) if own else None)
        case GroupsView() as view:
            return _groups(project, _needed(project, loaded), wanted, view, tick)
        case MeasureView() as view:
            models = _models(_needed(project, loaded), wanted, part_of(tick, 0.1, 0.8))
            inside = max(view.particles) < len(models[0].model.mean_) and view.mode < models[0].modes
            _check(inside, f"there is no mode {view.mode + 1}, or no such particle")
            named: dict[str, Content] = {}
            for name in {view.subject, view.beside or "", view.distance_from} & set(models[0].result.names):
                (content,) = _contents(project, loaded, wanted, tick, name)
                named[name] = single_subject(content)
            return measured_scene(view, models[0], named)
        case CheckView() as view:
            contents = _contents(project, loaded, wanted, tick)
            shown = _checked(project, _needed(project, loaded), view, contents, part_of(tick, 0.2, 0.9))
            return shown if shown.particles is not None else _with_particles(shown, loaded, None)
        case view:
            return _with_particles(
                ViewContents(_contents(project, loaded, wanted, tick)), loaded, view.moment
            )


def _check(fine: bool, fault: str) -> None:
    if not fine:
        raise InputError(f"--scene: {fault}")


def _needed(project: ProjectFolder, loaded: LoadedResult | None) -> LoadedResult:
    if loaded is None:
        raise InputError(f"{project.folder}: has no result yet; run it first")
    return loaded


def _contents(
    project: ProjectFolder, loaded: LoadedResult | None, wanted: Snapshot, tick: Tick, name: str = ""
) -> SubjectContents:
    """Return the contents of all subjects, or of one."""
    from homolog.run.project_grooming import groomed_before

    cohort, settings = project.cohort(), project.read().settings
    groomed = {}
    if loaded is None and (before := groomed_before(cohort, settings, project, part_of(tick, 0.1, 0.2))):
        pairs = zip(*before, strict=True)
        groomed = {subject.name: Groomed(subject, alignment, settings.groom) for subject, alignment in pairs}
    subjects: Sequence[Subject] = [subject for subject in cohort.subjects if name in ("", subject.name)]
    needs_file = [subject for subject in subjects if wanted.canvas.raw or not (loaded or groomed)]
    read = {item.subject.name: item for item in surveys(needs_file, settings.groom, part_of(tick, 0.1, 0.2))}
    return subject_contents(subjects, read, groomed, loaded, settings)


def _with_particles(shown: ViewContents, loaded: LoadedResult | None, moment: int | None) -> ViewContents:
    """Return the subjects with their particles, at the end of the run or in a recorded frame."""
    if loaded is None:
        return replace(shown, particles={})
    if moment is None:
        return replace(shown, particles=loaded.particles)
    _check(0 <= moment < len(loaded.frames), f"no recorded frame {moment} of {len(loaded.frames)}")
    particles, tints = moment_of(loaded, moment)
    return replace(shown, particles=particles, tints=tints)


def _aspect(project: ProjectFolder, whole: LoadedResult | None, wanted: Snapshot) -> LoadedResult:
    return aspect_of(_needed(project, whole), wanted.aspect)


def _models(loaded: LoadedResult, wanted: Snapshot, tick: Tick) -> "list[ModelShape]":
    from homolog_app.scenes.model_shape import facing, fit_model_shape, read_model_shape

    now = part_of(tick, 0.0, 0.5)
    models = [fit_model_shape(wanted.title, loaded.method, loaded.result, now, rigid=loaded.is_rigid)]
    if wanted.beside is not None:
        name = wanted.beside.resolve().name
        other = read_model_shape(name, ProjectFolder(wanted.beside), part_of(tick, 0.5, 1.0))
        models.append(facing(other, models[0]))
    return models


def _groups(
    project: ProjectFolder, loaded: LoadedResult, wanted: Snapshot, view: GroupsView, tick: Tick
) -> ViewContents:
    from homolog_app.scenes.group_answers import answer_groups

    models = _models(loaded, wanted, part_of(tick, 0.1, 0.5))
    if view.request is None:
        return group_scene(view, models, [])
    ticks = [part_of(tick, 0.5 + 0.4 * n / len(models), 0.9) for n in range(len(models))]
    answers = [
        answer_groups(model, model.result, view.request, t, view.pair)
        for model, t in zip(models, ticks, strict=True)
    ]
    return group_scene(view, models, answers)


def _checked(
    project: ProjectFolder, loaded: LoadedResult, view: CheckView, contents: SubjectContents, tick: Tick
) -> ViewContents:
    from homolog.inspection import inspect
    from homolog.threads import cores
    from homolog_app.scenes.check import distances_on, energies_of, textures_of

    own, names = loaded.result, loaded.result.names
    meshes = [loaded.surfaces[name][0] for name in names]
    inspection = inspect(
        own.local, meshes, own.alignments, names=names, workers=cores(), tick=part_of(tick, 0.0, 0.7)
    )
    subject = names.index(view.subject) if view.subject in names else 0
    distances = energies = texture = None
    if view.show == "distances" and (place := _place(view, inspection, subject)) is not None:
        distances = distances_on(inspection, subject, place, names[subject], part_of(tick, 0.7, 1.0))
    elif view.show in ENERGIES:
        energies = energies_of(inspection, project, part_of(tick, 0.7, 1.0))
    elif view.show in ("checkerboard", "stripes"):
        texture = textures_of(inspection, names, part_of(tick, 0.7, 1.0))[view.show]
    marks = Marks(
        "texture" if texture else view.show,
        view.particle,
        subject,
        np.array(view.others, np.int64),
        distances,
        energies,
        texture,
    )
    return checked_scene(contents, inspection, names, marks)


def _place(view: CheckView, inspection: "Inspection", subject: int) -> np.ndarray | None:
    if view.place is not None:
        return np.array(view.place)
    return None if view.particle is None else inspection.located.world[subject, view.particle]
