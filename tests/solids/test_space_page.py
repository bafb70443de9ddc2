"""The page of runs in space in a real browser: headless Chromium, opened from disk."""

import pytest
from browser import browser, needs_browser
from made_up_space import make_replayed, make_space_run

from tactsim.solids.page import page

pytestmark = [pytest.mark.long, needs_browser]


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    run = make_space_run()
    path = tmp_path_factory.mktemp("page") / "report.html"
    replayed = [make_replayed(run), make_replayed(run, 1, pads=1, kind="hardest")]
    path.write_text(page({"a <b>": run}, {"a <b>": replayed}, ["a remark"]))
    faults = []
    with browser(tmp_path_factory.mktemp("profile")) as context:
        tab = context.new_page()
        tab.set_viewport_size({"width": 1280, "height": 900})
        tab.on("console", lambda message: faults.append(message.text))
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.goto(path.as_uri())
        tab.wait_for_selector("html[data-ready]")
        tab.wait_for_timeout(300)
        yield tab
        assert faults == []


def picture(tab):
    """Give the canvas's pixels as one text, and how many of them are drawn."""
    tab.wait_for_timeout(100)
    return tab.evaluate(
        "() => { const c = document.querySelector('canvas.space');"
        "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return [c.toDataURL(), n]; }"
    )


def test_the_view_can_be_turned_by_mouse_and_keys_and_what_is_shown_can_be_chosen(opened):
    first, drawn = picture(opened)
    assert drawn > 1000
    canvas = opened.locator("canvas.space")
    canvas.hover()
    opened.mouse.down()
    opened.mouse.move(500, 500, steps=4)
    opened.mouse.up()
    turned, _ = picture(opened)
    assert turned != first
    canvas.press("ArrowLeft")
    assert picture(opened)[0] != turned
    for name in ("true object", "estimate", "belief", "touches"):
        opened.get_by_label(name, exact=True).uncheck()
    assert picture(opened)[1] == 0
    opened.get_by_label("true object", exact=True).check()
    assert picture(opened)[1] > 100


def test_it_goes_from_touch_to_touch_and_from_trial_to_trial(opened):
    said = opened.locator(".status").inner_text()
    opened.get_by_label("Touch", exact=True).fill("4")
    assert opened.locator(".status").inner_text() != said
    assert opened.locator(".status").inner_text().startswith("Touch 4")
    opened.get_by_label("Trial", exact=True).select_option("1")
    assert "block" in opened.locator("select").nth(1).inner_text()
