"""How a shape is refused, whatever file it is read from."""

import pytest

from tactsim import models
from tactsim.core.errors import InputError


def refusal(path, **options):
    """Return the one line with which a shape is refused."""
    with pytest.raises(InputError) as error:
        models.shape(path, **options)
    message = str(error.value)
    assert "\n" not in message
    assert str(path) in message
    return message.replace(str(path), "")
