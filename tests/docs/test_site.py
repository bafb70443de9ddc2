"""What pages and pictures say of the source is so, and the site that is built needs no network."""

import re
import subprocess
import sys

import pytest
from pages import BLOCKS, PAGES, ROOT, SHELL, bench, commands, only

from tactsim.bench import sweep
from tactsim.bench.cli.app import VERBS, load
from tactsim.bench.tasks import names, task
from tactsim.estimators.registry import BUILT_IN

DOCS = ROOT / "docs"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_and_folders_that_a_page_names_exist(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
    tops = "bench|docs|estimators|hardware|models|tactsim|tests"
    for path in re.findall(rf"`((?:{tops})/[\w./-]*)`", text):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("name", BUILT_IN)
def test_a_reader_who_chooses_hears_of_every_estimator(name):
    assert f"`{name}`" in (DOCS / "choose-an-estimator.md").read_text(encoding="utf-8")


def test_the_table_of_the_tasks_says_what_their_files_say():
    page = (DOCS / "tasks.md").read_text(encoding="utf-8")
    rows = []
    for name in names():
        asked = task(name)
        size = f"{len(asked.seeds)} x {asked.trials} | {asked.readings}"
        rows.append(f"| `{name}` | {asked.line} | {size} | `{asked.scored[0]}` |")
    assert re.findall(r"^\| `[\w-]+` \|.*", page, re.M) == rows


def test_the_picture_of_the_rooms_shows_who_imports_whom():
    picture = (DOCS / "pictures" / "rooms.svg").read_text(encoding="utf-8")
    rooms = set(re.findall(r'data-room="(\w+)"', picture))
    imported = {
        (room, other)
        for room in rooms
        for path in (ROOT / "tactsim" / room).rglob("*.py")
        for other in re.findall(
            r"^\s*(?:from|import) tactsim(?:\.| import )(\w+)", path.read_text("utf-8"), re.M
        )
        if other in rooms - {room}
    }
    assert set(re.findall(r'data-from="(\w+)" data-to="(\w+)"', picture)) == imported


@pytest.mark.slow
def test_the_site_is_built_and_asks_for_nothing_from_a_network(tmp_path):
    pytest.importorskip("myst_nb", reason="`make docs` installs what builds the site")
    words = ["--quiet", "--fail-on-warning", "-D", "nb_execution_mode=off", "-d", tmp_path / "doctrees"]
    subprocess.run([sys.executable, "-m", "sphinx", *words, DOCS, tmp_path / "site"], check=True)
    pages = sorted((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loaded = re.findall(r"<(?:script|img|source|iframe)[^>]* src(?:set)?=\"([^\"]*)\"", text)
        loaded += re.findall(r"<link[^>]* href=\"([^\"]*)\"[^>]*>", text)
        assert not [url for url in loaded if re.match(r"(?:https?:)?//", url)], page
        assert "from the source:" not in text, page
        assert "In a clone these lines" not in text, page
    for sheet in (tmp_path / "site").rglob("*.css"):
        assert not re.search(r"url\(['\"]?(?:https?:)?//|@import", sheet.read_text(encoding="utf-8")), sheet
    # Of intervals in tables both ends stay on one line, and hyphens of what is typed are as they are.
    results = (tmp_path / "site" / "results.html").read_text(encoding="utf-8")
    cells = re.findall(r"<td>(.*?)</td>", results, flags=re.S)
    assert any(re.search(r"\d-\u2060\d", cell) for cell in cells)
    assert not any(re.search(r"\d-\d", re.sub(r"<code.*?</code>", "", cell, flags=re.S)) for cell in cells)
    assert "\u2060" not in "".join(re.findall(r"<pre>.*?</pre>", results, flags=re.S))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    text = re.sub(r"```.*?```|`[^`]*`", "", page.read_text(encoding="utf-8"), flags=re.S)
    for target in re.findall(r"\]\(([^)\s]+)\)|(?:src|href|srcset)=\"([^\"]+)\"", text):
        link = target[0] or target[1]
        if re.match(r"\w+:", link):
            continue
        path, _, anchor = link.partition("#")
        goal = (page.parent / path) if path else page
        assert goal.exists(), link
        if anchor:
            assert anchor in anchors(goal.read_text(encoding="utf-8")), link


def anchors(text):
    """Name the headings as GitHub does."""
    headings = re.findall(r"^#+ +(.*)", text, re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


SHELL_COMMANDS = [(block, words) for block in BLOCKS if block.language in SHELL for words in commands(block)]


def calls(find):
    """List what is given to a program, with the block in which it is called."""
    return [
        pytest.param(arguments, id=f"{block.page}:{block.line} {' '.join(arguments)[:60]}")
        for block, words in SHELL_COMMANDS
        if (arguments := find(words)) is not None
    ]


@pytest.mark.parametrize("arguments", calls(bench))
def test_a_bench_command_is_understood(arguments):
    if not arguments or arguments[0].startswith("-"):
        return
    verb, *rest = arguments
    assert verb in VERBS
    if not {"-h", "--help"} & set(rest):
        load(verb).make_context(f"bench {verb}", list(rest))
    if verb == "sweep":
        assert rest[0] in sweep.suites() or rest[0].endswith(".toml")


@pytest.mark.parametrize("arguments", calls(lambda words: only(words, "make")))
def test_a_make_target_exists(arguments):
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    for word in arguments:
        assert "=" in word or word in targets


def test_the_site_can_be_built_in_a_fresh_clone(tmp_path):
    """The tutorials import what only the extras bring."""
    words = ["make", "--dry-run", "docs", f"VENV={tmp_path}"]
    steps = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert 0 < steps.find("-r requirements-dev.lock") < steps.find("sphinx-build")
