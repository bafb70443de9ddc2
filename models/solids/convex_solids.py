"""Cut a solid into few convex pieces, which MuJoCo needs to collide it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tactsim.core.poses import FloatArray

if TYPE_CHECKING:
    from manifold3d import Manifold


def convex_solids(solid: Manifold) -> tuple[FloatArray, ...]:
    """Cut."""
    raise NotImplementedError
