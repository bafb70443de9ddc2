"""What the documentation's pages hold: their fenced blocks, and the commands in them."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page
    for pattern in ("*.md", "docs/**/*.md", "results/*.md", "hardware/**/*.md")
    for page in ROOT.glob(pattern)
    if "_build" not in page.parts
)
SHELL = ("sh", "console")


class Block(NamedTuple):
    """A fenced block: its page, the line it begins on, its language, its text, and the mark on the line before it.

    A mark is a comment, which readers do not see: `<!-- not run: REASON -->`, or `<!-- file: NAME -->` for a block
    that shows a whole file, which the commands after it find under that name.
    """

    page: str
    line: int
    language: str
    text: str
    not_run: str | None = None
    file: str | None = None


def blocks_of(name, text):
    """List the blocks of one page."""
    for match in re.finditer(r"^( *)```([\w{}-]*)[^\n]*\n(.*?)^\1```", text, re.M | re.S):
        before = text[: match.start()].rstrip("\n").rpartition("\n")[2]
        mark = re.fullmatch(r"\s*<!-- (not run|file): (.+) -->", before)
        marks = {mark[1].replace(" ", "_"): mark[2]} if mark else {}
        yield Block(name, text[: match.start()].count("\n") + 1, match[2], match[3], **marks)


BLOCKS = [
    block
    for page in PAGES
    for block in blocks_of(str(page.relative_to(ROOT)), page.read_text(encoding="utf-8"))
]


def commands(block):
    """List a shell block's commands as lists of words: no prompts, outputs, comments or continuations."""
    lines = block.text.replace("\\\n", " ").splitlines()
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


def bench(words):
    """Return what is given to the command line, or None if another program is called."""
    return only(words, "bench", "tactsim-bench")
