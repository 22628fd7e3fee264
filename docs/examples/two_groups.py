"""Two groups compared: whether their shapes differ, by how much, and where."""

import numpy as np

import homolog as hl

# Particles as `hl.correspond` or `hl.Project` give them (.aligned): here spheres, half of them with a bump.
random = np.random.default_rng(seed=1)
directions = random.normal(size=(100, 3))
directions /= np.linalg.norm(directions, axis=1, keepdims=True)
shapes = 10.0 * directions + random.normal(scale=0.1, size=(24, 100, 3))
shapes[12:, :5] *= 1.1
groups = 12 * ["control"] + 12 * ["patient"]
ages = random.uniform(20.0, 80.0, size=24)

form, shape = hl.compare_groups(
    shapes, groups, ("control", "patient"), covariates={"age": ages}, permutations=999, random_state=0
)

print(f"{form.title}: form p = {form.p_adjusted:.3f}, shape p = {shape.p_adjusted:.3f}")
where = np.flatnonzero(form.p_fwe < 0.05)  # corrected over the surface, too
outward = np.einsum("ni,ni->n", form.pointwise.effect[0], directions)
print(f"particles that differ: {where}, by {outward[where].round(2)} mm along the normal")
if form.discriminant is not None:
    accuracy = form.discriminant.accuracy
    print(f"balanced accuracy {accuracy.value:.2f} (95 % CI {accuracy.low:.2f} to {accuracy.high:.2f})")
