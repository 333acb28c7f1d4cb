"""The shipped specs: examples to begin from, with the files that they name."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from lensforge.errors import InputError

_PACKAGE = Path(__file__).parents[1]
# The end of a sentence, not of "UN Regulation No. 7", nor of a journal's short name.
_END = re.compile(r"(?<!\bNo)(?<!\bJ)(?<!\bOpt)(?<!\bUniv)(?<!\bSci)\. ")
_PLACES = (_PACKAGE / "shipped", _PACKAGE.parent / "examples")  # of an installed package, and of a checkout


def shipped_folder() -> Path:
    """The folder of the shipped specs. Raises :class:`InputError` for an installation without them."""
    folder = next((place for place in _PLACES if (place / "quickstart.toml").is_file()), None)
    if folder is None:
        raise InputError("examples: this installation has none; install lensforge from its wheel or its sources")
    return folder


def shipped_specs() -> dict[str, Path]:
    """The shipped specs by their names, those of a folder within it last."""
    folder = shipped_folder()
    paths = sorted(folder.rglob("*.toml"), key=lambda path: (path.parent, path.name))
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}


def first_sentence(spec: Path) -> str:
    """The first sentence of a spec's comment: what it is."""
    lines = spec.read_text(encoding="utf-8").split('name = "')[0].splitlines()
    text = " ".join(line.lstrip("# ") for line in lines)
    return _END.split(text)[0].rstrip(".")


def named_files(spec: Path) -> list[Path]:
    """The files that a spec names beside it, and those of a folder that is called like it."""
    texts = _texts(tomllib.loads(spec.read_text(encoding="utf-8")))
    named = [spec.parent / text for text in texts if Path(text).name == text and (spec.parent / text).is_file()]
    return [*named, *sorted(path for path in spec.with_suffix("").glob("*") if path.is_file())]


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for entry in value.values():
            yield from _texts(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _texts(entry)
