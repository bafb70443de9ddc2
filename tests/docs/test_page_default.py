"""The tables of the default, filled by the command that a page's maker types."""

import numpy as np
import page_default
import pytest

from tactsim.bench.runs.saved import load

PAGE = """Before.

<!-- default: smoke-v1 1 -->
what stood here
<!-- end of default -->

Behind.
"""
METHODS = {"BASELINE": "whole-image", "CHOICE": ("bag-of-features", "nearest"), "DEFAULT": "histogram"}


@pytest.mark.long
def test_a_page_is_filled_from_runs_on_other_seeds_and_none_is_done_again(tmp_path, monkeypatch, capsys):
    page, words = tmp_path / "page.md", [str(tmp_path / "runs"), str(tmp_path / "page.md")]
    page.write_text(PAGE)
    monkeypatch.setattr(page_default, "SEEDS", range(7, 9))
    for name, value in METHODS.items():
        monkeypatch.setattr(page_default, name, value)
    assert page_default.main(words) == 0
    text = page.read_text()
    assert text.startswith("Before.\n\n<!-- default: smoke-v1 1 -->\n| task")
    assert text.endswith("<!-- end of default -->\n\nBehind.\n")
    assert "seeds 7 to 8" in text
    head, _, *rows = (line for line in text.splitlines() if line.startswith("|"))
    columns = [cell.strip() for cell in head.strip("|").split("|")]
    assert columns[2:] == [
        "whole-image",
        "bag-of-features",
        "nearest",
        "histogram",
        "less the best of the three",
    ]

    for row in rows:
        task, figure, *cells, less = (cell.strip() for cell in row.strip("|").split("|"))
        assert task == ("smoke-v1, 6 trials" if row is rows[0] else "")
        runs = {
            method: [load(tmp_path / "runs" / f"smoke-v1--{method}--{seed}") for seed in (7, 8)]
            for method in columns[2:-1]
        }
        reading = int(figure.rpartition("after ")[2].partition(",")[0]) - 1
        of = {
            method: np.concatenate([
                run.trials.right[:, reading] if "right" in figure else run.scored.error[:, reading]
                for run in of
            ]).astype(float)
            for method, of in runs.items()
        }  # fmt: skip
        placed = [method for method in METHODS["CHOICE"] if not np.isnan(of[method]).any()]
        sign = 1 if "right" in figure else -1
        best = max(placed, key=lambda method: sign * of[method].mean())
        assert cells == ["-" if np.isnan(one).any() else f"{one.mean():.3f}" for one in of.values()]
        assert less.startswith(f"{of['histogram'].mean() - of[best].mean():+.3f} (")
    assert len(rows) == 2

    capsys.readouterr()
    assert page_default.main(words) == 0
    assert capsys.readouterr().err == ""  # which names each run that is done
    assert page.read_text() == text


def test_a_task_that_is_not_there_is_refused_in_one_line(tmp_path, capsys):
    (tmp_path / "page.md").write_text(PAGE.replace("smoke-v1", "smoke-v9"))
    assert page_default.main([str(tmp_path / "runs"), str(tmp_path / "page.md")]) == 2
    assert "smoke-v9" in capsys.readouterr().err
