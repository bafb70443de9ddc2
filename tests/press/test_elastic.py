"""Faces on an elastic layer and half-space against closed forms, first principles and a fine grid."""

from dataclasses import replace

import numpy as np
import pytest
from elastic_reference import Reference, surface_movement
from hypothesis import given, settings
from hypothesis import strategies as st
from level_world import level_press, level_scan
from manifold3d import Manifold

from tactsim import models
from tactsim.core import InputError, Pad
from tactsim.press import SensorOptions
from tactsim.press.bed import Level, lay_bed, levels
from tactsim.press.clip import edges_of
from tactsim.press.elastic import gaussians_of, modulus, multiplier, press_elastic
from tactsim.press.engine import ideal_readings
from tactsim.press.scan_poses import grid_poses
from tactsim.press.spread import cell_lines, contact_map
from tactsim.press.touches import Touches

SOLIDS = ["layer", "half-space"]
POSES = np.array([[-3.4, -3.4, 0.5], [3.4, 3.4, 2.1], [-3.4, 10.2, 4.2], [1.0, -2.0, 0.0]])


def solid(foundation, pad=None, sigma=1.0, **press):
    return level_scan(
        pad=pad or Pad(),
        press=level_press(foundation=foundation, **press),
        sensor=SensorOptions(psf_sigma=sigma, noise=0, resolution=0),
    )


def lay(face, poses, options):
    sigma = options.sensor.psf_sigma
    return lay_bed(face, poses, *cell_lines(options.pad, options.press.cells_per_taxel, sigma))


def press(name, poses, options, tilt=(0.0, 0.0)):
    bed = lay(levels(models.letter(name), options.press), poses, options)
    return bed, press_elastic(bed, np.tile(tilt, (len(poses), 1)), options)


def readings(bed, rested, options):
    cells, sigma = options.press.cells_per_taxel, options.sensor.psf_sigma
    return contact_map(bed, rested.pressure, None, options.pad, cells, sigma)


def polygon(radius, corners=360):
    """Points of a polygon that has the area of a circle."""
    angle = 2 * np.pi * np.arange(corners) / corners
    radius *= np.sqrt(2 * np.pi / (corners * np.sin(2 * np.pi / corners)))
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("poisson", [0.0, 0.45])
@pytest.mark.parametrize("k", [0.01, 1.0, 8.0])
def test_the_layer_gives_way_as_the_equations_of_elasticity_say(k, poisson):
    thickness = 1.3
    ours = 2 * multiplier(np.array(k * thickness), poisson) / k
    assert ours == pytest.approx(surface_movement(k, thickness, poisson), rel=1e-9)


@pytest.mark.parametrize("poisson", [0.0, 0.49])
@pytest.mark.parametrize("thickness", [1e-3, 1.0, 100.0])
def test_the_sum_of_gaussians_is_the_layer_s_multiplier(thickness, poisson):
    terms = gaussians_of(thickness, poisson, 0.9, 20.0)
    k = np.geomspace(1e-3 / thickness, min(60 / thickness, 0.1 / terms.widths[0]), 500)
    got = terms.point + np.exp(-((k[:, None] * terms.widths) ** 2) / 2) @ terms.weights
    assert got == pytest.approx(multiplier(k * thickness, poisson) / k, rel=1e-3)


def test_the_sum_of_gaussians_is_the_half_space_s_multiplier():
    terms = gaussians_of(None, 0.45, 0.9, 20.0)
    k = np.geomspace(0.05, 0.1 / terms.widths[0], 500)  # from the pad's size to a cell's
    got = terms.point + np.exp(-((k[:, None] * terms.widths) ** 2) / 2) @ terms.weights
    # Gaussians wider than 100 pads are left out: they move all of the pad alike.
    assert got == pytest.approx(1 / k, rel=2e-3, abs=0)


def test_a_round_punch_sinks_into_a_half_space_as_boussinesq_says():
    """F = 2 E* a d, and p = F / (2 pi a sqrt(a^2 - r^2))."""
    radius, options = 5.0, solid("half-space", cells_per_taxel=2, force=3.0)
    bed = lay([Level(edges_of([polygon(radius)]))], np.zeros((1, 3)), options)
    rested = press_elastic(bed, np.zeros((1, 2)), options)
    assert rested.depth[0] == pytest.approx(
        3.0 / (2 * modulus(options.press, bed.area.sum()) * radius), rel=0.035
    )
    near = (np.hypot(*bed.centroid.T) < 0.6 * radius) & (bed.area > 0.8 * bed.area.max())
    expected = 3.0 / (2 * np.pi * radius * np.sqrt(radius**2 - (bed.centroid[near] ** 2).sum(axis=1)))
    assert near.sum() > 8
    assert rested.pressure[near] == pytest.approx(expected, rel=0.08)


