"""The picture of learned surfaces: three sides of each, and only what looks at the viewer."""

import numpy as np

from tactsim.bench.space.pictures import surfaces_figure
from tactsim.estimators.space.surface import Surface


def test_three_sides_of_each_object_are_drawn():
    rng = np.random.default_rng(0)
    normals = rng.standard_normal((300, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surfaces = {name: Surface(10 * normals, normals, 2.0) for name in ("ball", "$x_1", "c", "d", "e")}
    figure = surfaces_figure(surfaces)
    drawn = [axes for axes in figure.axes if axes.collections]
    assert len(drawn) == 3 * len(surfaces)
    along_z = drawn[0].collections[0].get_offsets()
    assert len(along_z) == np.count_nonzero(normals[:, 2] > 0)
    assert figure.png() == surfaces_figure(surfaces).png()
