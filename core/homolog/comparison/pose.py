"""Questions about how a structure lies to another one, apart from the shapes of both.

A pose is asked about as a shape of two points, its turn and its shift, in millimetres by which they displace
the structure's particles (root mean square): whatever tests shapes tests both together and each.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from homolog.arrays import frozen
from homolog.comparison.answer import Answer
from homolog.comparison.findings import cautions
from homolog.comparison.sample import Sample
from homolog.comparison.stored import Provenance, folder_of, write_question
from homolog.errors import InputError
from homolog.geometry import fit_similarity, rotation_of, transform_points
from homolog.io.project import ProjectFolder
from homolog.io.results import Part, Result
from homolog.io.tables import write_table
from homolog.statistics.cautions import p_text
from homolog.statistics.relative_pose import RelativePoses, relative_poses
from homolog.surfaces.mesh import joined

__all__ = ["COLUMNS", "NUMBERS", "PoseSample", "apart"]

NUMBERS = 6
"""Of a pose; all are tested, as there are none to be told from noise."""
COLUMNS = ("comparison", "p_pose", "p_turn", "turn_degrees", "p_shift", "shift_mm")
"""Columns of the table; p of turn and shift are corrected for both."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseSample:
    """The poses of a structure in a cohort.

    Attributes
    ----------
    sample : Sample
        The subjects, with turn and shift as their points.
    structure : str
    poses : RelativePoses
        Of all structures, from the one against which poses are measured.
    """

    sample: Sample
    structure: str
    poses: RelativePoses

    @classmethod
    def of(cls, result: Result, structure: str, reference: str | None = None) -> "PoseSample":
        """Return the poses of a result's structure against a reference, by default the first.

        Raises
        ------
        InputError
            If the result has no such structures, or the structure is the reference.
        """
        names = [part.name for part in result.parts]
        reference = reference or (names[0] if names else "")
        others = [name for name in names if name != reference]
        if structure not in others:
            listed = f"of {', '.join(others)} against {reference}" if names else "of several structures only"
            raise InputError(f"{structure}: has no pose to be tested; there are those {listed}")
        own = [result.world[:, part.particles] for part in result.parts]
        poses = relative_poses(own, names, names.index(reference))
        points = poses.displacements(structure)
        sample = replace(Sample.of(result), shapes=points, own_size=points, mean_surface=None)
        return cls(sample, structure, poses)

    def text(self, answer: Answer) -> str:
        """Return an answer as it is printed."""
        reference = self.poses.names[self.poses.reference]
        lines = [f"Pose of {self.structure} against {reference}: {answer.question.topic}"]
        lines += [f"  {line}" for line in answer.table_lines]
        lines += [f"  {line}" for line in self.sentences(answer)]
        return "\n".join([*lines, *(f"  Caution: {caution}" for caution in cautions(answer))])

    def sentences(self, answer: Answer) -> list[str]:
        """Return what an answer says of each comparison."""
        return [
            f"{title}: pose {p_text(whole)}; "
            f"turn {'' if angle is None else f'{angle:.2g}°, '}{p_text(turn)}; "
            f"shift {'' if length is None else f'{length:.2g} mm, '}{p_text(shift)}."
            for title, whole, turn, angle, shift, length in self.rows(answer)
        ]

    def rows(self, answer: Answer) -> list[tuple[str, float, float, float | None, float, float | None]]:
        """Return a row a comparison, as of `COLUMNS`; effects of several dimensions have no size."""
        rows = []
        for comparison in answer.comparisons:
            (turn, shift), effects = comparison.p_fwe.tolist(), comparison.pointwise.effect
            sizes: tuple[float | None, float | None] = (None, None)
            if len(effects) == 1:
                angle = np.linalg.solve(self.poses.leverage(self.structure), effects[0, 0])
                sizes = float(np.degrees(np.linalg.norm(angle))), float(np.linalg.norm(effects[0, 1]))
            rows.append((comparison.title, float(comparison.p_adjusted), turn, sizes[0], shift, sizes[1]))
        return rows

    def store(self, project: ProjectFolder, answer: Answer) -> Path:
        """Write an answer's table and its question into the project; return their folder.

        Raises
        ------
        InputError
            If the project can't be written to.
        """
        folder = folder_of(project, answer.question)
        write_table(folder / "pose.csv", COLUMNS, self.rows(answer))
        for name, columns, cells in answer.tables:
            if name == "anova.csv":  # others have sizes, which poses don't have
                write_table(folder / name, list(columns), cells)
        write_question(answer.question, folder, Provenance.now(project))
        return folder


def apart(result: Result, alone: Mapping[str, Result], reference: str, *, poses: bool) -> Result:
    """Return the shapes in their mean relative pose, or the mean shapes in each subject's, to first order.

    Parameters
    ----------
    result : Result
        Of several structures.
    alone : mapping of str to Result
        Those of each structure.
    reference : str
        The structure against which poses are measured.
    poses : bool
        Whether poses are kept and shapes left out, rather than the other way round.

    To first order, poses are linear in rotation vectors and translations, and the variance of particles is
    that of `RelativePoses.components`.
    """
    names = [part.name for part in result.parts]
    whole = [result.world[:, part.particles] for part in result.parts]
    first = names.index(reference)
    lie = relative_poses(whole, names, first)
    means = [form.mean(axis=0) for form in lie.forms]
    places = [
        fit_similarity(mean, block.mean(axis=0), scaling=False)
        for mean, block in zip(means, whole, strict=True)
    ]
    axes = rotation_of(places[first])
    world = []
    for index, (form, place) in enumerate(zip(lie.forms, places, strict=True)):
        if not poses:
            world.append(transform_points(place, form))
        else:
            points = transform_points(place, means[index])
            turns = np.radians(lie.rotations[:, index]) @ axes.T
            moves = (lie.translations[:, index] @ axes.T)[:, None]
            world.append(points + np.cross(turns[:, None], points - points.mean(axis=0)) + moves)
    placed, surfaces = np.concatenate(world, axis=1), []
    for part, name in zip(result.parts, names, strict=True):
        own = alone[name]
        rows = [own.names.index(subject) for subject in result.names]
        fit = fit_similarity(
            own.world[rows].mean(axis=0), placed[:, part.particles].mean(axis=0), scaling=True
        )
        surfaces.append(own.mean_surface.placed(fit))
    mean = joined(surfaces)
    parts = [
        Part(part.name, part.particles, slice(*ends))
        for part, ends in zip(result.parts, pairwise((0, *mean.ends)), strict=True)
    ]
    return replace(
        result,
        world=frozen(placed),
        mean_surface=mean,
        smoothing=np.concatenate([alone[name].smoothing for name in names]),
        parts=tuple(parts),
    )
