"""The sampling entropy H(P): neighbour lists, Parzen widths and forces."""

import math

import numpy as np
import warp as wp

from homolog.arrays import DeviceArray
from homolog.correspondence.kernels import particles as kernels
from homolog.correspondence.kernels import sampling as sampling_kernels
from homolog.correspondence.launcher import Launcher
from homolog.correspondence.surface_sets import SurfaceSet

__all__ = ["LIST_CUTOFF", "LIST_ITERATIONS", "Sampling"]

MAX_NEIGHBOURS = 64  # per particle; an even layout needs 20
KNOWN_NEIGHBOURS = 32  # whose codes in the geodesic table are kept
SKIN_FACTOR = 1.08  # cutoff of neighbour lists over that of forces (Verlet skin)
LIST_ITERATIONS = 5  # for which a neighbour list is valid
GRID_CELLS = 64  # of the hash grid along each axis; twice as many for more particles than cells
LIST_CUTOFF = sampling_kernels.CUTOFF * sampling_kernels.MAX_WIDTH_RATIO * SKIN_FACTOR
"""Longest distance in neighbour lists, in Parzen widths of an even layout."""


class Sampling:
    """The sampling term for all particles of all shapes.

    Attributes
    ----------
    widths, next_widths : wp.array of float
        Parzen widths, now and after the next fixed-point iteration.
    forces : wp.array of vec3
        Descent of the sampling entropy, in the tangent planes.
    energies : wp.array of float
        log A_i - 3 log s_i.
    counts : wp.array of int
        Neighbours within the cutoff.
    """

    widths: DeviceArray
    energies: DeviceArray
    counts: DeviceArray

    def __init__(self, surface_set: SurfaceSet, layout: kernels.Layout, launcher: Launcher) -> None:
        self.surface_set, self.layout, self.launch = surface_set, layout, launcher
        self.total = total = int(layout.shapes * layout.per_shape)
        on_device = {"device": launcher.device}
        even = layout.expected_width * np.repeat(surface_set.sizes, layout.per_shape)
        self.widths = wp.array(even, dtype=float, **on_device)
        self.next_widths = wp.array(even, dtype=float, **on_device)
        self.masses = wp.zeros(total, dtype=float, **on_device)
        self.energies = wp.zeros(total, dtype=float, **on_device)
        self.neighbours = wp.zeros((total, MAX_NEIGHBOURS), dtype=int, **on_device)
        self.counts = wp.zeros(total, dtype=int, **on_device)
        self.places = wp.zeros((total, MAX_NEIGHBOURS), dtype=wp.int8, **on_device)
        self.pairs = wp.zeros((total, MAX_NEIGHBOURS), dtype=wp.vec4, **on_device)
        known = (total, KNOWN_NEIGHBOURS if launcher.device == "cpu" else 0)
        self.known = wp.zeros(known, dtype=sampling_kernels.PairCodes, **on_device)
        self.forces = wp.zeros(total, dtype=wp.vec3, **on_device)
        self.rims = wp.zeros(total if surface_set.has_rims else 0, dtype=wp.vec4, **on_device)
        self.spread = wp.zeros(total, dtype=wp.vec3, **on_device)
        self.side = math.ceil(round(layout.shapes ** (1.0 / 3.0), 6))
        cells = GRID_CELLS if total < GRID_CELLS**3 else 2 * GRID_CELLS
        self.grid = wp.HashGrid(cells, cells, cells, device=launcher.device)

    def rebuild_neighbour_lists(
        self, positions: DeviceArray, faces: DeviceArray, closest: DeviceArray
    ) -> None:
        """Rebuild the neighbour lists (parameters as in `compute_forces`)."""
        layout = self.layout
        cutoff = layout.list_cutoff * float(self.surface_set.sizes.max())
        spacing = 2.4 * self.surface_set.extent + 2.0 * cutoff
        wp.launch(
            sampling_kernels.spread,
            dim=self.total,
            inputs=[layout.per_shape, self.side, spacing, positions, self.spread],
            device=self.launch.device,
        )
        self.grid.build(self.spread, min(cutoff, 2.0 * self.surface_set.extent))
        lists = [self.neighbours, self.counts, self.places]

        def link() -> None:
            particles = [self.spread, faces, closest, self.known]
            given = [layout, self.grid.id, self.surface_set.surfaces, *particles]
            self.launch(sampling_kernels.link_neighbours, self.total, [*given, *lists])
            self.launch(sampling_kernels.link_back, self.total, lists)

        self.launch.in_order(link, layout.per_shape)

    def compute_forces(
        self, positions: DeviceArray, normals: DeviceArray, faces: DeviceArray, closest: DeviceArray
    ) -> None:
        """Compute widths, energies and forces.

        Parameters
        ----------
        positions, normals : (M n,) arrays of vec3
            Of the particles.
        faces, closest : (M n,) arrays
            Closest faces and points of the meshes, from which geodesic distances are looked up.
        """
        lists = [self.neighbours, self.counts]
        geometry = [self.surface_set.surfaces, positions, normals, faces, closest, self.known]
        self.launch(
            sampling_kernels.measure_pairs,
            self.total,
            [self.layout, *geometry, *lists, self.places, self.widths, self.pairs],
        )
        if self.surface_set.has_rims:
            given = [self.layout, self.surface_set.surfaces, closest, self.rims]
            self.launch(sampling_kernels.find_rims, self.total, given)
        widths, made = [self.widths, self.next_widths], [self.masses, self.forces, self.energies]
        self.launch(
            sampling_kernels.compute_forces,
            self.total,
            [self.layout, self.surface_set.surfaces, normals, *lists, self.pairs, self.rims, *widths, *made],
        )
        self.launch(
            sampling_kernels.add_reaction_forces,
            self.total,
            [self.layout, normals, *lists, self.widths, self.masses, self.pairs, self.rims, self.forces],
        )
