"""Mirror images, and maps that may be reflections."""

from dataclasses import replace
from typing import Any, ClassVar, Final, Protocol, TypeVar

import numpy as np

from homolog.arrays import BoolArray, FloatArray, frozen

__all__ = ["MIRROR", "mirror_image", "mirrors"]

MIRROR: Final[FloatArray] = frozen(np.diag([-1.0, 1.0, 1.0, 1.0]))
"""Exchanges left and right (the first axis of LPS); it is its own inverse, and exact in floating point."""


def mirrors(matrices: FloatArray) -> BoolArray:
    """Return whether affine maps (..., 4, 4) exchange left and right, shape (...)."""
    return np.asarray(np.linalg.det(matrices[..., :3, :3]) < 0.0)


class _Shape(Protocol):
    """A dataclass with a distance field and its meshes."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def field(self) -> Any:  # noqa: ANN401 - a DistanceField, whose module imports this one
        """The implicit surface."""

    @property
    def mesh(self) -> Any:  # noqa: ANN401 - a TriangleMesh
        """Its zero level."""

    @property
    def coarse_mesh(self) -> Any:  # noqa: ANN401
        """The same surface with fewer vertices."""


_AnyShape = TypeVar("_AnyShape", bound=_Shape)


def mirror_image(shape: _AnyShape) -> _AnyShape:
    """Return a shape whose distance field and meshes are mirrored."""
    return replace(
        shape,
        field=shape.field and shape.field.mirrored,  # an open shape has none
        mesh=shape.mesh.placed(MIRROR),
        coarse_mesh=shape.coarse_mesh.placed(MIRROR),
    )
