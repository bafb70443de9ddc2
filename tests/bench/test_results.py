import ast
import json
import re
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from made_up import make_run

from tactsim.bench.machine import peak_memory_mb
from tactsim.bench.results import save
from tactsim.bench.runs.saved import load
from tactsim.bench.trials import Trials
from tactsim.core import InputError


def test_what_is_saved_is_loaded_to_the_bit(tmp_path):
    run = make_run()
    save(run, tmp_path)
    again = load(tmp_path)
    for field in fields(Trials):
        assert np.array_equal(getattr(again.trials, field.name), getattr(run.trials, field.name))
    for name in ("config", "about", "objects", "work", "summary", "times"):
        assert getattr(again, name) == getattr(run, name)


def test_the_same_run_gives_the_same_bytes(tmp_path):
    for name in "ab":
        (tmp_path / name).mkdir()
        save(make_run(), tmp_path / name)
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def _change(folder, change):
    about = json.loads((folder / "run.json").read_text())
    change(about)
    (folder / "run.json").write_text(json.dumps(about))


DAMAGES = {
    "no run.json": lambda f: (f / "run.json").unlink(),
    "no table": lambda f: (f / "trials.csv").unlink(),
    "row lost": lambda f: (f / "trials.csv").write_bytes(
        (f / "trials.csv").read_bytes().rpartition(b"\nA")[0]
    ),
    "word for a number": lambda f: (f / "trials.csv").write_bytes(
        (f / "trials.csv").read_bytes().replace(b",2,", b",two,")
    ),
    "no protocol": lambda f: _change(f, lambda about: about.pop("protocol")),
    "schema of another version": lambda f: _change(f, lambda about: about.update(schema=1)),
    "letter without properties": lambda f: _change(f, lambda about: about["objects"].pop("A")),
    "inertia is nan": lambda f: _change(
        f, lambda about: about["objects"]["A"].update(inertia_over_mass=float("nan"))
    ),
}


@pytest.mark.parametrize("kind", DAMAGES)
def test_a_folder_that_is_no_whole_run_is_refused_in_one_line(tmp_path, kind):
    save(make_run(), tmp_path)
    DAMAGES[kind](tmp_path)
    with pytest.raises(InputError) as caught:
        load(tmp_path)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="there is no such folder"):
        load(tmp_path / "none")


@pytest.mark.long
def test_the_lines_that_the_readme_shows_read_a_run(tmp_path):
    import duckdb
    import pandas
    import polars

    run = make_run()
    save(run, tmp_path)
    text = (Path(__file__).parents[2] / "results" / "README.md").read_text(encoding="utf-8")
    block = re.search("```python\n(.*?)```", text, re.S)[1].replace("RUN", str(tmp_path))
    lines = [ast.unparse(statement) for statement in ast.parse(block).body]
    assert [line.partition(".")[0] for line in lines] == ["pandas", "polars", "duckdb"]
    libraries = {"pandas": pandas, "polars": polars, "duckdb": duckdb}
    counts, shares, rows = (eval(line, libraries) for line in lines)
    accuracy = run.trials.right.mean(axis=0)
    n = len(run.trials.truth)
    assert [counts.get(k, 0) / n for k in range(1, 5)] == pytest.approx(accuracy)
    assert shares.sort("reading_number")["label"].to_list() == pytest.approx(accuracy)
    assert [share for _, share in rows.fetchall()] == pytest.approx(accuracy)


def test_peak_memory_is_in_megabytes():
    resource = pytest.importorskip("resource")
    unit = 1 if sys.platform == "darwin" else 1024  # bytes
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    assert before <= peak_memory_mb() <= 1.01 * before
