"""Every shipped spec, written in Python with the public classes, is the one that its file holds."""

import datetime
from pathlib import Path

import pytest
from specs_in_python import WITH_FILES, expression, shipped

import lensforge as lf


@pytest.mark.parametrize("name", sorted(shipped().keys() - WITH_FILES))
def test_a_spec_of_public_classes_is_that_of_its_file(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = shipped()[name]
    monkeypatch.chdir(path.parent)
    text = expression(path)
    spec = eval(text, {"lf": lf, "Path": Path, "datetime": datetime})
    assert spec == lf.load_spec(path)
    assert ": {" not in text and "({" not in text and "={" not in text, "no table is left a dict"
