import pytest

import models
from models.errors import InputError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("AEIOU", "AEIOU"),
        ("A,E,I", "AEI"),
        ("U E A", "UEA"),
        ("AAE", "AE"),
        ("A-U", "AEIOU"),
        ("I-O,A", "IOA"),
    ],
)
def test_letter_sets(text, expected):
    chosen = models.parse_letters(text)
    assert [name for name in chosen if name in "AEIOU"] == list(expected)


@pytest.mark.parametrize("text", ["", " , ", "a", "A-", "-A", "U-A", "A-?", "--", "É"])
def test_wrong_letter_sets_are_one_line(text):
    with pytest.raises(InputError) as error:
        models.parse_letters(text)
    assert "\n" not in str(error.value)
