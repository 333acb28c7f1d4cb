"""Commands that print a document: ``examples``, the shipped specs, and ``schema``, of all fields of a spec."""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click

import lensforge
from lensforge.errors import InputError
from lensforge.results.files import replacing
from lensforge.spec.spec_reference import reference_page, spec_schema

_PACKAGE = Path(lensforge.__file__).parent
# The end of a sentence, not of "UN Regulation No. 7", nor of a journal's short name.
_END = re.compile(r"(?<!\bNo)(?<!\bJ)(?<!\bOpt)(?<!\bUniv)(?<!\bSci)\. ")
_PLACES = (_PACKAGE / "shipped", _PACKAGE.parent / "examples")  # of an installed package, and of a checkout


@click.command()
@click.option("--page", is_flag=True, help="Print the reference of all fields as Markdown instead (docs/spec.md).")
def schema(page: bool) -> None:
    """Print the JSON schema of a spec, by which an editor completes and checks it."""
    click.echo(reference_page() if page else json.dumps(spec_schema(), indent=1, ensure_ascii=False), nl=not page)


@click.command()
@click.argument("name", required=False)
def examples(name: str | None) -> None:
    """List the shipped specs, or copy the one called NAME here, with the files that it names."""
    folder = shipped_folder()
    paths = sorted(folder.rglob("*.toml"), key=lambda path: (path.parent, path.name))
    specs = {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}
    if name is None:
        for known, path in specs.items():
            click.echo(f"{known}\t{_first_comment(path)}")
        return
    stem = name.removesuffix(".toml")
    if stem not in specs:
        raise InputError(f"examples {name}: there is none of that name; known: {', '.join(specs)}")
    wanted = [specs[stem], *_named_files(specs[stem])]
    here = [path.name for path in wanted if Path(path.name).exists()]
    if here:
        raise InputError(f"{here[0]}: is there already and stays as it is; copy {stem} into another folder")
    for path in wanted:
        with replacing(Path(path.name)) as temporary:
            temporary.write_bytes(path.read_bytes())
    click.echo(f"{', '.join(path.name for path in wanted)}\tlensforge design {wanted[0].name}")


def shipped_folder() -> Path:
    """The folder of the shipped specs. Raises :class:`InputError` for an installation without them."""
    found = next((place for place in _PLACES if (place / "quickstart.toml").is_file()), None)
    if found is None:
        raise InputError("examples: this installation has none; install lensforge from its wheel or its sources")
    return found


def _first_comment(path: Path) -> str:
    """The first sentence of the comment at the head of a spec."""
    lines = path.read_text(encoding="utf-8").split('name = "')[0].splitlines()
    words = " ".join(line.lstrip("# ") for line in lines)
    return _END.split(words)[0].rstrip(".")


def _named_files(spec: Path) -> list[Path]:
    """Files beside a shipped spec that it names; those of a vendor are not there."""
    texts = _texts(tomllib.loads(spec.read_text(encoding="utf-8")))
    return [spec.parent / text for text in texts if Path(text).name == text and (spec.parent / text).is_file()]


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for entry in value.values():
            yield from _texts(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _texts(entry)
