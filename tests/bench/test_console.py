import io

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
