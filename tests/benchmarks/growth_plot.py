"""The plot of `optimizer.py speed --plot`."""

import numpy as np


def draw_growth(rows, device, path):
    """Draw time and memory against the number of particles in all."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    kinds = (
        ("10 shapes, more particles", "o", lambda r: r["shapes"] == 10),
        ("1024 particles, more shapes", "s", lambda r: r["particles"] == 1024),
    )
    key = "processor" if device == "cpu" else "wall"
    for label, marker, chosen in kinds:
        some = [row for row in rows if chosen(row)]
        totals = [row["shapes"] * row["particles"] for row in some]
        left.loglog(totals, [row[key] for row in some], marker + "-", label=label)
        right.semilogx(totals, [row["peak"] for row in some], marker + "-", label=label)
    ends = np.array(
        [min(r["shapes"] * r["particles"] for r in rows), max(r["shapes"] * r["particles"] for r in rows)]
    )
    middle = next(row for row in rows if (row["shapes"], row["particles"]) == (10, 1024))
    left.loglog(ends, middle[key] * ends / 10240.0, "k:", lw=1, label="linear")
    left.set(
        xlabel="particles on all shapes", ylabel=f"{'processor ' if device == 'cpu' else ''}ms an iteration"
    )
    right.set(xlabel="particles on all shapes", ylabel="peak memory of the process (GB)")
    right.set_ylim(bottom=0.0)
    left.legend(frameon=False)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=130)
