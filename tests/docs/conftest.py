"""What the tests of commands share that fill a page of the documentation."""

import pytest


@pytest.fixture
def check_refused(tmp_path, capsys):
    """Check that a command refuses a page with this text, says why in its words, and leaves the page as it is."""

    def check(main, command, text, said):
        page = tmp_path / "page.md"
        page.write_text(text)
        assert main([str(page)]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"{command}: {page}: ")
        assert said in error
        assert page.read_text() == text

    return check
