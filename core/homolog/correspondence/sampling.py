"""How evenly particles lie on each surface: neighbours, Parzen widths and forces of the sampling entropy."""

import math

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray
from homolog.correspondence import kernels, sampling_kernels
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.surfaces import Level

__all__ = ["LIST_LIFE", "REACH", "Sampling"]

ROW = 64  # neighbours that a row holds; an even layout needs 20
SKIN = 1.08  # neighbour lists reach this much farther than forces, and last this many iterations:
LIST_LIFE = 5
CELLS = 64  # of the hash grid in each direction; twice as many for more particles than cells
REACH = sampling_kernels.CUTOFF * sampling_kernels.WIDEST * SKIN
"""Longest distance that a neighbour list needs, in even Parzen widths."""


class Sampling:
    """The sampling part of an iteration for all particles of all shapes.

    Attributes
    ----------
    widths, next_widths : wp.array of float
        Parzen widths now and after the next round of their fixed point.
    forces : wp.array of vec3
        Descent of the sampling entropy, in the tangent planes.
    energies : wp.array of float
        log A_i - 3 log s_i.
    counts : wp.array of int
        Neighbours in reach.
    """

    widths: DeviceArray
    energies: DeviceArray
    counts: DeviceArray

    def __init__(self, level: Level, layout: kernels.Layout, launcher: Launcher) -> None:
        self.level, self.layout, self.launch = level, layout, launcher
        self.total = total = int(layout.shapes * layout.per_shape)
        make = {"device": launcher.device}
        even = layout.expected_width * np.repeat(level.sizes, layout.per_shape)
        self.widths = wp.array(even, dtype=float, **make)
        self.next_widths = wp.array(even, dtype=float, **make)
        self.masses = wp.zeros(total, dtype=float, **make)
        self.energies = wp.zeros(total, dtype=float, **make)
        self.neighbors = wp.zeros((total, ROW), dtype=int, **make)
        self.counts = wp.zeros(total, dtype=int, **make)
        self.pairs = wp.zeros((total, ROW), dtype=wp.vec4, **make)
        self.forces = wp.zeros(total, dtype=wp.vec3, **make)
        self.spread = wp.zeros(total, dtype=wp.vec3, **make)
        self.side = math.ceil(round(layout.shapes ** (1.0 / 3.0), 6))
        cells = CELLS if total < CELLS**3 else 2 * CELLS
        self.grid = wp.HashGrid(cells, cells, cells, device=launcher.device)

    def relink(self, positions: DeviceArray, feet: DeviceArray) -> None:
        """List the neighbours of every particle anew."""
        layout = self.layout
        reach = layout.reach * float(self.level.sizes.max())
        apart = 2.4 * self.level.extent + 2.0 * reach
        wp.launch(
            sampling_kernels.spread,
            dim=self.total,
            inputs=[layout.per_shape, self.side, apart, positions, self.spread],
            device=self.launch.device,
        )
        self.grid.build(self.spread, min(reach, 2.0 * self.level.extent))
        lists = [self.neighbors, self.counts]
        self.launch(
            sampling_kernels.link_neighbors,
            self.total,
            [layout, self.grid.id, self.level.surfaces, self.spread, feet, *lists],
        )

    def repel(self, positions: DeviceArray, normals: DeviceArray, feet: DeviceArray) -> None:
        """Compute widths, energies and forces."""
        lists = [self.neighbors, self.counts]
        made = [self.masses, self.pairs, self.forces]
        places = [self.level.surfaces, positions, normals, feet]
        self.launch(
            sampling_kernels.repel,
            self.total,
            [self.layout, *places, *lists, self.widths, self.next_widths, *made, self.energies],
        )
        self.launch(
            sampling_kernels.yield_back, self.total, [self.layout, normals, *lists, self.widths, *made]
        )
