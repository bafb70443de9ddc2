"""Placement: the metric of the error, symmetries, and the properties that it needs of an object."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tactsim.bench.placement import Properties, fold_angle, placement_error, properties
from tactsim.core import InputError, Scan, compose, invert, transform

PLAIN = Properties(symmetry=1, centre=(0.0, 0.0), inertia_over_mass=60.0)
pose = arrays(float, 3, elements=st.floats(-20, 20))


@given(pose, st.floats(-30, 30), st.floats(-30, 30))
def test_a_pure_shift_of_the_object_costs_its_length(true, dx, dy):
    moved = invert(compose([dx, dy, 0.0], invert(true)))
    assert placement_error(moved, true, PLAIN) == pytest.approx(math.hypot(dx, dy), abs=1e-6)


@given(pose, st.floats(-3, 3))
def test_a_turn_costs_the_rms_displacement_of_the_objects_points(true, turn):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(400, 2)) * 5
    points -= points.mean(axis=0)
    of = Properties(1, (0.0, 0.0), float((points**2).sum(axis=1).mean()))
    placed = invert(true)
    turned = placed + [0.0, 0.0, turn]
    cos, sin = np.cos(turn), np.sin(turn)
    moved = points @ np.array([[cos, sin], [-sin, cos]])
    rms = np.sqrt(((moved - points) ** 2).sum(axis=1).mean())
    assert placement_error(invert(turned), true, of) == pytest.approx(rms, abs=1e-6)


def test_a_turned_disc_is_at_the_same_place_though_its_state_differs():
    true = np.array([5.0, -3.0, 0.2])
    turned = invert(invert(true) + [0, 0, 2.0])
    assert np.linalg.norm(turned[:2] - true[:2]) > 4
    assert placement_error(turned, true, Properties(0, (0.0, 0.0), 60.0)) == pytest.approx(0, abs=1e-9)


def test_the_printed_mod_without_a_wrap_would_call_a_small_turn_a_large_one():
    literal = abs(math.fmod(6.2 - 0.1, 2 * math.pi))
    assert literal > 6
    assert abs(float(fold_angle(6.2 - 0.1, 1))) == pytest.approx(2 * math.pi - 6.1)


def test_the_error_is_that_of_the_object_and_not_of_the_state():
    # 1 rad of robot_in_object about a far robot origin: the state's x, y do not move, the object does.
    true, estimated = np.array([10.0, 0.0, 0.0]), np.array([10.0, 0.0, 1.0])
    expected = np.linalg.norm(invert(estimated)[:2] - invert(true)[:2])
    of = Properties(0, (0.0, 0.0), 60.0)
    assert placement_error(estimated, true, of) == pytest.approx(expected)
    assert expected > 9


@given(pose, pose, st.integers(0, 5))
def test_without_wrapped_angles_it_is_the_formula_as_it_is_printed(estimated, true, symmetry):
    of = Properties(symmetry, (0.7, -1.1), 60.0)
    placed, other = invert(estimated), invert(true)
    shift = (transform(placed, [of.centre]) - transform(other, [of.centre]))[0]
    turn = fold_angle(placed[2] - other[2], symmetry)
    expected = math.sqrt(shift @ shift + of.inertia_over_mass * 2 * (1 - math.cos(turn)))
    assert placement_error(estimated, true, of) == pytest.approx(expected, rel=1e-9, abs=1e-6)


def scan_of(points, readings, meta):
    n = len(readings)
    return Scan(
        readings=np.asarray(readings, dtype=float), poses=np.zeros((n, 3)), labels=np.array(["A"] * n),
        split=np.array(["train"] * n), taxel_xy=np.asarray(points, dtype=float), meta=meta,
    )  # fmt: skip


def test_stated_properties_are_taken_and_wrong_ones_refused():
    stated = {"symmetry": 2, "centre": [0.5, 0.0], "inertia_over_mass": 50.0}
    scan = scan_of([[0, 0]], [[1.0]], {"objects": {"A": stated}})
    assert properties(scan) == {"A": Properties(2, (0.5, 0.0), 50.0)}
    for broken in ({"symmetry": 1}, {**stated, "inertia_over_mass": -1}, "text", {**stated, "centre": [1]}):
        with pytest.raises(InputError, match=r"meta\.objects\.A"):
            properties(scan_of([[0, 0]], [[1.0]], {"objects": {"A": broken}}))


def test_unstated_properties_are_estimated_from_what_was_felt():
    scan = scan_of([[1, 0], [3, 0]], [[5.0, 5.0], [2.0, 2.0]], {})
    assert properties(scan)["A"] == Properties(1, (2.0, 0.0), pytest.approx(1.0))
    nothing_felt = scan_of([[1, 0], [3, 0]], [[0.0, 0.0]], {})
    assert np.isfinite(properties(nothing_felt)["A"].inertia_over_mass)
