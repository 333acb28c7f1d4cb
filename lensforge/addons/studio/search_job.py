"""Record of a search in a folder: with its checkpoint the search goes on, also after the studio has ended."""

from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from lensforge import seeds
from lensforge.results.files import MIB, json_in, read_file, write_file
from lensforge.results.validation import input_error
from lensforge.spec.accuracy import PRESETS

JOB_FILE = "studio_search.json"
_MOST_BYTES = 64 * MIB  # a text of a spec has a MB beside arrays that are written in it
_REMEDY = "Search begins anew"


def _whole_characters(text: str) -> str:
    text.encode()  # half of a pair of surrogates is refused
    return text


def _preset(name: str) -> str:
    if name not in PRESETS:
        raise ValueError(f"must be one of {', '.join(PRESETS)}")
    return name


_Words = Annotated[str, AfterValidator(_whole_characters)]


class SearchJob(BaseModel):
    """A search for the lens of the ``text`` of a spec.

    ``start``: it began from the lens that was there, which is kept in a file beside it.
    """

    model_config = ConfigDict(strict=True, frozen=True)

    text: _Words
    accuracy: Annotated[_Words, AfterValidator(_preset)]
    seed: Annotated[int, Field(ge=0, le=seeds.MOST)]
    force: bool
    start: bool

    @staticmethod
    def read(folder: Path) -> "SearchJob | None":
        """The record in ``folder``, None without one. Raises :class:`InputError` for a damaged one."""
        path = folder / JOB_FILE
        if not path.exists() and not path.is_symlink():
            return None
        content = json_in(read_file(path, missing=_REMEDY, most_bytes=_MOST_BYTES), path)
        try:
            return SearchJob.model_validate(content)
        except ValidationError as error:
            raise input_error(error, str(path), remedy=_REMEDY) from None

    def write(self, folder: Path) -> None:
        """Write it, all of it or nothing."""
        write_file(folder / JOB_FILE, self.model_dump_json(indent=2).encode())
