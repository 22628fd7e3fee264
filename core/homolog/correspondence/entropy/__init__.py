"""The terms of the objective: sampling entropy H(P), ensemble entropy H(Z), entropy of normals H(V)."""
