"""Sections whose fields may be read from the file of a table, which they need no more then."""

from abc import abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationInfo, model_validator

from lensforge.public import public
from lensforge.spec.spec_files import full_path
from lensforge.spec.spec_section import Section, fault_of


@public
class OfTableFile(Section):
    """A section that has ``file`` in place of all fields but its kind."""

    @classmethod
    @abstractmethod
    def read(cls, path: Path) -> Mapping[str, object]:
        """Fields of the table at ``path``. Raises :class:`InputError`, one line, for a file that is none."""

    @model_validator(mode="before")
    @classmethod
    def _table_of_the_file(cls, content: Any, info: ValidationInfo) -> Any:
        if not isinstance(content, dict) or not isinstance(content.get("file"), str | Path):
            return content
        given = {name for name, value in content.items() if value is not None}
        if given - {"kind", "file"}:
            raise ValueError("file: give nothing else beside it")
        with fault_of("file"):
            fields = cls.read(full_path(Path(content["file"]), info))
        return {name: content[name] for name in given & {"kind"}} | dict(fields)
