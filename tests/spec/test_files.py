"""Files that a spec names: where they lie, and their hashes, in which the content and the name count, no folder."""

import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, get_args

import pytest
from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

import lensforge as lf
from lensforge.spec.spec_files import NamedFrom, input_hashes, section_sha256
from lensforge.spec.spec_section import FilePath, Section, section_of

LED = Path(__file__).parents[2] / "examples" / "led.tm25ray"


def test_a_copy_of_a_file_in_another_folder_is_the_same_source(tmp_path: Path) -> None:
    folder = tmp_path / 'größe "1"'
    folder.mkdir()
    for name in ("led.tm25ray", "other.tm25ray"):
        shutil.copy(LED, folder / name)
    original, copied, renamed = (
        section_sha256(lf.RayfileSource(file=file)) for file in (LED, folder / "led.tm25ray", folder / "other.tm25ray")
    )
    assert original == copied
    assert original != renamed
    (folder / "led.tm25ray").write_bytes(LED.read_bytes()[:-1] + b"\0")
    assert section_sha256(lf.RayfileSource(file=folder / "led.tm25ray")) != original


def test_files_of_one_name_in_two_folders_both_count(tmp_path: Path) -> None:
    """Blue and yellow light of a white LED, each in its folder, as vendors ship them."""
    content = LED.read_bytes()
    for folder, end in (("blue", b"\1"), ("yellow", b"\2")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "led.tm25ray").write_bytes(content[:-1] + end)

    def source(*folders: str) -> lf.RayfilesSource:
        return lf.RayfilesSource(files=[{"file": tmp_path / folder / "led.tm25ray"} for folder in folders])

    both = source("blue", "yellow")
    digests = [hashlib.sha256(content[:-1] + end).hexdigest() for end in (b"\1", b"\2")]
    assert input_hashes(both) == {"file:led.tm25ray": digests[0], "file:led.tm25ray (2)": digests[1]}
    assert input_hashes(source("blue", "blue")) == {"file:led.tm25ray": digests[0]}
    before = section_sha256(both)
    assert section_sha256(source("yellow", "blue")) != before, "each has its own place"
    assert len({section_sha256(source(*pair)) for pair in (("blue", "blue"), ("yellow", "yellow"))} | {before}) == 3
    for folder in ("blue", "yellow"):
        (tmp_path / folder / "led.tm25ray").write_bytes(content[:-1] + b"\3")
        assert section_sha256(both) != before, folder
        before = section_sha256(both)


def test_every_kind_of_file_counts_by_its_content(tmp_path: Path) -> None:
    """Each field of a spec that names a file, found in the classes themselves."""
    kinds = [kind for kind in _sections(Section) if any(_is_file(field) for field in kind.model_fields.values())]
    assert len(kinds) >= 6, "ray files, photometric file, spectrum, luminance picture, target picture, base"
    file = tmp_path / "input"
    for kind in kinds:
        section = kind.model_construct(file=file, **dict.fromkeys(_needed(kind)))
        hashes = []
        for content in (b"1", b"2"):
            file.write_bytes(content)
            hashes.append((input_hashes(section), section_sha256(section)))
        assert hashes[0][0] != hashes[1][0] and hashes[0][1] != hashes[1][1], kind.__name__
        assert list(hashes[0][0]) == ["file:input"]


def _sections(kind: type[Section]) -> Iterator[type[Section]]:
    for subclass in kind.__subclasses__():
        yield subclass
        yield from _sections(subclass)


def _needed(kind: type[Section]) -> list[str]:
    return [name for name, field in kind.model_fields.items() if field.is_required() and name != "file"]


def _is_file(field: FieldInfo) -> bool:
    return Path in (field.annotation, *get_args(field.annotation))


NAMED = [
    pytest.param(kind, name, id=f"{kind.__name__}.{name}")
    for kind in dict.fromkeys(_sections(Section))
    for name, field in kind.model_fields.items()
    if "Path" in repr(field)
]


@pytest.mark.parametrize(("kind", "name"), NAMED)
def test_every_named_file_counts_from_the_folder_of_its_spec(kind: type[Section], name: str, tmp_path: Path) -> None:
    """By the type of the field, and where files are read before the fields are valid, too."""
    field, meant = kind.model_fields[name], str(tmp_path / "sub" / "named.step")
    by_itself = _words(TypeAdapter(Annotated[field.annotation, "", *field.metadata]), "sub/named.step", tmp_path)
    assert meant in by_itself
    in_its_section = _words(TypeAdapter(kind), {name: "sub/named.step"}, tmp_path)
    assert meant in in_its_section or "no such file" not in in_its_section


def _words(adapter: TypeAdapter[object], content: object, folder: Path) -> str:
    """Words for the value, or for its errors."""
    try:
        return str(adapter.validate_python(content, context=NamedFrom(folder, there=False)))
    except ValidationError as error:
        return str(error)


def test_the_named_files_are_all_there() -> None:
    assert {"surface_file", "wet_surface_file", "outline", "keep_out", "material_file", "start", "file"} == {
        kind.values[1] for kind in NAMED
    }


def test_a_file_in_lists_tables_and_choices_counts_from_its_folder(tmp_path: Path) -> None:
    class Inner(Section):
        tables: tuple[dict[str, FilePath | float], ...]

    class Outer(Section):
        either: Inner | FilePath
        several: list[Inner]

    given = {"tables": [{"a": 1.0}, {"b": "../x.csv"}]}
    section = section_of(
        Outer, {"either": "y.csv", "several": [given, given]}, "t.toml", NamedFrom(tmp_path / "sub", there=False)
    )
    assert section.either == tmp_path / "sub" / "y.csv"
    assert [entry.tables[1] for entry in section.several] == [{"b": tmp_path / "x.csv"}] * 2
    assert section_of(Inner, given, "script").tables[1]["b"] == Path("../x.csv").absolute()


@pytest.mark.skipif(os.name != "posix", reason="makes a pipe")
def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for name, message in (("pipe", "a pipe, must be a file"), ("none", "no such file"), (".", "a folder, must be")):
        with pytest.raises(lf.InputError, match=rf"{message}.*; the spec names it"):
            section_sha256(lf.RayfileSource(file=tmp_path / name))
