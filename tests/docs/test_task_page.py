"""The page of the tasks has a row for every task, as its file says, and names no task that there is not."""

import re

from pages import ROOT

from tactsim.bench.tasks import names, task

PAGE = ROOT / "docs" / "tasks.md"
TABLE = re.compile(r"<!-- tasks -->\n(.*?)<!-- end of tasks -->", re.DOTALL)


def rows():
    """Write the table of the tasks."""
    yield "| task | what is asked | letters | trials each | readings | figures, the first ranks | data |"
    yield "|---|---|---|---|---|---|---|"
    for name in names():
        one = task(name)
        figures = ", ".join(f"`{figure}`" for figure in one.scored)
        size = f"{len(one.letters)} | {len(one.seeds)} x {one.trials} | {one.readings}"
        yield f"| `{name}` | {one.line} | {size} | {figures} | `{one.data[:12]}` |"


def test_the_table_of_the_tasks_says_what_their_files_say():
    shown = TABLE.search(PAGE.read_text(encoding="utf-8"))[1]
    assert shown == "".join(f"{row}\n" for row in rows())


def test_every_version_that_a_page_names_exists():
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        if "_build" not in path.parts:
            named = re.findall(
                r"`((?:letters|glyphs36|worn|tilted|slip|open-set|active)[\w-]*-v\d+)`",
                path.read_text("utf-8"),
            )
            assert set(named) - {"letters-v2"} <= set(names()), path
