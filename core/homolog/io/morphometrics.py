"""Points of all subjects in the file formats of geometric morphometrics: TPS, NTS and Morphologika.

They are read by geomorph and Morpho in R, MorphoJ, PAST and tpsDig.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from homolog.arrays import FloatArray
from homolog.io.atomic import write_text

__all__ = ["write_morphometrics"]


def write_morphometrics(
    folder: Path, names: Sequence[str], points: FloatArray, groups: Sequence[str | None]
) -> None:
    """Write ``particles.tps``, ``particles.nts`` and ``particles_morphologika.txt``.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    names : sequence of str
        Names of the M subjects. Blanks become underscores in the NTS file, which separates names by blanks.
    points : (M, N, 3) array
        Their corresponding points [mm].
    groups : sequence of str or None
        Their groups, written to the Morphologika file if all subjects have one.

    Raises
    ------
    InputError
        If a file can't be written.
    """
    rows = [
        [" ".join(map(repr, point)) for point in shape] for shape in np.asarray(points, np.float64).tolist()
    ]
    write_text(folder / "particles.tps", _tps(names, rows))
    write_text(folder / "particles.nts", _nts(names, rows))
    write_text(folder / "particles_morphologika.txt", _morphologika(names, rows, groups))


def _tps(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    parts = [[f"LM3={len(lines)}", *lines, f"ID={name}"] for name, lines in zip(names, rows, strict=True)]
    return "".join(f"{line}\n" for part in parts for line in part)


def _nts(names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = [
        '" Corresponding points [mm]; made by Homolog',
        f"1 {len(names)}L {3 * len(rows[0])} 0 DIM=3",
        " ".join(re.sub(r"\s+", "_", name) for name in names),
    ]
    return "".join(f"{line}\n" for line in (*head, *(" ".join(lines) for lines in rows)))


def _morphologika(names: Sequence[str], rows: Sequence[Sequence[str]], groups: Sequence[str | None]) -> str:
    head = ["[individuals]", str(len(names)), "[landmarks]", str(len(rows[0])), "[dimensions]", "3"]
    labels = [group for group in groups if group]
    if len(labels) == len(names):
        values = [re.sub(r"\s+", "_", label) for label in labels]
        head += ["[labels]", "group", "[labelvalues]", *values]
    points = [line for name, lines in zip(names, rows, strict=True) for line in (f"'{name}", *lines)]
    return "".join(f"{line}\n" for line in (*head, "[names]", *names, "[rawpoints]", *points))
