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
from tactsim.press import ScanOptions, SensorOptions, scan_letters
from tactsim.press.bed import Level, lay_bed
from tactsim.press.clip import MOMENTS, cell_moments, edges_of
from tactsim.press.engine import ideal_readings
from tactsim.press.spread import cell_lines, contact_map
from tactsim.press.touches import Touches, draw_loads

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
    sigma=st.floats(-0.52, 1.0).map(lambda power: 10**power), cells=st.integers(1, 3),
    size=st.tuples(st.floats(1, 25), st.floats(1, 25)), at=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    angle=st.floats(0, 90), slope=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)),
)  # fmt: skip
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


LETTER = models.letter("E")
POSES = np.array([[1.0, 2.0, 0.3], [-3.0, 4.0, 1.2], [6.0, -2.0, 2.0], [40.0, 0.0, 0.0]])
TILTS = np.array([[0.004, -0.003], [0.002, 0.006], [-0.004, 0.001], [0.0, 0.003]])
LOAD = np.array([0.4, 1.0, 1.7, 2.0])


@pytest.mark.parametrize(
    "press",
    [
        {"engine": "bed", "wrist_stiffness": "rigid"},
        {"engine": "collide"},
        {"engine": "relief"},
        {"stiffness": 1.0},  # so soft that the layer is as stiff as the load asks for
        {"dynamics": "full"},
    ],
    ids=str,
)
def test_a_press_with_its_own_load_is_one_with_that_force(press):
    together, _ = ideal_readings(Touches(LETTER, POSES, TILTS, load=LOAD), ScanOptions(press=press))
    for row, load in enumerate(LOAD):
        touches = Touches(LETTER, POSES[row : row + 1], TILTS[row : row + 1])
        alone, _ = ideal_readings(touches, ScanOptions(press={**press, "force": 2.0 * load}))
        assert together[row] == pytest.approx(alone[0], abs=1e-12 * max(1.0, alone.max()))
    assert together[2].max() > 2 * together[0].max() > 0


def test_readings_of_a_level_face_grow_with_the_load_and_of_a_tilted_one_change_their_pattern():
    options = ScanOptions(press={"wrist_stiffness": "rigid"})
    light, heavy = (
        ideal_readings(Touches(LETTER, POSES[:1], np.zeros((1, 2)), load=np.array([load])), options)[0][0]
        for load in (0.3, 1.0)
    )
    assert light == pytest.approx(0.3 * heavy, rel=1e-12)
    light, heavy = (
        ideal_readings(Touches(LETTER, POSES[:1], 5 * TILTS[:1], load=np.array([load])), options)[0][0]
        for load in (0.3, 1.0)
    )
    assert np.abs(light / light.sum() - heavy / heavy.sum()).max() > 0.01


@pytest.mark.parametrize("spread", [0.1, 1.0])
def test_loads_are_above_0_with_mean_1_and_the_stated_deviation(spread):
    loads = draw_loads(400_000, spread, np.random.default_rng(0))
    assert loads.min() > 0
    assert loads.mean() == pytest.approx(1, abs=5 * spread / np.sqrt(len(loads)))
    assert loads.std() == pytest.approx(spread, rel=0.03)


def level(**options):
    return level_scan(letters=("E",), sensor={"noise": 0.0, "resolution": 0.0}, **options)


def test_a_test_load_changes_the_test_presses_alone():
    usual, _ = scan_letters(level())
    lighter, _ = scan_letters(level(test_load=0.5))
    test = usual.split == "test"
    assert np.array_equal(lighter.readings[~test], usual.readings[~test])
    assert lighter.readings[test] == pytest.approx(0.5 * usual.readings[test], rel=1e-12)


def test_the_cache_knows_loads_from_each_other(few_angles):
    options = {"letters": ("E",), "placement_tilt": 0.01}
    scan_letters(ScanOptions(**options))
    _, work = scan_letters(ScanOptions(**options, test_load=0.5))
    assert work["skipped"]["cached"] == 48  # the training presses, whose load is the same
    cached, work = scan_letters(ScanOptions(**options, test_load=0.5))
    assert work["presses"] == 0
    fresh, _ = scan_letters(ScanOptions(**options, test_load=0.5), cache=False)
    assert np.array_equal(cached.readings, fresh.readings)
    _, work = scan_letters(ScanOptions(**options, load_spread=0.1))
    assert work["skipped"]["cached"] == 0
