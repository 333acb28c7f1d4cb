"""What the studio says where its libraries are not installed."""

import sys

import pytest

import lensforge as lf


@pytest.mark.parametrize("library", ["aiohttp", "tomlkit"])
def test_a_missing_library_is_named_with_the_remedy(library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(lf.InputError) as caught:
        lf.studio(browser=False)
    assert str(caught.value) == f'studio: needs {library}; pip install "lensforge[studio]"'
