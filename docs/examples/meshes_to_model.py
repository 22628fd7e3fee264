"""Meshes in memory to a shape model: corresponding points, modes of variation, and surfaces of new shapes."""

import numpy as np
import trimesh

import homolog as hl

# Ellipsoids of which one semi-axis varies, from trimesh. Files, arrays and pyvista meshes do as well.
ball = trimesh.creation.icosphere(subdivisions=3)
lengths = [8.0, 9.0, 10.0, 11.0]
meshes = {
    f"length {length:g}": trimesh.Trimesh(ball.vertices * [length, 7.0, 6.0], ball.faces)
    for length in lengths
}

result = hl.correspond(
    meshes,
    n_particles=64,
    spacing=1.0,  # [mm] of the grid, and
    mesh_edge=2.0,  # of the surfaces: coarser than usual, as is the schedule, so that this takes seconds
    split_iterations=10,
    anneal_iterations=50,
    settle_iterations=50,
    callback=lambda fraction, message: print(f"{fraction:4.0%} {message:40}", end="\r"),
)
print(f"\n{result}")

model = hl.ShapeModel().fit(result.aligned, names=result.names)
print("share of the variance in each mode:", model.explained_variance_ratio_.round(3))
print("scores of the first mode [mm]:", dict(zip(result.names, model.scores_[:, 0].round(2), strict=True)))

for deviations in (-2.0, 0.0, 2.0):  # of mode 1, whose sign means nothing
    surface = result.surface(model.instance([deviations]))
    print(f"{deviations:+.0f} SD: {np.ptp(surface.vertices[:, 0]):.1f} mm long")
hl.write_mesh("mode_1_plus_2sd.ply", surface)
model.save("model.npz")
project = result.save("PROJECT")  # which `homolog PROJECT` opens in the window
