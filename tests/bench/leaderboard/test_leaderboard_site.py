"""The leaderboard as a page: from the disk, in a real browser, and by the command that makes it."""

import csv
import shutil
from html.parser import HTMLParser
from urllib.parse import unquote

import pytest
from browser import browser, needs_browser
from command_line import refused
from entered import entered, record_of

from tactsim.bench.leaderboard import site as sites
from tactsim.bench.leaderboard.bundle import write_bundle
from tactsim.bench.leaderboard.site import write_site
from tactsim.bench.leaderboard.standings import read_folder
from tactsim.core import InputError

TASK = "active-v1"
HOSTILE = '<script>document.title="harmed"</script>'
IMAGE = '"><img src=x onerror="document.title=1">'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three methods with a score, one of them hostile to the brim; one without, one of other data, one unreadable."""
    place = tmp_path_factory.mktemp("bundles")
    hostile = {
        "package": IMAGE, "versions": {HOSTILE: IMAGE}, "commit": HOSTILE, "made": IMAGE,
        "machine": {"processor": HOSTILE, "cores": 1, "system": IMAGE}, "options": {IMAGE: HOSTILE},
    }  # fmt: skip
    bundles = {
        "good": entered("good", TASK, skill=2.5, mm=0.1, bounds=True),
        "fair": entered("fair", TASK, mm=1.0),
        "<b> &amp;%41": entered(HOSTILE, TASK, skill=0.7, mm=6.0, **hostile),
        "stuck": entered("stuck", TASK, status=f"timed out {IMAGE}"),
        "old": entered("old", TASK, task_data="d" * 64),
    }
    for name, bundle in bundles.items():
        write_bundle(bundle, place / f"{name}.tar.xz")
    record_of(place / "good.tar.xz", said=f"all the same {IMAGE}")
    (place / "cut.tar.xz").write_bytes((place / "good.tar.xz").read_bytes()[:500])
    return place


@pytest.fixture(scope="module")
def found(folder):
    return read_folder(folder)


@pytest.fixture(scope="module")
def site(found, tmp_path_factory):
    out = tmp_path_factory.mktemp("made") / "site"
    write_site(found, out)
    return out


class Reader(HTMLParser):
    """Collect what a page links to, which tags it has, and its text."""

    def __init__(self, page):
        super().__init__()
        self.links, self.tags, self.words = [], [], []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in ("href", "src", "srcset")]
        assert not [name for name, _ in attributes if name.startswith("on") or name == "style"]

    def handle_data(self, data):
        self.words.append(data)


def pages_of(site):
    return sorted(site.rglob("*.html"))


@pytest.mark.long
def test_every_link_leads_to_a_file_and_none_to_a_network(site):
    pages = pages_of(site)
    assert len(pages) == 1
    for page in pages:
        for link in Reader(page).links:
            if link.startswith(("data:", "#")):
                continue
            assert ":" not in link, (page, link)
            assert (page.parent / unquote(link)).is_file(), (page, link)


def test_no_name_becomes_markup(site):
    for page in pages_of(site):
        tags = Reader(page).tags
        assert tags.count("script") == 1, page  # the page's own
        assert tags.count("svg") == 2, page  # a picture a task


def test_the_tables_are_there_as_csv(found, site):
    def rows(name):
        return list(csv.DictReader((site / name).read_text(encoding="utf-8").splitlines()))

    figures = [
        row for row in rows("figures.csv") if row["method"] == "good" and row["figure"] == "error_all_mm@10"
    ]
    (one,) = figures
    figure = found.standings[0].ranked[0].figure("error_all_mm@10")
    assert [float(one[name]) for name in ("value", "low", "high")] == [figure.value, figure.low, figure.high]
    assert (one["rank_best"], one["rank_worst"], one["trials"], one["scans"]) == ("1", "1", "250", "5")


@pytest.mark.long
def test_the_same_bundles_give_the_same_bytes_and_replace_the_site(folder, site, tmp_path):
    out = tmp_path / "site"
    shutil.copytree(site, out)
    (out / "bundles" / "gone.tar.xz").write_text("a method that was taken out")
    write_site(read_folder(folder), out)
    assert [path.name for path in tmp_path.iterdir()] == ["site"]

    def content(of):
        return {path.relative_to(of): path.read_bytes() for path in of.rglob("*") if path.is_file()}

    assert content(out) == content(site)


def test_a_folder_of_something_else_is_left_alone(found, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="the folder holds something already"):
        write_site(found, tmp_path)
    with pytest.raises(InputError, match="that is a file"):
        write_site(found, tmp_path / "thesis.tex")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


def test_a_site_that_could_not_be_made_whole_leaves_the_one_before(found, site, monkeypatch, tmp_path):
    out = tmp_path / "site"
    shutil.copytree(site, out)
    before = sorted(out.rglob("*"))
    monkeypatch.setattr(sites, "render", lambda *words, **more: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_site(found, out)
    assert [path.name for path in tmp_path.iterdir()] == ["site"]
    assert sorted(out.rglob("*")) == before


def test_the_command_says_where_the_site_is_and_what_could_not_be_read(folder, here, tmp_path):
    (tmp_path / "mine").mkdir()
    for name in ("stuck.tar.xz", "cut.tar.xz"):
        shutil.copy(folder / name, tmp_path / "mine")
    made = here("leaderboard", "mine")
    assert (made.returncode, made.stdout) == (1, "site  mine/site/index.html\n")
    assert [line.partition(":")[0] for line in made.stderr.splitlines() if "bundles" not in line] == [
        "unreadable  cut.tar.xz"
    ]
    (tmp_path / "mine" / "cut.tar.xz").unlink()
    assert here("leaderboard", "mine").returncode == 0
    refused(here("leaderboard", "mine/site", "--out", "other"), "mine/site holds no bundle (*.tar.xz)")
    refused(here("leaderboard", "mine", "--out", "board.html"), "a site is a folder")
    assert not (tmp_path / "other").exists()


@pytest.mark.long
@needs_browser
def test_pages_open_from_a_disk_in_any_width_and_light(site, tmp_path):
    faults = []
    with browser(tmp_path / "profile") as context:
        for scheme, width in (("light", 1280), ("dark", 360)):
            for path in (site / "index.html",):
                page = context.new_page()
                page.set_viewport_size({"width": width, "height": 800})
                page.emulate_media(color_scheme=scheme)
                page.on("console", lambda message: faults.append(message.text))
                page.on("pageerror", lambda error: faults.append(str(error)))
                page.on(
                    "request",
                    lambda request: request.url.startswith(("file:", "data:")) or faults.append(request.url),
                )
                page.goto(path.as_uri())
                assert "harmed" not in page.title() or "<script>" in page.title()
                assert page.evaluate("document.documentElement.scrollWidth") == width, path
                assert all(one.is_visible() for one in page.locator("svg.plot text").all()), path
                page.close()
    assert faults == []
