"""What the pages say to type is understood: every `bench` line, every `make` target."""

import re
import subprocess

import pytest
from pages import BLOCKS, ROOT, SHELL, bench, commands, only

from tactsim.bench import sweep
from tactsim.bench.cli.app import VERBS, load

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
