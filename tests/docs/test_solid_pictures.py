"""The picture of solids: a solid covers what its shadow covers, and what is nearer hides the rest."""

import numpy as np
import pytest
from manifold3d import Manifold
from solid_pictures import shaded, solids_figure

from tactsim import models
from tactsim.models.solids import solid_of


def test_a_box_covers_its_shadow_in_three_greys():
    image = shaded(solid_of("box", Manifold.cube((20, 30, 40))), 30.0)
    back = np.array([0.55, -0.7, 0.46]) / np.linalg.norm([0.55, -0.7, 0.46])
    shadow = np.abs(back) @ [30 * 40, 20 * 40, 20 * 30]
    drawn = np.isfinite(image)
    # Every pixel that the shadow touches is drawn, so its rim counts half a pixel too much.
    assert drawn.sum() * 0.3**2 == pytest.approx(shadow, rel=0.03)
    assert len(np.unique(image[drawn].round(6))) == 3


def test_a_cavity_is_hidden():
    whole = Manifold.cube((30, 30, 30), True)
    hollow = solid_of("hollow", whole - Manifold.cube((20, 20, 20), True))
    full = solid_of("full", whole)
    inner, outer = shaded(hollow, 30.0), shaded(full, 30.0)
    drawn = np.isfinite(inner) & np.isfinite(outer)
    # At an edge a pixel may take the grey of either face.
    assert np.isclose(inner[drawn], outer[drawn]).mean() > 0.985


def test_the_figure_names_each_solid_and_its_turns():
    figure = solids_figure([models.solid(name) for name in ("key", "ring")], across=2)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == ["key\n1 turn", "ring\nround, both ends alike"]
    assert figure.png(dpi=40).startswith(b"\x89PNG")
