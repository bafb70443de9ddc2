"""Pages of a pad and of recognition in a real browser: live, lost, back, tared, gone; what is asked for, believed."""

import re

import numpy as np
import pytest
from browser import browser, expect, needs_browser

from tactsim.bench.pad.simulated_hand import SimulatedHand
from tactsim.bench.watching import PadReader
from tactsim.bench.watching.belief_words import BeliefWords
from tactsim.bench.watching.recogniser import Recogniser, on_taxels
from tactsim.bench.watching.touch_leader import TouchLeader
from tactsim.bench.watching.web import WebPage
from tactsim.core import Scan
from tactsim.estimators import create
from tactsim.hardware.session import Plan
from tactsim.models import letter

pytestmark = [pytest.mark.long, needs_browser]
PICTURE = "document.getElementById('picture').toDataURL()"
RAMP = np.arange(36.0)


@pytest.fixture(scope="module")
def context(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as context:
        yield context


@pytest.fixture
def opened(context, source, device):
    """Open the page of a pad; at the end of the test nothing may have been thrown or asked of another place."""
    faults = []
    page = context.new_page()
    page.on("pageerror", lambda error: faults.append(str(error)))
    with PadReader(source, device, "here") as reader, WebPage(reader, 0, from_behind=True) as web:
        page.on("request", lambda request: request.url.startswith(web.url) or faults.append(request.url))
        page.on("console", lambda message: faults.append(message.text))
        page.goto(web.url)
        page.wait_for_selector("html[data-ready]")
        yield page, reader
        page.close()
    assert faults == []


def state(page, word):
    page.wait_for_selector(f"#state[data-state={word}]")


def test_the_picture_follows_the_pad_and_is_gone_when_the_pad_is_lost(opened, source, silence):
    page, _ = opened
    source.feed(RAMP)
    state(page, "live")
    expect(page.locator("#largest")).to_have_text("35.0")
    assert page.inner_text("#force") == "2.04"
    shown = page.evaluate(PICTURE)
    silence(0.3)
    state(page, "lost")
    expect(page.locator("#veil")).to_contain_text("the cable is off")
    assert page.locator("#veil").is_visible()
    assert page.evaluate(PICTURE) != shown
    assert page.inner_text("#force") == "–"
    silence(1000.0)
    source.feed(RAMP)
    state(page, "live")
    assert page.locator("#veil").is_hidden()


def test_a_click_takes_a_tare_and_the_pointer_reads_a_taxel(opened, source, fed):
    page, _ = opened
    with fed(source, 5 + 0.1 * np.random.default_rng(0).standard_normal((1000, 36))):
        page.get_by_role("button", name="Tare").click()
        expect(page.locator("#message")).to_contain_text("taking")
        expect(page.locator("#message")).to_contain_text("tared")
    page.keyboard.press("f")
    box = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + 0.93 * box["width"], box["y"] + 0.93 * box["height"])
    expect(page.locator("#readout")).to_contain_text(re.compile(r"taxel 0\b.*, row 0, column 0"))
    page.get_by_role("button", name="As seen from above").click()
    page.mouse.move(box["x"] + 0.93 * box["width"], box["y"] + 0.92 * box["height"])
    expect(page.locator("#readout")).to_contain_text(re.compile(r"taxel 5\b.*, row 0, column 5"))


def test_when_the_program_ends_the_page_says_so(context, source, device):
    page = context.new_page()
    with PadReader(source, device, "here") as reader, WebPage(reader, 0, from_behind=True) as web:
        page.goto(web.url)
        page.wait_for_selector("html[data-ready]")
        source.feed(RAMP)
        state(page, "live")
    state(page, "gone")
    assert page.inner_text("#force") == "–"
    page.close()


POSES = ((0.0, 4.0, 0.0), (0.0, -4.0, 0.0))


@pytest.fixture
def served(device, scan_file):
    train = on_taxels(Scan.load(scan_file), device.pad.taxel_xy, "x")
    estimator = create("histogram", bins=1000)
    recogniser = Recogniser.fitted(estimator, train, 0)
    place = np.array([1.0, 0.5, 0.4])
    hidden = SimulatedHand(letter("I"), np.array(POSES), device, 0, place)
    plan = Plan(label="live", poses=POSES, frames=5, window=5, patience=1.0, touch_kpa=10.0)
    leading = TouchLeader(recogniser, plan, device.pad, "random", 0, hidden)
    words = BeliefWords(leading, train, estimator.maps, hidden, from_behind=True)
    reader = PadReader(hidden, device, "here", on_reading=leading.take)
    page = WebPage(
        reader, 0, from_behind=True, about=words.about(), more=words.event, commands=leading.commands()
    )
    with leading, reader, page:
        yield page.url, leading


def test_beliefs_follow_the_touches(context, served):
    (url, leading), page, faults = served, context.new_page(), []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("console", lambda message: faults.append(message.text))
    page.goto(url)
    expect(page.locator("#details")).to_contain_text("after 2 touches; ", timeout=90_000)
    expect(page.locator("#phase")).to_contain_text("every pose was tried")
    expect(page.locator("#verdict")).to_contain_text("I, ")
    assert page.locator(".bars .bar-row").count() == 2
    assert page.locator(".scene path.object").count() == 1
    assert page.locator(".scene .earlier, .scene .current").count() == 2
    page.get_by_role("button", name="Redo the last").click()
    expect(page.locator(".scene .ghost")).to_be_attached()
    expect(page.locator("#phase")).to_contain_text("every pose was tried", timeout=90_000)
    assert len(leading.beliefs) == 3
    for width in (390, 1280):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") == width
    assert faults == []
    page.close()
