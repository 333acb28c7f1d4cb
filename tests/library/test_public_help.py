"""What ``help`` says of every public name: no private path, every argument and field in words, an example that runs."""

import doctest
import inspect
import pickle
import pydoc
import re
import shutil
from dataclasses import fields, is_dataclass
from pathlib import Path

import pytest
from made_once import copied
from presets import FEW_STEPS

import lensforge as lf
from lensforge.verbs import UNLISTED, public_names

PUBLIC = {name: member for name, member in public_names().items() if not isinstance(member, str)}


def is_exception(named: object) -> bool:
    return isinstance(named, type) and issubclass(named, Exception)


@pytest.mark.parametrize("name", [name for name, member in PUBLIC.items() if inspect.isfunction(member)])
def test_the_example_of_a_verb_runs(
    whole_run: lf.Run, examples: Path, tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, undrawn: None
) -> None:
    """In a folder with the shipped specs, a run, and points measured on its part; drafts are of a few steps."""
    monkeypatch.chdir(tmp_path)
    copied(whole_run.folder, "cad_out/quickstart")
    for file in ("cloud.csv", "poses.csv", "on.png", "moved.png"):
        shutil.copy(whole_run.folder.with_name(file), file)
    Path("examples").symlink_to(examples)
    lines = doctest.DocTestParser().get_examples(inspect.getdoc(PUBLIC[name]) or "")
    text = "".join(line.source for line in lines)
    assert f"lf.{name}(" in text
    exec(text.replace('accuracy="draft"', "accuracy=FEW_STEPS"), {"lf": lf, "FEW_STEPS": FEW_STEPS})


def test_what_names_the_library_as_its_module_is_found_there() -> None:
    for member in (*PUBLIC.values(), *UNLISTED.values()):
        assert member.__module__ == "lensforge" and pickle.loads(pickle.dumps(member)) is member


@pytest.mark.parametrize("name", PUBLIC)
def test_help_is_enough_to_go_on(name: str) -> None:
    text, shown = inspect.getdoc(PUBLIC[name]) or "", pydoc.plaintext.document(PUBLIC[name], name)
    assert re.findall(r"lensforge\.[a-z]\w*\.\w", shown) == [], "no private path"
    assert not text.startswith("The "), "begins with the noun or the verb itself"
    listed = re.split(r"\n {4}(?=\w)", re.sub(r"(?s)^.*\n(Args|Fields):|\n\w+: .*", "", text))[1:]
    assert [line for line in listed if not re.match(r"\w+( \([^:]*\))?: (?!Has )\S", " ".join(line.split()))] == []
    if inspect.isfunction(PUBLIC[name]) or "\nArgs:\n" in text:
        assert [re.split(r"[: ]", line)[0] for line in listed] == list(inspect.signature(PUBLIC[name]).parameters)
    if inspect.isfunction(PUBLIC[name]):
        assert "\nReturns: " in text and "\nRaises: " in text and "\nExample:\n" in text


@pytest.mark.parametrize("name", [name for name, named in PUBLIC.items() if not is_exception(named)])
def test_a_signature_shows_types_without_modules_of_the_package_and_marks_of_their_validation(name: str) -> None:
    """Of verbs, of dataclasses, and of classes of pydantic."""
    shown = str(inspect.signature(PUBLIC[name]))
    assert re.findall(r"lensforge\.|Annotated|FieldInfo|Validator|Discriminator|Strict", shown) == [], shown


@pytest.mark.parametrize("name", [name for name, named in PUBLIC.items() if is_dataclass(named)])
def test_the_docstring_of_a_dataclass_has_all_of_its_fields(name: str) -> None:
    listed = re.findall(r"\n {4}(\w+) \(", (inspect.getdoc(PUBLIC[name]) or "").partition("\nFields:")[2])
    assert listed == [field.name for field in fields(PUBLIC[name])]
