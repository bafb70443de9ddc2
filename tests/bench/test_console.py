import io

import pytest
from rich.table import Table

from tactsim.bench.console import plain_console

EVIL = "[bold red]x[/] [/nothing] \x1b]0;title\x07 \x1b[2J :smile: \u202e"


def test_text_from_a_file_is_shown_as_it_is_written():
    console = plain_console()
    console.file = io.StringIO()
    table = Table(box=None)
    table.add_column(EVIL, overflow="fold")
    table.add_row(EVIL)
    console.print(table)
    console.print(EVIL)
    console.print(EVIL, style="bold")
    shown = console.file.getvalue()
    assert "\x1b" not in shown
    assert "\x07" not in shown
    assert "\u202e" not in shown
    assert shown.replace("\n", "").count("[bold red]x[/] [/nothing]") == 4
    assert ":smile:" in shown


@pytest.mark.parametrize("width", [20, 40, 60, 80])
def test_no_figure_and_no_word_of_a_table_is_cut(width):
    console = plain_console()
    console.file, console.width = io.StringIO(), width
    table = Table(box=None, pad_edge=False)
    table.add_column("what", overflow="fold")
    for heading in ("readings", "95 % interval", "90 % in mm", "held"):
        table.add_column(heading, justify="right")
    table.add_row("sensor_noise=0.5, and the rest of it", "1", "0.301 - 0.954", "7.36", "1.00")
    console.print(table)
    shown = console.file.getvalue()
    for words in ("sensor_noise=0.5,", "readings", "interval", "0.301 - 0.954", "7.36", "1.00"):
        assert words in shown
    assert width < 60 or max(map(len, shown.splitlines())) <= width