def test_finer_cells_near_the_round_punch_s_closed_form():
    """A pressure that is infinite at the edge converges with the cell's size, not with its square."""
    errors = []
    for cells in (1, 2, 4):
        options = solid("half-space", sigma=2.0, cells_per_taxel=cells)
        bed = lay([Level(edges_of([polygon(5.0)]))], np.array([[0.3, 0.2, 0.1]]), options)
        depth = press_elastic(bed, np.zeros((1, 2)), options).depth[0]
        errors.append(abs(depth * 2 * modulus(options.press, bed.area.sum()) * 5.0 / 2.0 - 1))
    assert errors[1] < errors[0] / 1.6
    assert errors[2] < errors[1] / 1.6
    assert errors[2] < 0.02


def test_a_thin_compressible_layer_is_a_bed_of_springs():
    options = solid("layer", thickness=0.01, poisson=0.2)
    bed, rested = press("E", POSES, options)
    area = np.bincount(bed.press, bed.area)
    # Within some thicknesses of an edge the layer is stiffer, by the share of the area that lies there.
    broad = bed.area > 0.2
    assert rested.pressure[broad] == pytest.approx((2.0 / area[bed.press])[broad], rel=0.05)
    spring = 1e-3 * np.array([options.press.stiffness_over(some) for some in area])
    assert rested.depth == pytest.approx(2.0 / (spring * area), rel=0.02)


@pytest.mark.parametrize("foundation", SOLIDS)
def test_force_and_hinges_balance_and_no_pressure_pulls(foundation):
    wrist, tilt = 50.0, (0.02, -0.01)
    options = solid(foundation, wrist_stiffness=wrist, stiffness=2000.0)
    bed, rested = press("K", POSES, options, tilt)
    assert not rested.blanks
    assert (rested.pressure >= 0).all()
    forces = rested.pressure * bed.area
    assert np.bincount(bed.press, forces) == pytest.approx(2.0, rel=1e-9)
    about_x = -np.bincount(bed.press, forces * bed.centroid[:, 1])
    about_y = np.bincount(bed.press, forces * bed.centroid[:, 0])
    assert wrist * (rested.tilt - tilt) == pytest.approx(np.stack([about_x, about_y], axis=1), abs=1e-8)


@pytest.mark.parametrize("foundation", SOLIDS)
def test_a_strongly_tilted_face_lifts_off_and_enters_nowhere(foundation):
    options = solid(foundation)
    tilt = np.array([0.05, 0.1])
    bed, rested = press("E", POSES, options, tilt)
    carries = rested.pressure > 0
    assert 0.1 < carries.mean() < 0.9
    # Each press again with only the parts that carry: the same pressure, so the others matter nothing.
    alone = replace(
        bed,
        **{
            name: getattr(bed, name)[carries]
            for name in ("level", "cell", "centre", "centroid", "area", "gap")
        },
        moments=bed.moments[:, carries],
        start=np.searchsorted(bed.press[carries], np.arange(len(POSES) + 1)),
    )
    # The layer's stiffness follows from the area, which lifting off does not change here.
    again = press_elastic(alone, np.tile(tilt, (len(POSES), 1)), options)
    assert again.pressure == pytest.approx(rested.pressure[carries], rel=1e-6)
    assert again.depth == pytest.approx(rested.depth, rel=1e-6)


def test_a_level_behind_the_front_carries_once_the_front_is_pressed_in():
    """A ring 0.02 mm behind a disc: alone under a light force the disc carries, under a heavy one both do."""
    disc, ring = polygon(3.0), polygon(5.0)
    face = [Level(edges_of([disc])), Level(edges_of([ring, disc[::-1]]), 0.02)]
    shares = []
    for force in (0.005, 2.0, 50.0):
        options = solid("layer", force=force, stiffness=100.0, thickness=2.0)
        bed = lay(face, np.zeros((1, 3)), options)
        rested = press_elastic(bed, np.zeros((1, 2)), options)
        carried = np.bincount(bed.level, rested.pressure * bed.area)
        assert carried.sum() == pytest.approx(force)
        shares.append(carried[1] / force)
    assert shares[0] == 0
    assert 0.05 < shares[1] < shares[2]


