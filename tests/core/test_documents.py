"""Documents, texts and numbers from outside: what is read, bounded and refused in one line."""

import os
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field

from tactsim.core.checking import checked
from tactsim.core.documents import parse_json, parse_toml, read_json, read_text, read_toml
from tactsim.core.errors import InputError, printable, short, unknown
from tactsim.core.finite import LARGEST, finite


def refusal(call, *arguments):
    with pytest.raises(InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    return message


def test_what_is_written_is_read(tmp_path):
    (tmp_path / "a.toml").write_text('a.b = [1, 2.5, "x.y.z"]\n[c]\n"d e" = 2026-01-01')
    assert read_toml(tmp_path / "a.toml", "list")["a"] == {"b": [1, 2.5, "x.y.z"]}
    (tmp_path / "a.json").write_text('{"a": {"b": [9223372036854775807, -9223372036854775808, null, true]}}')
    assert read_json(tmp_path / "a.json", "list") == {"a": {"b": [2**63 - 1, -(2**63), None, True]}}


TOO_MUCH = {
    "5,000 digits": f"a = {'1' * 5000}", "65 bits": f"a.b = [1, {2**63}]", "nan": "a.b = nan",
    "very deep lists": "a = " + "[" * 100_000, "deep tables": "a = " + "{a=" * 50 + "1" + "}" * 50,
    "a key of 400,000 parts": "a." * 400_000 + "b = 1", "a key with blanks": " 'a' . " * 100_000 + "b = 1",
}  # fmt: skip


@pytest.mark.parametrize("kind", TOO_MUCH)
def test_toml_is_bounded(kind):
    message = refusal(parse_toml, TOO_MUCH[kind], "file f")
    assert message.startswith("file f")
    assert kind != "nan" or "'a.b' is nan" in message


@pytest.mark.parametrize(
    "text",
    ["[" * 100_000, '{"a":' * 60 + "1" + "}" * 60, '{"a": 1e999}', '{"a": 1' + "0" * 5000 + "}", "[]",
     '{"a": 1', b'{"a": "\xff"}'],
)  # fmt: skip
def test_json_is_bounded(text):
    assert refusal(parse_json, text, "file f").startswith("file f")


def test_only_regular_files_of_a_sensible_size_are_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "latin").write_bytes(b"caf\xe9")
    with (tmp_path / "large").open("wb") as stream:
        stream.truncate(1 << 40)
    for path, said in {
        tmp_path: "not a regular file", tmp_path / "pipe": "not a regular file", "/dev/zero": "not a regular file",
        tmp_path / "none": "No such file", "a\0b": "no path", "\udc80": "No such file",
        tmp_path / "latin": "UTF-8", tmp_path / "large": "larger than 1,048,576 bytes",
    }.items():  # fmt: skip
        message = refusal(read_text, path, "list")
        assert "list" in message
        assert said in message


class Inner(BaseModel):
    model_config = ConfigDict(extra="forbid")
    b: int = Field(1, ge=0, le=9)


class Outer(BaseModel):
    a: Inner = Inner()
    c: float = Field(1.0, gt=0, allow_inf_nan=False)
    d: Literal["one", "two"] = "one"
    e: tuple[str, ...] = Field(("x",), min_length=1)
    g: Path = Path()
    h: dict[str, int] = {}
    k: bool = True


@pytest.mark.parametrize(
    ("values", "said"),
    [({"a": {"b": -1}}, "f: a.b: give a number of at least 0, got -1"),
     ({"a": {"b": "many"}}, "f: a.b: give a whole number, got 'many'"),
     ({"c": -0.5}, "f: c: give a number above 0, got -0.5"),
     ({"c": True}, "f: c: a number is wanted, not true"),
     ({"h": {"x": False}}, "f: h.x: a number is wanted, not false"),
     ({"k": 1}, "f: k: say true or false, not 1"), ({"d": 5}, "f: d: give 'one' or 'two', got 5"),
     ({"g": 5}, "f: g: give the path of a file or folder, got 5"),
     ({"a": {"c": 1}}, "unknown option 'a.c': did you mean 'a.b'? known are a.b, c, d"),
     ({"a": {"b": 16**5000}}, "f: a.b"), ({"a": {"y" * 10**6: 1}}, "unknown option"), ([], "f: options")],
)  # fmt: skip
def test_what_is_wrong_is_said_in_a_short_line(values, said):
    assert said in refusal(checked, Outer, values, "f")


def test_a_strangers_text_is_made_harmless():
    assert printable("a\x1b[31mb\x07\u202e\udc80\ttab\nnext é") == (
        "a\\x1b[31mb\\x07\\u202e\\udc80\\ttab\nnext é"
    )
    assert len(short("x" * 10**6)) < 100
    assert short(16**5000).startswith("a number")
    assert len(str(unknown("thing", "x" * 10**6, ["a", "b"]))) < 200
    assert str(unknown("option", "x", [])) == "unknown option 'x': known are none"


def test_of_many_names_an_error_lists_the_eight_nearest():
    names = [f"far-{number}" for number in range(20)] + ["near"]
    said = str(unknown("word", "nearer", names))
    assert "did you mean 'near'? known are " in said
    assert said.endswith(" and 13 more")
    assert said.count(",") == 7


class Wanted(BaseModel):
    size: float = Field(alias="is", description="mm")
    inner: tuple[Inner, ...]
    more: int = 0


class Row(BaseModel):
    cells: tuple[Wanted, ...] = ()


@pytest.mark.parametrize(
    ("model", "values", "said"),
    [
        (Wanted, {}, "f: missing are is (mm), inner"),
        (Row, {"cells": [{}] * 50}, "cells.4.is, cells.4.inner and 90 more"),
    ],
)
def test_all_that_is_missing_is_named(model, values, said):
    assert refusal(checked, model, values, "f").endswith(said)


@pytest.mark.parametrize("bad", [np.nan, -np.inf, 1.001e9])
def test_the_first_number_that_may_not_enter_is_named(bad):
    table = np.zeros((3, 4))
    table[1, 2] = table[2, 0] = bad
    with pytest.raises(InputError, match=r"^readings\[1, 2\] is .*; only finite numbers up to 1e\+09 are"):
        finite(table, "readings")


def test_what_is_finite_passes_as_it_is():
    values = [LARGEST, -LARGEST, 0.0, 5e-324]
    assert finite(values, "x").tolist() == values
    assert finite([[1, 2]], "x").dtype == np.float64
    assert finite([], "x").shape == (0,)
