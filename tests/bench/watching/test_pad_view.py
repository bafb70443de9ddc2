"""The state that viewers share: what is live, what is lost, and what a tare does."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactsim.bench.watching import BIN_S, HISTORY_S, History, PadReader
from tactsim.core.source import SourceEnded, SourceError
from tactsim.hardware.calibration import Calibration
from tactsim.hardware.sources import Corrected

RAMP = np.arange(36.0)


def test_a_view_is_the_last_reading_in_full(source, device, eventually):
    with PadReader(source, device, "here") as reader:
        assert reader.view().state == "waiting"
        source.feed(RAMP + 1, RAMP)
        eventually(lambda: reader.view().readings == 2)
        view = reader.view()
        assert view.state == "live"
        np.testing.assert_array_equal(view.pressures, RAMP)
        assert view.force == pytest.approx(RAMP.sum() * 1.8 * 1.8e-3)
        assert view.scale == 50.0


def test_a_pad_that_falls_silent_is_lost_and_shows_nothing_until_it_speaks_again(
    source, device, eventually, silence
):
    silence(0.3)
    with PadReader(source, device, "here") as reader:
        source.feed(RAMP)
        eventually(lambda: reader.view().state == "lost")
        assert reader.view().pressures is None
        eventually(lambda: "the cable is off" in reader.view().trouble)
        silence(1000.0)
        source.feed(RAMP)
        eventually(lambda: reader.view().readings == 2)
        assert reader.view().state == "live"
        assert reader.view().trouble == ""


def test_the_end_of_a_recording_shows_no_image(source, device, eventually):
    with PadReader(source, device, "here") as reader:
        source.feed(RAMP, SourceEnded("over"))
        eventually(lambda: reader.view().state == "ended")
        assert reader.view().pressures is None
        reader.check()


def test_what_breaks_the_source_is_raised_again(source, device, eventually):
    with PadReader(source, device, "here") as reader:
        source.feed(SourceError("another device"))
        eventually(lambda: reader.error is not None)
    with pytest.raises(SourceError, match="another device"):
        reader.check()


def test_a_pad_that_never_spoke_is_an_error_at_the_end(source, device, eventually, silence):
    silence(0.3)
    with PadReader(source, device, "here") as reader:
        eventually(lambda: reader.view().state == "lost")
    with pytest.raises(SourceError, match="the cable is off"):
        reader.check()


def test_a_tare_is_taken_and_refused(source, device, eventually):
    rng = np.random.default_rng(0)
    with PadReader(source, device, "here") as reader:
        reader.tare()
        source.feed(*(3 + 0.1 * rng.standard_normal((100, 36))))
        eventually(lambda: reader.view().message.startswith("tared"))
        source.feed(RAMP + 3)
        eventually(lambda: reader.view().readings == 101)
        np.testing.assert_allclose(reader.view().pressures, RAMP, atol=0.1)
        reader.tare()
        source.feed(*(60 + 0.1 * rng.standard_normal((100, 36))))
        eventually(lambda: "something touches the pad" in reader.view().message)
        source.feed(RAMP + 3)
        eventually(lambda: reader.view().readings == 202)
        np.testing.assert_allclose(reader.view().pressures, RAMP, atol=0.1)


def test_a_tare_that_would_leave_a_taxel_out_is_refused_while_an_estimator_reads(source, device, eventually):
    frames = np.random.default_rng(0).standard_normal((100, 36))
    frames[:, 3] = 40.0
    taken = []
    with PadReader(source, device, "here", on_reading=taken.append) as reader:
        reader.tare()
        source.feed(*frames)
        eventually(lambda: len(taken) == 100)
        view = reader.view()
    assert "no tare: stuck or always loaded is 3" in view.message
    assert "bench tare" in view.message
    assert view.left_out == ()
    assert taken[-1].pressures[3] == 40.0


def test_a_tare_is_taken_below_a_calibration_that_leaves_taxels_out(source, device, eventually):
    """As `live` and guided sessions read: the new zero counts, gains and taxels left out stay."""
    before = Calibration(
        device="x", port="x", taken="2026-01-01T00:00:00Z", frames=40, tare=[0.0] * 36, noise=[1.0] * 36,
        gain=[2.0] * 36, dead=[7], loaded=[8],
    )  # fmt: skip
    frames, taken, tares = -5 + 0.1 * np.random.default_rng(0).standard_normal((101, 36)), [], []
    frames[:, 8] += 60
    with PadReader(
        Corrected(source, before, "here"), device, "here", on_reading=taken.append, on_tare=tares.append
    ) as reader:
        source.feed(frames[0])
        eventually(lambda: taken)
        reader.tare()
        source.feed(*frames[1:], RAMP - 5)
        eventually(lambda: len(taken) == 102)
        view = reader.view()
    assert view.message.startswith("tared")
    kept = np.delete(np.arange(36), [7, 8])
    assert taken[0].pressures == pytest.approx(np.full(34, -10), abs=1)
    assert taken[100].pressures == pytest.approx(np.zeros(34), abs=1)
    assert taken[101].pressures == pytest.approx(2 * RAMP[kept], abs=0.2)
    assert (view.left_out, tares[0].gain, tares[0].dead) == ((7, 8), before.gain, (7,))


def test_taxels_that_are_left_out_are_named(source, device, eventually):
    calibration = Calibration(
        device="x", port="x", taken="2026-01-01T00:00:00Z", frames=40, tare=[1.0] * 36, noise=[1.0] * 36,
        gain=[2.0] * 36, dead=[7], stuck=[8],
    )  # fmt: skip
    frames = np.random.default_rng(0).standard_normal((250, 36))
    with PadReader(source, device, "here", calibration) as reader:
        source.feed(*frames)
        eventually(lambda: reader.view().readings == 250)
        view = reader.view()
    assert view.left_out == (7, 8)
    assert np.isnan(view.pressures[[7, 8]]).all()
    kept = np.delete(np.arange(36), [7, 8])
    np.testing.assert_allclose(view.pressures[kept], 2 * (frames[-1, kept] - 1))


@given(st.lists(st.tuples(st.floats(0, 0.7), st.floats(-1, 50)), max_size=40))
def test_history_is_the_mean_of_each_bin_that_has_ended(steps):
    history, bins, now = History(), {}, 0.0
    for step, force in steps:
        now += step
        history.add(now, force, 0.0)
        bins.setdefault(int(now / BIN_S), []).append(force)
        wanted = [bins.get(k) for k in range(int(now / BIN_S))]
        seen = history.forces(now)
        assert len(seen) == len(wanted)
        for value, forces in zip(seen, wanted, strict=True):
            assert value is None if forces is None else value == pytest.approx(np.mean(forces))


def test_history_forgets_what_is_too_old():
    history = History()
    history.add(0.0, 1.0, 30.0)
    history.add(1e6, 2.0, 20.0)
    assert history.forces(1e6) == [None] * round(HISTORY_S / BIN_S)
    assert history.largest(1e6) == 20.0
    assert history.rate(1e6) < 1
