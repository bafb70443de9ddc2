"""Damage and malice for files of any kind: cut, flipped, inserted, repeated, and hostile values for good ones."""

import re
import zlib

import numpy as np

from tactsim.core.errors import InputError

# What is written into a text in place of one of its words, and between them.
WORDS = [
    b"nan", b"-inf", b"1e999", b"1e308", b"-1e-320", b"-1", b"0", b"4294967296", b"9223372036854775807",
    b"18446744073709551616", b"9" * 4000, b"9" * 5000, b"0x" + b"f" * 5000, b"1_0", b'""', b"[]", b"{}", b"[[]]",
    b"null", b"true", b"\x1b]0;title\x07", b"[/bold]", b"\x00", b"\xff\xfe", "\u202e\ud7ff\U0010ffff".encode(),
    b"../../../../etc/passwd", b"/dev/zero", b"file:///etc/passwd", b"__import__('os').abort()", b"${HOME}", b"%n%s",
    b"x" * 100_000, b"[" * 3000, b'{"a":' * 3000, b"a." * 3000, b"\n", b"'", b'"', b",", b"=", b"<!--", b"]]>",
]  # fmt: skip
# What is written over the bytes of numbers.
NUMBERS = [
    *(np.array(value, dtype).tobytes() for dtype in ("<f4", "<f8", ">f8") for value in (np.nan, np.inf, 1e38, -0.0)),
    *(value.to_bytes(size, "little") for size in (2, 4, 8) for value in (0, 2 ** (8 * size) - 1, 2 ** (8 * size - 1))),
]  # fmt: skip
_WORD = re.compile(rb"[\w.+-]+")


def damaged(content: bytes, rng: np.random.Generator) -> bytes:
    """Damage a file in one of the ways that a fault or an enemy would."""
    content = bytes(content)
    for _ in range(int(rng.integers(1, 4))):
        content = _WAYS[rng.integers(len(_WAYS))](content, rng)
    return content


def _cut(content, rng):
    return content[: rng.integers(len(content) + 1)]


def _without_a_piece(content, rng):
    first, last = np.sort(rng.integers(len(content) + 1, size=2))
    return content[:first] + content[min(last, first + 100) :]


def _flipped(content, rng):
    changed = bytearray(content)
    for place in rng.integers(max(len(changed), 1), size=rng.integers(1, 5)):
        if changed:
            changed[place] ^= 1 << rng.integers(8)
    return bytes(changed)


def _with_a_number(content, rng):
    place, number = rng.integers(len(content) + 1), NUMBERS[rng.integers(len(NUMBERS))]
    return content[:place] + number + content[place + len(number) :]


def _with_a_word(content, rng):
    words = list(_WORD.finditer(content))
    if not words:
        return content
    word = words[rng.integers(len(words))]
    return content[: word.start()] + WORDS[rng.integers(len(WORDS))] + content[word.end() :]


def _with_a_word_more(content, rng):
    place = rng.integers(len(content) + 1)
    return content[:place] + WORDS[rng.integers(len(WORDS))] + content[place:]


def _with_a_line_moved(content, rng):
    lines = content.splitlines(keepends=True)
    if not lines:
        return content
    lines.insert(rng.integers(len(lines) + 1), lines[rng.integers(len(lines))])
    del lines[rng.integers(len(lines))]
    return b"".join(lines)


# A swapped value finds more than bytes that no parser lets through.
_WAYS = (_cut, _without_a_piece, _flipped, _with_a_number, _with_a_word_more, _with_a_line_moved) + 6 * (
    _with_a_word,
)


def swapped(value, rng):
    """Swap a value in nested JSON for another, of another kind or size, or take an entry away."""
    if isinstance(value, dict | list) and value and rng.random() < 0.9:
        keys = list(value) if isinstance(value, dict) else range(len(value))
        key = keys[rng.integers(len(keys))]
        changed = value.copy()
        if rng.random() < 0.1:
            del changed[key]
        else:
            changed[key] = swapped(value[key], rng)
        return changed
    values = [
        None, True, -1, 0, 1, 2**63 - 1, 2**70, 10**30, 1.5, -1e308, 1e-320, "", "x" * 10_000, "\x1b[31m", "nan",
        [], {}, [[]], {"a": {}}, [1, "a", None], [None] * 1000, ["/etc/passwd"], "../..", "9" * 5000, "\ud800",
    ]  # fmt: skip
    return values[rng.integers(len(values))]


def reads_or_refuses(read, path, content, note):
    """Check that a content is read, or refused in one line of a sensible length; gives whether it is read.

    note: what shows a fault again, such as a seed.
    """
    path.write_bytes(content)
    try:
        read(path)
    except InputError as error:
        assert "\n" not in str(error), note  # noqa: PT017
        assert len(str(error)) < 3000, note  # noqa: PT017
        return False
    except BaseException as error:
        error.add_note(note)
        raise
    return True


def damage(name, read, path, content, count):
    """Damage a file that can be read `count` times; a fault names the seed that shows it again."""
    assert reads_or_refuses(read, path, content, "the good one")
    for seed in range(count):
        bad = damaged(content, np.random.default_rng([zlib.crc32(name.encode()), seed]))
        reads_or_refuses(read, path, bad, f"{name}, seed {seed}: {bad[:300]!r}")
    path.write_bytes(content)
