"""A bean cohort as files: one volume for each shape and a table of the truth."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.beans.generate import Bean, voxelize
from homolog.cohort import Cohort, Subject
from homolog.io.tables import write_table
from homolog.io.written_images import write_image
from homolog.progress import Tick, no_tick

__all__ = ["write_beans"]


def write_beans(folder: Path, beans: Sequence[Bean], seed: int, tick: Tick = no_tick) -> Cohort:
    """Write ``bean_01.nrrd`` … and ``truth.csv``.

    Parameters
    ----------
    folder : Path
        Output folder, created if necessary. Files of the same names are replaced.
    beans : sequence of Bean
        The shapes.
    seed : int
        Their random seed, which is stored in the table.
    tick : Tick
        Called after each volume.

    Returns
    -------
    Cohort
        Cohort of the volumes.

    Raises
    ------
    InputError
        If a file can't be written.
    """
    digits = max(2, len(str(len(beans))))
    names = [f"bean_{number:0{digits}d}" for number in range(1, len(beans) + 1)]
    subjects = []
    for index, (name, bean) in enumerate(zip(names, beans, strict=True)):
        tick(index / len(beans), f"writing {name}")
        path = folder / f"{name}.nrrd"
        inside, index_to_world = voxelize(bean)
        write_image(path, inside.astype(np.uint8), index_to_world)
        subjects.append(Subject(name, path.resolve()))
    write_table(
        folder / "truth.csv",
        ["name", "position_mm", "width_mm", "geometry", "seed"],
        (
            [name, bean.position, bean.width, bean.geometry.name, seed]
            for name, bean in zip(names, beans, strict=True)
        ),
    )
    return Cohort(tuple(subjects), folder)
