"""Recognition as a page in a real browser: what is asked for, what is believed, and the buttons."""

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


def test_beliefs_follow_the_touches(served, tmp_path):
    url, leading = served
    with browser(tmp_path) as context:
        page, faults = context.new_page(), []
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
