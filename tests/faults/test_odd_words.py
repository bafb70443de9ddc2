"""Odd words on the command line: each is one line and exit status 2, before any work is done."""

import inspect
import sys
from importlib import import_module

import pytest
from command_line import refused

from tactsim.bench.cli.app import VERBS, run_app

N = "9" * 30
SIMULATED = ["--port", "simulated:A@0,0,0"]
RECORD = ["record", *SIMULATED, "--out", "r.npz", "--letter", "A"]
SET = ("x", "gamma=nan", "cell=1e-9", f"split={N}x1x1")
PORTS = ("", "a\0", "recording:", "simulated:A@inf,0,0", "x:y")
ODD = [
    *(["run", "--noise", noise] for noise in ("nan", "-1", "loud")),
    *(["run", "--scan-set", f"press.force={force}"] for force in ("nan", "0", "1e999")),
    *(["run", "--bins", bins] for bins in (N, "0", "999999999999")),
    *(["run", "--set", word] for word in SET),
    ["run", "--letters", "IO", "--bins", "100", "--set", "reach=1e-300"],
    *(["run", option, N] for option in ("--trials", "--readings", "--seed")),
    ["run", "--estimator", "particle", "--particles", N],
    *(["run", "--letters", letters] for letters in ("\x1b[31m", "A,\0")),
    *(["run", "--scan", path] for path in (".", "/dev/zero", "a\0b", "none.npz")),
    *(["run", "--out", path] for path in ("x" * 5000, "/dev/null/x")),
    *(["run", "--world", path] for path in ("/dev/zero", "\x1b[31m")),
    *(["run", "--scan-set", f"pad={path}"] for path in ("/dev/zero", "none.toml")),
    *(["run", "--shape", path] for path in ("/dev/zero", "a\0.stl")),
    ["run", "--estimator", "\x1b[31m"],
    *(["scan", "--out", path] for path in ("/dev/null/x", ".")),
    *(["sweep", path] for path in ("", "/dev/zero")),
    *(["report", path] for path in ("/dev/null", "none")),
    ["compare", ".", "."],
    ["list", "\x1b[31m"],
    ["stress", "--case", "\x1b[31m"],
    *(["probe", "--port", port] for port in PORTS),
    ["tare", *SIMULATED, "--out", "t.toml", "--frames", N],
    ["tare", *SIMULATED, "--out", "t.toml", "--load", "nan", "--calibration", "none.toml"],
    *([*RECORD, "--poses", f"random:{n}"] for n in (N, "²", "0", "")),
    *([*RECORD, "--force", force] for force in ("nan:1", "5:1")),
    [*RECORD, "--patience", "nan"],
    [*RECORD, "--letter", "\x1b[31m"],
    *(["emulate", option, "nan"] for option in ("--rate", "--drop")),
    *(["emulate", "--letter", "A", "--pose", pose] for pose in ("nan,0,0", "1,2")),
    *(["emulate", "--port", port] for port in ("tcp:²", f"tcp:{N}", "udp")),
    *(["replay", "none.tactrec", "--scan", "s.npz", "--cut", cut] for cut in (f"{N}x1", "5")),
    ["replay", "/dev/zero"],
    ["validate", "--simulated", "none", "--recorded", "none"],
]  # fmt: skip


@pytest.mark.parametrize("words", ODD, ids=lambda words: ascii(" ".join(words))[:60])
def test_an_odd_word_is_refused_in_one_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TACTSIM_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "argv", ["bench", *words])
    with pytest.raises(SystemExit) as ended:
        run_app()
    said = capsys.readouterr().err
    assert ended.value.code == 2, said
    (line,) = (line for line in said.splitlines() if line.startswith("bench:"))
    assert "\x1b" not in line
    assert len(line) < 3000


@pytest.mark.parametrize(
    ("verb", "name"),
    [
        (verb, f"--{name}")
        for verb, file in VERBS.items()
        for name, option in inspect.signature(
            getattr(import_module(f"tactsim.bench.cli.{file}"), f"command_{verb}"), eval_str=True
        ).parameters.items()
        if "float" in str(option.annotation)
    ],
)
def test_an_option_that_takes_a_number_says_so_of_what_is_none(here, verb, name):
    for word in ("nan", "-inf"):
        refused(here(verb, name, word), name, "give a finite number", word)
