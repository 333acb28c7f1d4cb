"""The result of a stage: a record with a name, a version, the hashes of its inputs, and its files.

Arrays are stored in the stage's npz file, fields marked :class:`InFile` each in a file of its own, and all others in
the JSON file. A field marked :class:`Given` is stored by another stage, and passed to :meth:`StageResult.read`.
"""

import hashlib
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field

from lensforge.errors import InputError
from lensforge.files import MIB, replacing
from lensforge.records.arrays import Array
from lensforge.records.conditions import Conditions
from lensforge.records.fields import Sha256, Text
from lensforge.records.html import PLOT_KINDS, plot_file, plot_html
from lensforge.records.nested import arrays_of, excluded_arrays, names_in, with_arrays
from lensforge.records.record import Record, Scalar, marker
from lensforge.records.stored import (
    CHECKSUM,
    read_arrays,
    read_bytes,
    read_object,
    require_checksum,
    validated,
    with_checksum,
)
from lensforge.records.validation import its_type
from lensforge.version import __version__

SCHEMA_VERSION = 3  # 1: the records of version 0.1.0, which named no schema; 2: of one receiver, a square on the axis
_MOST_FILE_BYTES = 384 * MIB  # of a CAD file or a mesh: eight million triangles, several times those of a reference run
_ARRAYS = "arrays_sha256"  # the key of the npz file's hash in the JSON
_UNHASHED = ("seconds", "cast_seconds", "rate", "version")  # differ between runs with the same result


@dataclass(frozen=True)
class Given:
    """Marks a field that another file holds."""


@dataclass(frozen=True)
class InFile:
    """Marks a field of bytes that are the file ``name`` of a result folder, which has at most ``most_bytes``."""

    name: str
    most_bytes: int = _MOST_FILE_BYTES

    def beside(self, stage: str, stem: str) -> str:
        """Name of the file that belongs to ``stem``.json: ``lens_x.ies`` to ``photometry_x.json``."""
        path, end = Path(self.name), stem.removeprefix(stage) if stem.startswith(f"{stage}_") else ""
        return f"{path.stem}{end}{path.suffix}"