@settings(max_examples=20, deadline=None)
@given(
    st.sampled_from(models.names()),
    st.tuples(st.floats(-15, 15), st.floats(-15, 15), st.floats(-10, 10)),
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
    st.sampled_from(SOLIDS),
    st.sampled_from([None, 100.0, 1e4]),
    st.floats(-2, 2).map(lambda power: 10**power),
    st.floats(-3, 2).map(lambda power: 10**power),
    st.floats(0, 0.49),
)
def test_any_press_balances_without_pulling(name, pose, tilt, foundation, wrist, force, thickness, poisson):
    options = solid(foundation, force=force, thickness=thickness, poisson=poisson, wrist_stiffness=wrist)
    bed, rested = press(name, np.array([pose]), options, tilt)
    assert (rested.pressure >= 0).all()
    if len(bed.area) and not rested.blanks:
        assert rested.pressure @ bed.area == pytest.approx(force, rel=1e-6)
        assert wrist is not None or rested.tilt.tolist() == [list(tilt)]


def compare(name, poses, options, tilt=(0.0, 0.0)):
    """Give rms and largest error of the taxels over the largest one, for each press of 4 mm^2 or more."""
    setup = options.press
    thickness = setup.thickness if setup.foundation == "layer" else None
    reference = Reference(options.pad, thickness, setup.poisson)
    bed, rested = press(name, poses, options, tilt)
    got, errors = readings(bed, rested, options), []
    for index, pose in enumerate(poses):
        area = bed.area[bed.press == index].sum()
        if area < 4:
            continue
        x, y = np.meshgrid(reference.x, reference.y)
        gap = modulus(setup, float(area)) * (x * tilt[1] - y * tilt[0])
        letter = models.letter(name)
        pressure = reference.pressure(reference.covered(letter, pose), setup.force, gap)
        exact = reference.reading(pressure, options.sensor.psf_sigma)
        error = (got[index] - exact) / exact.max()
        errors.append([np.sqrt(np.mean(error**2)), np.abs(error).max()])
    return np.array(errors)


@pytest.mark.parametrize("foundation", SOLIDS)
def test_two_cells_a_taxel_are_within_two_percent_of_a_fine_grid(foundation):
    errors = np.concatenate([compare(name, POSES[:2], solid(foundation)) for name in "EO"])
    assert errors[:, 0].mean() < 0.02
    assert errors[:, 1].max() < 0.08


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.01, -0.01)])
@pytest.mark.parametrize(
    ("foundation", "thickness", "poisson"),
    [("half-space", 1.0, 0.45), ("layer", 1.0, 0.45), ("layer", 2.0, 0.49), ("layer", 0.5, 0.3)],
)
def test_every_vowel_is_within_two_percent_of_a_fine_grid(foundation, thickness, poisson, tilt):
    options = solid(foundation, thickness=thickness, poisson=poisson)
    errors = np.concatenate([compare(name, grid_poses()[5::24], options, tilt) for name in "AEIOU"])
    assert errors[:, 0].mean() < 0.02
    assert errors[:, 0].max() < 0.04


def test_a_scan_is_pressed_on_the_foundation_asked_for():
    letter = models.letter("E")
    tilts = np.tile((0.01, 0.0), (len(POSES), 1))
    options = solid("layer", wrist_stiffness=300.0)
    touches = Touches(letter, POSES, tilts)
    got, work = ideal_readings(touches, options)
    assert work["presses"] == work["engine_elastic"] == len(POSES)
    bed, rested = press("E", POSES, options, (0.01, 0.0))
    assert got == pytest.approx(readings(bed, rested, options), rel=0.02, abs=0.01 * got.max())


def test_what_the_elastic_foundations_cannot_do_is_refused():
    letter = models.letter("E")
    for engine in ("exact", "bed", "collide", "relief"):
        with pytest.raises(InputError, match=rf"{engine} cannot press this: press\.foundation is layer"):
            ideal_readings(Touches.of(letter, POSES), solid("layer", engine=engine))
    ball = models.relief("ball", Manifold.sphere(10, 24))
    with pytest.raises(InputError, match=r"press\.foundation: layer cannot carry this: 'ball' has relief"):
        ideal_readings(Touches.of(ball, POSES), solid("layer"))
    with pytest.raises(ValueError, match="half-space is pressed at rest only; give dynamics = equilibrium"):
        level_press(foundation="half-space", dynamics="full")
    tipping = solid("layer", wrist_stiffness=1.0)
    with pytest.raises(InputError, match="tips over"):
        ideal_readings(Touches.of(letter, np.array([[-9.0, 4.0, 1.0]])), tipping)
