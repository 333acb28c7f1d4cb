"""What a comparison with a photograph says where its library is not installed."""

import sys
from pathlib import Path

import pytest
from scenes import small_spec, sphere

import lensforge as lf


def test_a_missing_library_is_named_with_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    light = lf.evaluate(lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, "draft"), rays=64)
    monkeypatch.setitem(sys.modules, "skimage", None)
    with pytest.raises(lf.InputError) as caught:
        lf.compare(light, on=tmp_path / "on.png")
    assert str(caught.value) == 'measure: needs skimage; pip install "lensforge[measure]"'
