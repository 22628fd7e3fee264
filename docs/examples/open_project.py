"""A project of the command line or the window, opened: its subjects, particles, groups and meshes.

Usage: python open_project.py PROJECT
"""

import sys

import numpy as np

import homolog as hl

project = hl.Project(sys.argv[1])
subjects, particles, _ = project.aligned.shape
print(f"{subjects} subjects, {particles} particles, {project.settings.optimize.method}")

for name, group, mesh in zip(project.names, project.groups, project.meshes, strict=True):
    print(f"{name}: group {group}, {mesh.volume / 1000.0:.2f} ml")

model = hl.ShapeModel().fit(project.aligned, names=project.names)
sizes = np.corrcoef(model.scores_[:, 0], project.sizes)[0, 1]
print(f"mode 1 explains {model.explained_variance_ratio_[0]:.0%}; its correlation with size is {sizes:.2f}")
