"""The comparison of the demo's two methods: the paper's figures beside ours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from homolog.analysis.evaluation import generalization, specificity
from homolog.analysis.shape_model import ShapeModel
from homolog.beans.evaluate import BeanMetrics, evaluate
from homolog.beans.generate import Bean
from homolog.files.project import ProjectFolder
from homolog.files.results import read_result
from homolog.files.tables import write_table
from homolog.progress import Tick, part_of

__all__ = ["ComparisonRow", "table_text", "write_comparison"]

_PAPER_LEAK = {"original": 0.16, "proposed": 0.04}
_DRAWS = 200


@dataclass(frozen=True, slots=True)
class ComparisonRow:
    """One figure of every method.

    Attributes
    ----------
    figure : str
        What it is, in words.
    key : str
        Its name in the CSV file.
    style : str
        Format of its values, such as ``".2%"``.
    values : mapping of str to float
        By method.
    paper : mapping of str to float
        What the paper reports, by method; mostly nothing.
    """

    figure: str
    key: str
    style: str
    values: Mapping[str, float]
    paper: Mapping[str, float]


_FIGURES = (
    ("variance outside the first two modes (leakage)", "leak", ".2%"),
    ("variance that slot position and width explain", "ground_truth_r2", ".2%"),
    ("R² of slot position on the first two scores", "r2_position", ".3f"),
    ("R² of slot width on the first two scores", "r2_width", ".3f"),
    ("particles in the slot, of its share of the area", "slot_fill", ".0%"),
    ("normals over 90° apart, of pairs", "normals_over_90_pairs", ".2%"),
    ("opposite slot walls, of pairs in the slot", "wall_swap", ".2%"),
    ("variance per particle [mm²]", "var_per_particle", ".2f"),
    ("distance to the true surface, mean [mm]", "distance_mean", ".3f"),
    ("distance to the true surface, 95 % [mm]", "distance_p95", ".3f"),
    ("variation of nearest-neighbour distances", "nn_cv", ".3f"),
    ("largest gap, in mean spacings", "cover_max", ".2f"),
    ("share of mode 1", "mode_1", ".2%"),
    ("share of mode 2", "mode_2", ".2%"),
    ("share of mode 3", "mode_3", ".2%"),
    ("generalization with two modes [mm]", "generalization", ".3f"),
    ("specificity with two modes [mm]", "specificity", ".3f"),
    ("iterations", "iterations", ".0f"),
    ("seconds", "seconds", ".0f"),
)


def write_comparison(
    out: Path, projects: Mapping[str, ProjectFolder], beans: Sequence[Bean], tick: Tick
) -> list[ComparisonRow]:
    """Judge the methods' results and write ``comparison.csv``.

    Parameters
    ----------
    out : Path
        Folder of the table.
    projects : mapping of str to ProjectFolder
        Finished runs by method.
    beans : sequence of Bean
        The cohort's truth.
    tick : Tick
    """
    by_method = {}
    for index, (name, project) in enumerate(projects.items()):
        part = part_of(tick, index / len(projects), (index + 1) / len(projects))
        by_method[name] = _figures_of(project, beans, part)
    rows = [
        ComparisonRow(
            figure, key, style,
            values={name: figures[key] for name, figures in by_method.items()},
            paper=_PAPER_LEAK if key == "leak" else {},
        )
        for figure, key, style in _FIGURES
    ]  # fmt: skip
    write_table(
        out / "comparison.csv",
        ["figure", *projects, *(f"paper_{name}" for name in projects)],
        ([row.key, *row.values.values(), *(row.paper.get(name) for name in projects)] for row in rows),
    )
    return rows


def _figures_of(project: ProjectFolder, beans: Sequence[Bean], tick: Tick) -> dict[str, float]:
    result, record = read_result(project), project.read().result
    assert record is not None
    tick(0.0, "judging the correspondences")
    figures: BeanMetrics = evaluate(result.local, beans)
    tick(0.4, "judging the shape model")
    shares = figures.mode_shares
    named = {name: getattr(figures, name) for name in figures.__dataclass_fields__ if name != "mode_shares"}
    model = ShapeModel.fit(result.world)
    return named | {
        "mode_1": shares[0],
        "mode_2": shares[1],
        "mode_3": shares[2],
        "generalization": float(generalization(result.world)[1]),
        "specificity": float(specificity(model, result.world, [2], draws=_DRAWS)[0]),
        "iterations": float(record.iterations),
        "seconds": sum(record.seconds.values()),
    }


def table_text(rows: Sequence[ComparisonRow]) -> str:
    """Return the table in columns for a terminal."""
    methods = list(rows[0].values)
    lines = [["", *methods, "in the paper"]]
    for row in rows:
        paper = " / ".join(format(row.paper[name], ".0%") for name in methods if name in row.paper)
        lines.append([row.figure, *(format(value, row.style) for value in row.values.values()), paper])
    lines = [[line[0], *(cell.replace("%", " %") for cell in line[1:])] for line in lines]
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return "\n".join(
        "  ".join(
            [line[0].ljust(widths[0]), *(cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True))]
        ).rstrip()
        for line in lines
    )
