"""The report in a real browser: headless Chromium, opened from disk."""

import pytest
from browser import browser, needs_browser

from tactsim.bench.report.write import write_report

pytestmark = [pytest.mark.long, needs_browser]


@pytest.fixture(scope="module")
def context(tmp_path_factory):
    with browser(tmp_path_factory.mktemp("profile")) as context:
        yield context


@pytest.fixture(scope="module")
def path(runs, tmp_path_factory):
    out = tmp_path_factory.mktemp("page") / "report.html"
    write_report([runs.small, runs.large, runs.off_grid], out)
    return out


@pytest.fixture
def open_page(context):
    """Open a page; at the end of the test nothing may have been logged, thrown or asked of a network."""
    pages, faults = [], []

    def open_one(path, width=1280, scheme="light", motion="no-preference"):
        page = context.new_page()
        pages.append(page)
        page.set_viewport_size({"width": width, "height": 800})
        page.emulate_media(color_scheme=scheme, reduced_motion=motion)
        page.on("console", lambda message: faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("dialog", lambda dialog: (faults.append(dialog.message), dialog.dismiss()))
        page.on(
            "request",
            lambda request: request.url.startswith(("file:", "data:", "blob:")) or faults.append(request.url),
        )
        page.goto(path.as_uri())
        page.wait_for_selector("html[data-ready]")
        page.wait_for_selector("svg.plot", state="attached")
        return page

    yield open_one
    for page in pages:
        page.close()
    assert faults == []


PICTURES = """() => ({
    scene: document.querySelector('svg.scene').outerHTML,
    tactile: document.querySelector('svg.tactile').outerHTML,
    letters: document.querySelector('.bars').textContent,
    history: document.querySelector('svg.history .here').outerHTML,
    plane: [...document.querySelectorAll('.planes canvas')].map((canvas) => canvas.toDataURL()).join(),
    status: document.querySelector('.status').textContent,
})"""


def test_a_page_opens_without_a_complaint(open_page, path):
    page = open_page(path)
    assert page.locator("section.protocol").count() == 2
    assert "[object" not in page.locator("body").inner_text()
    shapes = page.locator("table.values").evaluate_all(
        "tables => tables.map(table => [...table.rows].map(row => row.cells.length))"
    )
    assert len(shapes) >= 4
    assert all(len(set(widths)) == 1 and len(widths) > 1 for widths in shapes), shapes  # a head for each cell


def test_the_slider_moves_by_keyboard_and_everything_follows(open_page, path):
    page = open_page(path)
    slider = page.locator("section.protocol").first.get_by_role("slider", name="Reading", exact=True)
    slider.focus()
    before = page.evaluate(PICTURES)
    slider.press("ArrowRight")
    after = page.evaluate(PICTURES)
    assert slider.input_value() == "2"
    assert slider.get_attribute("aria-valuetext") == "reading 2 of 8"
    for name in before:
        assert before[name] != after[name], name
    slider.press("ArrowLeft")
    assert page.evaluate(PICTURES) == before
    slider.press("End")
    assert page.evaluate(PICTURES)["status"].startswith("After reading 8")


def test_buttons_step_and_play(open_page, path):
    from playwright.sync_api import expect

    page = open_page(path, motion="reduce")
    first = page.locator("section.protocol").first
    first.get_by_role("button", name="Next reading").click()
    slider = first.get_by_role("slider", name="Reading", exact=True)
    assert slider.input_value() == "2"
    first.get_by_role("button", name="Previous reading").press("Enter")
    assert slider.input_value() == "1"
    play = first.get_by_role("button", name="Play")
    play.click()
    expect(first.locator(".status")).to_contain_text("After reading 3:")
    first.get_by_role("button", name="Pause").click()
    assert first.get_by_role("button", name="Play").get_attribute("aria-pressed") == "false"


def test_curves_can_be_hidden_and_read_by_keyboard(open_page, path):
    page = open_page(path)
    first = page.locator("section.protocol").first
    plots = [
        first.locator("figure.chart").filter(has_text=title).locator("svg.plot")
        for title in ("Share of trials right", "Placement error where the letter is right")
    ]
    of_runs = [[plot.locator(f".run-{i}").last for i in range(2)] for plot in plots]
    assert all(one.is_visible() for of_plot in of_runs for one in of_plot)
    first.get_by_role("checkbox", name="histogram, 100 bins").press("Space")
    assert [[one.is_visible() for one in of_plot] for of_plot in of_runs] == [[False, True]] * 2
    slider = first.get_by_role("slider", name="Values at reading")
    values = first.get_by_role("region", name="Values at the chosen reading")
    slider.press("Home")
    at_one = values.inner_text()
    slider.press("End")
    assert values.inner_text() != at_one


def test_a_heading_sorts_its_table(open_page, path):
    page = open_page(path)
    region = page.get_by_role("region", name="Headline figures of every run").first
    heading = region.get_by_role("button", name="error after 8, mm")
    cells = region.locator("tbody td:nth-child(10)")
    for order in ("ascending", "descending"):
        heading.press("Enter")
        errors = [float(text.split("\n")[0]) for text in cells.all_inner_texts()]
        assert errors == sorted(errors, reverse=order == "descending")
        assert region.locator(f"th[aria-sort={order}]").inner_text().startswith("error after 8")


def test_the_confusion_matrix_follows_its_slider(open_page, path):
    page = open_page(path)
    first = page.locator("section.protocol").first
    first.get_by_label("Runs").select_option(label="histogram, 100 bins")
    matrix = first.locator("table.confusion")
    slider = first.get_by_role("slider", name="After reading")
    seen = []
    for key in ("End", "Home"):
        slider.press(key)
        seen.append(matrix.inner_text())
        assert sum(int(text) for text in matrix.locator("td").all_inner_texts() if text.isdigit()) == 12
    assert seen[0] != seen[1]


BOXES = "all => all.map((one) => one.getBoundingClientRect().toJSON())"


def inside(box, other, room=1.0):
    return all(box[side] >= other[side] - room for side in ("left", "top")) and all(
        box[side] <= other[side] + room for side in ("right", "bottom")
    )


@pytest.mark.parametrize("width", [360, 1280])
def test_nothing_scrolls_sideways_or_is_cut(open_page, path, width):
    page = open_page(path, width=width)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    for plot in page.locator("svg.plot").all():
        (whole,) = plot.evaluate_all(BOXES)
        texts = plot.locator("text").evaluate_all(BOXES)
        assert texts
        assert all(inside(one, whole, room=3.0) for one in texts)
    view = page.locator("section.protocol").last
    slider = view.get_by_role("slider", name="Reading", exact=True)
    for _ in range(4):  # first estimates lie far off
        (scene,), (guess,) = (view.locator(what).evaluate_all(BOXES) for what in ("svg.scene", ".ghost"))
        assert inside(guess, scene)
        slider.press("ArrowRight")


INK = "Number(getComputedStyle(document.querySelector('svg.plot text')).fill.match(/\\d+/)[0])"
LIGHTNESS = "Number(getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0])"


def test_the_theme_is_the_systems_until_one_is_chosen_and_paper_is_light(open_page, path):
    page = open_page(path, scheme="dark")
    assert page.evaluate(LIGHTNESS) < 60
    dark_map = page.evaluate("document.querySelector('.maps canvas').toDataURL()")
    assert page.evaluate(INK) > 140  # of a plot's texts
    page.get_by_label("Theme").select_option("light")
    assert page.evaluate(LIGHTNESS) > 200
    assert page.evaluate(INK) < 120
    light_map = page.evaluate("document.querySelector('.maps canvas').toDataURL()")
    assert light_map != dark_map
    page.get_by_label("Theme").select_option("dark")
    assert page.evaluate("document.querySelector('.maps canvas').toDataURL()") == dark_map
    page.emulate_media(media="print")
    page.wait_for_function(
        "(light) => document.querySelector('.maps canvas').toDataURL() === light", arg=light_map
    )
    assert page.evaluate("Number(getComputedStyle(document.body).color.match(/\\d+/)[0])") < 60


NAMELESS = """() => {
    const all = (selector) => [...document.querySelectorAll(selector)];
    return [
        ...all('input, select').filter((one) => !one.labels.length),
        ...all('button').filter((one) => !(one.getAttribute('aria-label') || one.textContent.trim())),
        ...all('[role=img], [role=group], [role=region]').filter((one) => !one.getAttribute('aria-label')),
        ...all('canvas, svg').filter((one) => !one.closest('[role], [aria-hidden=true]')),
        ...all('table').filter((one) => !one.querySelector('th[scope=col]') || !one.querySelector('th[scope=row]')),
    ].map((one) => one.outerHTML.slice(0, 200));
}"""


def test_everything_has_a_name(open_page, path):
    assert open_page(path).evaluate(NAMELESS) == []
