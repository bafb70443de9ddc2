"""The tables of docs/performance.md: what is timed, and a page without them."""

import numpy as np
import page_performance

import tactsim


def test_every_reading_of_a_trial_has_a_time_and_the_fit_has_one():
    scan = tactsim.scan(letters="IL")
    timed = page_performance.in_turns("nearest", [scan, scan.of_letters("I")], readings=7, trials=2)
    assert len(timed) == 2
    for spent, fit in timed:
        assert spent.shape == (7,)
        assert (spent > 0).all()
        assert fit > 0


def test_many_letters_are_the_pressed_ones_and_stretched_copies():
    scan = tactsim.scan(letters="IL")
    many = page_performance.enlarged(scan, 5)
    assert many.letters == ("I", "L", "I1", "L1", "I2")
    copy, pressed = (many.where(label=label).poses for label in ("L1", "L"))
    stretch = copy.max(axis=0) / pressed.max(axis=0)
    assert np.allclose(copy, pressed * stretch)
    assert (abs(stretch[:2] - 1) < 0.2).all()
    assert stretch[2] == 1


def test_a_page_that_asks_for_no_table_is_refused_before_the_work(tmp_path, capsys):
    (tmp_path / "page.md").write_text("<!-- time: letters -->\n<!-- end of time -->\n")
    assert page_performance.main([str(tmp_path / "page.md")]) == 2
    assert "<!-- time: taxels -->" in capsys.readouterr().err
