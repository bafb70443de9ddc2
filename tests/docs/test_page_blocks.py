"""What the commands share that fill one page."""

import page_references
import page_stress
import pytest


@pytest.mark.parametrize("main", [page_references.main, page_stress.main])
def test_a_page_that_is_not_there_is_named(main, tmp_path, capsys):
    assert main([str(tmp_path / "none.md")]) == 2
    assert "none.md" in capsys.readouterr().err
    assert main([]) == 2
