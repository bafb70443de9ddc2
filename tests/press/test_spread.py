"""The map from contact pressure to taxels against fine quadrature: pads, point spreads, slopes of pressure."""

from dataclasses import replace

import numpy as np
import pytest
from exact_readings import expected_reading
from hypothesis import example, given, settings
from hypothesis import strategies as st
from level_world import level_scan
from manifold3d import CrossSection
from scipy.special import erf

from tactsim import models
from tactsim.core import Pad
from tactsim.press import SensorOptions
from tactsim.press.bed import Level, lay_bed
from tactsim.press.clip import MOMENTS, cell_moments, edges_of
from tactsim.press.engine import ideal_readings
from tactsim.press.spread import cell_lines, contact_map
from tactsim.press.touches import Touches

POSE = np.zeros((1, 3))
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)


def square_pad(count, pitch, **more):
    wide = 0.9 * pitch
    return Pad(
        **{"rows": count, "columns": count, "pitch_x": pitch, "pitch_y": pitch, "taxel_width": wide}
        | {"taxel_height": wide, "seam": None, "unread_columns": 0}
        | more
    )


def felt(x, edges, sigma):
    z = (edges - x.ravel()[:, None, None]) / (sigma * np.sqrt(2))
    return np.diff(erf(z), axis=-1)[..., 0] / 2


def fine_quadrature(region, pad, sigma, slope=(0.0, 0.0), about=(0.0, 0.0)):
    """Spread the pressure 1 + slope . (x - about), N/mm^2, of a convex region over the taxels: (taxels,) kPa."""
    reading = np.zeros(pad.taxels)
    for contour in region.to_polygons():
        apex = contour[0]
        for b, c in zip(contour[1:-1] - apex, contour[2:] - apex, strict=True):
            panels = int(max(np.hypot(*b), np.hypot(*c), np.hypot(*(c - b))) / sigma) + 2
            s = ((np.arange(panels)[:, None] + (POINTS + 1) / 2) / panels).ravel()
            weight = np.tile(WEIGHTS / 2, panels) / panels
            x, y = (apex[k] + s[:, None] * (b[k] + s * (c - b)[k]) for k in (0, 1))
            load = weight[:, None] * weight * s[:, None] * abs(b[0] * c[1] - b[1] * c[0])
            load = (load * (1 + slope[0] * (x - about[0]) + slope[1] * (y - about[1]))).ravel()
            columns, rows = felt(x, pad.column_edges, sigma), felt(y, pad.row_edges, sigma)
            reading += (rows.T @ (columns * load[:, None])).ravel()
    return 1e3 * reading / (pad.taxel_width * pad.taxel_height)


def mapped(region, pad, cells, sigma, slope=(0.0, 0.0), about=(0.0, 0.0)):
    """Map the same with cells and moments, as the press does."""
    x_lines, y_lines = cell_lines(pad, cells, sigma)
    edges = edges_of(region.to_polygons())
    bed = lay_bed([Level(edges)], POSE, x_lines, y_lines)
    moments = cell_moments(edges, POSE, x_lines, y_lines, moments=MOMENTS).reshape(MOMENTS, -1)
    bed = replace(bed, moments=moments[:, bed.cell])
    row, column = np.divmod(bed.cell, len(x_lines) - 1)
    x, y = ((x_lines[1:] + x_lines[:-1]) / 2)[column], ((y_lines[1:] + y_lines[:-1]) / 2)[row]
    pressure = 1 + slope[0] * (x - about[0]) + slope[1] * (y - about[1])
    return contact_map(bed, pressure, np.tile(slope, (len(x), 1)) if any(slope) else None, pad, cells, sigma)[
        0
    ]


def posed_rectangle(pad, size, at, angle):
    left, right, low, high = pad.load_bounds
    surface = CrossSection.square((right - left, high - low), True)
    return CrossSection.square(size, True).rotate(angle).translate(at) ^ surface


@pytest.mark.long
@settings(max_examples=60, deadline=None)
@given(
    pitch=st.floats(-0.3, 2.3).map(lambda power: 10**power),
    sigma=st.floats(-0.52, 1.0).map(lambda power: 10**power),
    cells=st.integers(1, 3),
    size=st.tuples(st.floats(1, 25), st.floats(1, 25)),
    at=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    angle=st.floats(0, 90),
    slope=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
)
@example(pitch=100.0, sigma=1.0, cells=2, size=(20.0, 4.0), at=(0.9, 0.0), angle=30.0, slope=(0.0, 0.0))
@example(pitch=200.0, sigma=0.3, cells=1, size=(25.0, 25.0), at=(0.5, 0.5), angle=10.0, slope=(0.02, 0.01))
def test_any_pad_and_point_spread_is_mapped_as_fine_quadrature_does(
    pitch, sigma, cells, size, at, angle, slope
):
    pad = square_pad(4, pitch)
    about = np.multiply(at, pad.load_bounds[1])
    region = posed_rectangle(pad, size, about, angle)
    if region.area() < 0.05:
        return
    exact = fine_quadrature(region, pad, sigma, slope, about)
    ours = mapped(region, pad, cells, sigma, slope, about)
    # A contact smaller than a cell feels the worst of the quadratic there; over several cells its errors even out.
    cell = min(pitch / cells, 1.25 * sigma)
    limit = 5e-3 if region.area() > 4 * cell**2 else 3e-2
    # A contact in a wide gap is felt by its tails alone; a tenth of what a taxel under it would feel is the least.
    felt_at_best = 1e3 * region.area() / (0.81 * pitch**2 + 2 * np.pi * sigma**2)
    assert np.abs(ours - exact).max() < limit * max(exact.max(), 0.1 * felt_at_best)


def test_wholly_covered_cells_under_an_even_pressure_are_exact():
    pad = square_pad(5, 3.0)
    x_lines, y_lines = cell_lines(pad, 2, 1.0)
    width, height = x_lines[7] - x_lines[2], y_lines[6] - y_lines[3]
    middle = ((x_lines[7] + x_lines[2]) / 2, (y_lines[6] + y_lines[3]) / 2)
    region = CrossSection.square((width, height), True).translate(middle)
    exact = fine_quadrature(region, pad, 1.0)
    assert mapped(region, pad, 2, 1.0) == pytest.approx(exact, abs=1e-12 * exact.max())


@pytest.mark.parametrize(("pitch", "sigma"), [(200.0, 0.3), (6.0, 0.4)])
def test_a_pitch_far_above_the_point_spread_is_read_right(pitch, sigma):
    pad = square_pad(2, pitch)
    options = level_scan(pad=pad, sensor=SensorOptions(psf_sigma=sigma))
    poses = np.array([[0.0, 0.0, 0.3], [2.0, -3.0, 1.0], [0.4 * pitch, 1.0, 0.0]])
    letter = models.letter("E")
    readings, _ = ideal_readings(Touches.of(letter, poses), options)
    for reading, pose in zip(readings, poses, strict=True):
        exact, area = expected_reading(letter.footprint, pose, pad, 2.0, sigma)
        assert area > 1
        assert np.abs(reading - exact).max() < 2e-3 * exact.max()
