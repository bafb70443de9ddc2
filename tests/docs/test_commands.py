"""What the docs say to type works: README, docs/ and every other page.

Every `bench` line in a block for the shell is parsed by the command line itself, every `make` target
must exist, every Python block must compile, every link must lead somewhere. A block with the comment
`<!-- run -->` on the line before it is also run, its page's blocks one after the other in one folder,
with one trial of three readings and one run for each method of a sweep.
"""

import os
import re
import shlex
import subprocess
import sys
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from tactsim.bench import sweep_file
from tactsim.bench.cli.app import app

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", "results/*.md", "hardware/**/*.md")
    for page in ROOT.glob(pattern)
)
SHELL = ("", "sh", "bash", "console")
BENCH = Path(sys.executable).parent / "bench"


class Block(NamedTuple):
    """A fenced block: the page it is on, its line, its language, its text, and whether to run it."""

    page: str
    line: int
    language: str
    text: str
    run: bool


def blocks_of(name, text):
    for match in re.finditer(r"^( *)```(\w*)[^\n]*\n(.*?)^\1```", text, re.M | re.S):
        before = text[: match.start()].rstrip("\n").rpartition("\n")[2]
        line = text[: match.start()].count("\n") + 1
        yield Block(name, line, match[2], match[3], before.strip() == "<!-- run -->")


BLOCKS = [
    block
    for page in PAGES
    for block in blocks_of(str(page.relative_to(ROOT)), page.read_text(encoding="utf-8"))
]


def commands(block):
    """List a shell block's commands as lists of words: no prompts, outputs, comments or continuations."""
    text = block.text.replace("\\\n", " ")
    lines = text.splitlines()
    if block.language == "console":
        lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    found = []
    for line in lines:
        words = []
        lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;<>")
        lexer.whitespace_split = True
        for word in [*lexer, ";"]:
            if word and set(word) <= set("|&;"):
                found.append(words)
                words = []
            else:
                words.append(word)
    return [words for words in found if words]


def only(words, *names):
    """Leave out assignments in front and redirections behind; None if another program is called."""
    while words and re.fullmatch(r"\w+=.*", words[0]):
        words = words[1:]
    if not words or Path(words[0]).name not in names:
        return None
    end = next((i for i, word in enumerate(words) if set(word) <= set("<>")), len(words))
    return words[1:end]


def calls(name):
    """List what is given to a program, with the block in which it is called."""
    aliases = {"bench": ("bench", "tactsim-bench")}.get(name, (name,))
    return [
        pytest.param(arguments, id=f"{block.page}:{block.line} {' '.join(arguments)[:60]}")
        for block in BLOCKS
        if block.language in SHELL
        for words in commands(block)
        if (arguments := only(words, *aliases)) is not None
    ]


@pytest.mark.parametrize("arguments", calls("bench"))
def test_a_bench_command_is_understood(arguments):
    group = typer.main.get_command(app)
    if not arguments or arguments[0].startswith("-"):
        return
    verb, *rest = arguments
    assert verb in group.commands
    if not {"-h", "--help"} & set(rest):
        group.commands[verb].make_context(f"bench {verb}", list(rest))
    if verb == "sweep":
        assert rest[0] in sweep_file.suites() or rest[0].endswith(".toml")


@pytest.mark.parametrize("arguments", calls("make"))
def test_a_make_target_exists(arguments):
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
    for word in arguments:
        assert "=" in word or word in targets


@pytest.mark.parametrize(
    "block", [pytest.param(b, id=f"{b.page}:{b.line}") for b in BLOCKS if b.language == "python"]
)
def test_a_python_block_compiles(block):
    compile(block.text, f"{block.page}:{block.line}", "exec")


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


RUN_PAGES = list(dict.fromkeys(block.page for block in BLOCKS if block.run))


@pytest.mark.parametrize("page", RUN_PAGES)
def test_a_pages_commands_run(page, tmp_path, tmp_path_factory):
    cache = tmp_path_factory.getbasetemp() / "cache-of-docs"
    environment = os.environ | {"TACTSIM_CACHE_DIR": str(cache), "NO_COLOR": "1"}
    for block in BLOCKS:
        if block.page != page or not block.run:
            continue
        for words in commands(block):
            arguments = only(words, "bench", "tactsim-bench")
            assert arguments is not None, f"{page}:{block.line}: only bench commands are run here: {words}"
            result = subprocess.run(
                [BENCH, *smaller(arguments, tmp_path)], cwd=tmp_path, env=environment, text=True,
                capture_output=True, timeout=300, check=False,
            )  # fmt: skip
            assert result.returncode == 0, f"{page}:{block.line}: {' '.join(words)}\n{result.stderr}"


def smaller(arguments, folder):
    """Ask for the same with less work: few trials and readings, the first value of every list."""
    verb, *rest = arguments
    if verb == "run":
        return [verb, *without(rest, "--trials", "--readings", "--jobs"), "--trials", "1", "--readings", "3"]
    if verb == "sweep":
        source = rest[0]
        name = Path(source).stem
        content = (
            folder / source
            if source.endswith(".toml")
            else files("tactsim.bench") / "suites" / f"{source}.toml"
        )
        table = tomllib.loads(content.read_text(encoding="utf-8"))
        lines = ["[defaults]", *map(first, ({"letters": "AE"} | table.get("defaults", {}) | few()).items())]
        for run in table["run"]:
            lines += ["[[run]]", *map(first, (run | few()).items() if "trials" in run else run.items())]
        path = folder / "smaller" / f"{name}.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text("\n".join(lines))
        return [verb, str(path), *without(rest[1:], "--jobs"), "--jobs", "2"]
    return arguments


def few():
    return {"trials": 1, "readings": 3}


def first(item):
    """Write a key of a sweep with the first of its values."""
    name, value = item
    return f"{name} = {as_toml(value[0] if isinstance(value, list) else value)}"


def as_toml(value):
    if isinstance(value, dict):
        inner = {k: v[0] if isinstance(v, list) else v for k, v in value.items()}
        return "{ " + ", ".join(f"{k} = {as_toml(v)}" for k, v in inner.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(as_toml, value))}]"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def without(words, *options):
    """Leave options with one value out."""
    kept, skip = [], False
    for word in words:
        if skip:
            skip = False
        elif word in options:
            skip = True
        elif word.partition("=")[0] not in options:
            kept.append(word)
    return kept


def test_the_blocks_are_found():
    shell = "$ bench run --trials 5 \\\n    --bins 10  # few\nout\n$ A=1 bench list | head > x\n"
    text = f"say:\n\n<!-- run -->\n```console\n{shell}```\n"
    (block,) = blocks_of("page.md", text)
    assert block.run
    assert block.line == 4
    assert [only(words, "bench") for words in commands(block)] == [
        ["run", "--trials", "5", "--bins", "10"],
        ["list"],
        None,
    ]
    assert smaller(["run", "--trials", "5", "--bins=10"], None)[1:] == [
        "--bins=10",
        "--trials",
        "1",
        "--readings",
        "3",
    ]
