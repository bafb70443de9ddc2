import itertools
import math

import numpy as np
import pytest
from scipy import fft
from scipy.optimize import minimize

from tactsim import models
from tactsim.core.errors import InputError

# The closest two glyphs of the catalogue, O and Q, differ by this area (mm^2) however they are turned and
# shifted, as much as eleven taxels have; every other pair differs by 49 mm^2 or more.
LEAST_DIFFERENCE = 35.0
PITCH, CELLS = 0.75, 64  # mm, cells a side: room for the largest glyph beside itself
TURNS = np.radians(np.arange(0, 360, 5))


def raster(letter, angle):
    """Sample a letter's footprint, turned by an angle, at the centres of the cells (even-odd rule)."""
    grid = (np.arange(CELLS) - CELLS / 2 + 0.5) * PITCH
    cos, sin = math.cos(angle), math.sin(angle)
    inside = np.zeros((CELLS, CELLS), dtype=bool)
    for contour in letter.contours:
        turned = contour @ np.array([[cos, sin], [-sin, cos]])
        for (ax, ay), (bx, by) in zip(turned, np.roll(turned, -1, axis=0), strict=True):
            rows = np.flatnonzero((grid > ay) != (grid > by))  # that the edge crosses: a few of all
            if len(rows):
                inside[rows] ^= grid < ax + (bx - ax) * (grid[rows, None] - ay) / (by - ay)
    return inside


@pytest.fixture(scope="module")
def overlaps():
    """The largest overlap (mm^2) of each pair over all shifts, for each turn, and the shift (mm) it has."""
    names = models.names()
    spectra = {
        name: fft.rfft2(
            np.stack([raster(models.letter(name), angle) for angle in TURNS]).astype(np.float32), axes=(1, 2)
        )
        for name in names
    }
    found = {}
    for a, b in itertools.combinations(names, 2):
        cells = fft.irfft2(spectra[a][:1].conj() * spectra[b], s=(CELLS, CELLS), axes=(1, 2))
        flat = cells.reshape(len(TURNS), -1)
        best = flat.argmax(axis=1)
        shift = (np.stack(np.unravel_index(best, (CELLS, CELLS)), axis=1) + CELLS // 2) % CELLS - CELLS // 2
        found[a, b] = (flat.max(axis=1) * PITCH**2, -shift[:, ::-1] * PITCH)
    return found


@pytest.mark.long
def test_no_two_glyphs_are_alike_however_turned_and_shifted(overlaps):
    for (a, b), (overlap, shift) in overlaps.items():
        first, second = models.letter(a).footprint, models.letter(b).footprint
        total = first.area() + second.area()
        if total - 2 * overlap.max() > 3 * LEAST_DIFFERENCE:
            continue

        def difference(pose, first=first, second=second, total=total):
            moved = second.rotate(math.degrees(pose[2])).translate((pose[0], pose[1]))
            return total - 2 * (first ^ moved).area()

        for turn in np.argsort(-overlap)[:4]:
            start = np.array([*shift[turn], TURNS[turn]])
            simplex = start + np.array([[0, 0, 0], [0.5, 0, 0], [0, 0.5, 0], [0, 0, 0.05]])
            best = minimize(difference, start, method="Nelder-Mead", options={"initial_simplex": simplex})
            assert best.fun > LEAST_DIFFERENCE, (a, b, best.x)


def test_glyphs_are_about_25_mm_tall_and_fit_the_stage():
    for name in models.names():
        left, bottom, right, top = models.letter(name).footprint.bounds()
        assert top - bottom == pytest.approx(25, abs=2), name
        assert right - left < 28.5, name
        assert max(-left, -bottom, right, top) < 16, name


def test_curves_stay_near_their_circle():
    outer, inner = models.letter("O").contours
    for contour, radius in ((outer, 12.5), (inner, 8.0)):
        middle = (contour + np.roll(contour, -1, axis=0)) / 2
        assert np.hypot(*contour.T) == pytest.approx(radius, abs=1e-6)
        assert radius - np.hypot(*middle.T).min() < 0.04


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (" U E,A ", "UEA"),
        ("AAEA", "AE"),
        ("X-2", "XYZ012"),
        ("C-EA-D", "CDEAB"),
        ("A-Z0-9", "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"),
    ],
)
def test_letter_sets(text, expected):
    assert "".join(models.parse_letters(text)) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [("", "no letters"), ("a", ""), ("A-", ""), ("U-A", ""), ("A\nB;", ""), ("a.svg", "by --shape")],
)
def test_wrong_letter_sets_are_one_line(text, expected):
    with pytest.raises(InputError) as error:
        models.parse_letters(text)
    assert "\n" not in str(error.value)
    assert expected in str(error.value)