class StageResult(Record):
    """Result of one stage. ``inputs``: SHA-256 of its inputs, by name."""

    stage: ClassVar[str]
    command: ClassVar[str] = ""  # the command that makes it, where not named like the stage
    made_from: ClassVar[tuple[str, ...]] = ("lens",)  # inputs whose hashes a record must state

    version: Text = __version__
    inputs: dict[Text, Sha256] = Field(default_factory=dict)

    @classmethod
    def schema_name(cls) -> str:
        """Name and version of the schema, as the JSON file states it."""
        return f"lensforge-{cls.stage}-{SCHEMA_VERSION}"

    @classmethod
    def again(cls) -> str:
        """The remedy for damaged or outdated files: the command that makes them again."""
        return f"run `lensforge {cls.command or cls.stage}` again"

    @classmethod
    def stored_elsewhere(cls) -> tuple[str, ...]:
        """Names of the fields that are not stored in the JSON file."""
        fields = type_fields(cls).items()
        return tuple(
            name for name, info in fields if any(marker(info, mark) is not None for mark in (Given, Array, InFile))
        )

    def plain(self) -> dict[str, Any]:
        """Numbers and texts as the JSON file holds them: without arrays, files and parts of other stages' results."""
        elsewhere = dict.fromkeys(self.stored_elsewhere(), True) | excluded_arrays(type(self))
        return self.model_dump(mode="json", exclude=elsewhere)

    @cached_property
    def sha256(self) -> str:
        """Hash of all fields except computing times and the program's version."""
        digest = hashlib.sha256()
        skipped = excluded_arrays(type(self))
        for name, array in arrays_of(self):
            digest.update(name.encode() + array.tobytes())
        for field, info in type(self).model_fields.items():
            value = getattr(self, field)
            if marker(info, Given) is not None:
                skipped[field] = True
            elif marker(info, InFile) is not None:
                skipped[field] = True
                if value is not None:
                    digest.update(field.encode() + value)
        hashed = _without_unhashed(self.model_dump(mode="json", exclude=skipped))
        digest.update(json.dumps(hashed, sort_keys=True).encode())
        return digest.hexdigest()

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with the fields of ``update``; values cached from the old fields are dropped."""
        copy = super().model_copy(update=update, deep=deep)
        for name in set(copy.__dict__) - set(type(copy).model_fields):
            del copy.__dict__[name]  # cached from the fields of the original
        return copy

    def row(self) -> dict[str, Scalar]:
        """All numbers and texts, keys joined by dots: one row for a table. Lists, arrays and files are left out."""
        elsewhere = self.stored_elsewhere()
        return {key: value for key, value in super().row().items() if key.split(".")[0] not in elsewhere}

    def _repr_html_(self) -> str:
        """HTML for a notebook: the plot, and the row as a table."""
        draw = getattr(self, "plot", None)
        return (plot_html(draw, type(self).__name__) if draw else "") + super()._repr_html_()

    def contents(self, stem: str | None = None) -> dict[str, bytes]:
        """Content of every file of the result, by name: JSON, npz, and the files of marked fields."""
        name, arrays, files = stem or self.stage, dict(arrays_of(self)), {}
        for field, info in type(self).model_fields.items():
            value = getattr(self, field)
            if (own := marker(info, InFile)) is not None and value is not None:
                files[own.beside(self.stage, name)] = value
        head = {"schema": self.schema_name()}
        if arrays:
            archive = io.BytesIO()
            np.savez_compressed(archive, **arrays)  # type: ignore[arg-type]  # its flag has another type
            files[f"{name}.npz"] = archive.getvalue()
            head[_ARRAYS] = hashlib.sha256(archive.getvalue()).hexdigest()
        content = with_checksum({**head, **self.plain()})
        files[f"{name}.json"] = (json.dumps(content, indent=2, allow_nan=False) + "\n").encode()
        return files

    def write(self, folder: Path, stem: str | None = None) -> None:
        """Write all files into a result folder, the JSON file last: it holds the hash of the arrays."""
        files = self.contents(stem)
        self._write(folder, files)
        for info in type(self).model_fields.values():
            own = marker(info, InFile)
            name = "" if own is None else own.beside(self.stage, stem or self.stage)
            if name and name not in files:
                (Path(folder) / name).unlink(missing_ok=True)  # left by an earlier result; this one has none

    @staticmethod
    def _write(folder: Path, files: Mapping[str, bytes]) -> None:
        for name in sorted(files, key=lambda each: each.endswith(".json")):
            with replacing(Path(folder) / name) as temporary:
                temporary.write_bytes(files[name])

    def products(self) -> dict[str, bytes]:
        """Content of the further files that :meth:`save` can write, by suffix; most results have none."""
        return {}

    def save(self, path: Path | str) -> None:
        """Write the result in the format given by the suffix of ``path``.

        ``.json``: the record, with its arrays as npz next to it. ``.png``, ``.svg``, ``.pdf``: its plot. Others:
        :meth:`products`. Raises :class:`InputError` for any other suffix.
        """
        path = Path(path)
        products, draw, suffix = self.products(), getattr(self, "plot", None), path.suffix.lower()
        if suffix == ".json":
            kept = {f"{path.stem}.json", f"{path.stem}.npz"}
            files = {name: content for name, content in self.contents(path.stem).items() if name in kept}
            self._write(path.parent, files)
            return
        if suffix in products:
            content = products[suffix]
        elif suffix[1:] in PLOT_KINDS and draw is not None:
            content = plot_file(draw, suffix[1:])
        else:
            kinds = ", ".join([*products, ".json", *(f".{kind}" for kind in (PLOT_KINDS if draw is not None else ()))])
            raise InputError(f"{path}: {its_type(self)} is saved as one of {kinds}; give such a name")
        with replacing(path) as temporary:
            temporary.write_bytes(content)

    @classmethod
    def read(cls, folder: Path, stem: str | None = None, **given: object) -> Self:
        """Read what :meth:`write` wrote; ``given``: the fields marked :class:`Given`. Raises :class:`InputError`."""
        folder, name = Path(folder), stem or cls.stage
        path = folder / f"{name}.json"
        first = f"run `lensforge {cls.command or cls.stage}` first"
        whole = read_object(path, cls.schema_name(), cls.again(), first)
        content = {key: value for key, value in whole.items() if key != CHECKSUM}
        for field in cls.stored_elsewhere():
            if field in content:
                raise InputError(f"{path}: {field}: does not belong in the JSON file; {cls.again()}")
        content |= given
        fields = type_fields(cls)
        if excluded_arrays(cls):
            sha256, names = content.pop(_ARRAYS, None), names_in(cls, content)
            arrays = read_arrays(folder / f"{name}.npz", names, sha256, cls.again())
            try:
                content = with_arrays(cls, content, arrays)
            except ValueError as error:
                raise InputError(f"{path}: {error}; {cls.again()}") from None
        for field, info in fields.items():
            if (own := marker(info, InFile)) is not None:
                file = folder / own.beside(cls.stage, name)
                content[field] = read_bytes(file, info.is_required(), own.most_bytes, cls.again())
        result = validated(cls, content, path, cls.again())
        missing = next((f"inputs.{name}" for name in cls.made_from if name not in result.inputs), "")
        if missing:
            raise InputError(f"{path}: {missing}: missing; {cls.again()}")
        require_checksum({"schema": cls.schema_name(), **whole}, path, cls.again())
        return result


class SimulatedResult(StageResult):
    """Result of a simulation. ``conditions``: those that are not the lens's own; None for the lens's own record."""

    conditions: Conditions | None = None


def _without_unhashed(content: object) -> object:
    if isinstance(content, dict):
        return {key: _without_unhashed(value) for key, value in content.items() if key not in _UNHASHED}
    return [_without_unhashed(value) for value in content] if isinstance(content, list) else content


def type_fields(cls: type[Record]) -> Mapping[str, Any]:
    """Fields of a record class, by name."""
    return cls.model_fields
