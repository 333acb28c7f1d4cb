"""The result of a stage: a record with a name, a version, the hashes of its inputs, its conditions, and its files.

Arrays are stored in the stage's npz file, fields in its JSON file under a checksum. Every error of reading is one line
with its remedy.
"""

import hashlib
import io
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping
from functools import cached_property
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple, Self, TypeVar, cast, get_args

import numpy as np
from pydantic import Field, ValidationError, model_serializer, model_validator

from lensforge.errors import InputError, OutdatedResult, refused
from lensforge.public import public
from lensforge.results.case import Case
from lensforge.results.conditions import Conditions
from lensforge.results.fact import Fact
from lensforge.results.figure import criteria_in, declare_criteria, with_told_by_criteria
from lensforge.results.files import MIB, read_file, read_json, write_file
from lensforge.results.json_npz import arrays_in
from lensforge.results.notebook_html import PLOT_KINDS, plot_file, plot_html, table_text
from lensforge.results.record import (
    Array,
    Given,
    InCriterion,
    InFile,
    Record,
    Scalar,
    Sha256,
    Text,
    agree,
    arrays_of,
    marker,
    put_arrays,
    require_what_follows,
    stored_beside,
)
from lensforge.results.validation import input_error, its_type
from lensforge.version import __version__

CHECKSUM = "content_sha256"  # the key of the hash of all other entries
# Three maps of 2048 x 2048 pixels take 100 MiB, ten million measured points 300 MiB; there are up to three copies.
_MOST_ARRAY_BYTES = 512 * MIB

_Record = TypeVar("_Record", bound=Record)
_Value = TypeVar("_Value")


def with_checksum(content: Mapping[str, Any]) -> dict[str, object]:
    """``content`` of a JSON file with the hash of all its entries, which :func:`require_checksum` verifies."""
    plain = {key: value for key, value in content.items() if key != CHECKSUM}
    head = {"schema": plain.pop("schema")} if "schema" in plain else {}
    return {**head, CHECKSUM: _checksum({**head, **plain}), **plain}


def require_checksum(content: Mapping[str, _Value], path: Path, remedy: str) -> dict[str, _Value]:
    """``content`` of ``path`` without its checksum. Raises :class:`InputError` if the checksum does not match."""
    plain = {key: value for key, value in content.items() if key != CHECKSUM}
    if content.get(CHECKSUM) != _checksum(plain):
        raise InputError(f"{path}: {CHECKSUM}: of other content: the file is damaged or was edited; {remedy}")
    return plain


def _checksum(content: Mapping[str, Any]) -> str:
    """SHA-256 of ``content`` in a canonical form of text, whatever a file's layout."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def read_object(path: Path, schema: str, remedy: str, first: str = "") -> dict[str, object]:
    """The object in a JSON file that states ``schema`` and the right checksum, without these two entries.

    ``first``: the remedy for a missing file. Raises :class:`OutdatedResult` for another version of the schema,
    :class:`InputError` for any other file.
    """
    content = without_schema(read_json(path, first or remedy), schema, path, remedy)
    plain = require_checksum({"schema": schema, **content}, path, remedy)
    del plain["schema"]
    return plain


def without_schema(content: object, schema: str, path: Path, remedy: str) -> dict[str, object]:
    """``content`` of a file without its entry "schema", which must be ``schema``; errors as in :func:`read_object`."""
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds {its_type(content)}, must be an object; {remedy}")
    _require_schema(content, schema, path, remedy)
    return {key: value for key, value in content.items() if key != "schema"}


def _require_schema(content: Mapping[str, object], schema: str, path: Path, remedy: str) -> None:
    stated = content.get("schema")
    if stated == schema:
        return
    fault = "written before version 0.2.0" if stated is None else f"schema = {json.dumps(stated)[:60]}"
    of_this_kind = isinstance(stated, str) and re.fullmatch(re.escape(schema.rstrip("0123456789")) + r"\d+", stated)
    kind = OutdatedResult if stated is None or of_this_kind else InputError
    raise kind(f"{path}: {fault}, must be {schema!r}; {remedy}")


def validated(kind: type[_Record], content: Mapping[str, object], path: Path, remedy: str) -> _Record:
    """``content`` of a file as a record. Raises :class:`InputError`, which names the wrong field."""
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise input_error(error, str(path), remedy=remedy, unions=kind.unions) from None


def read_arrays(path: Path, sha256: object, remedy: str) -> dict[str, np.ndarray]:
    """The arrays of an npz file whose hash is ``sha256``; missing arrays are left to the validation."""
    content = read_file(path, missing=remedy, most_bytes=_MOST_ARRAY_BYTES)
    if hashlib.sha256(content).hexdigest() != sha256:
        raise InputError(f"{path}: not the arrays that {path.stem}.json describes; {remedy}")
    with refused(path, f"damaged (…); {remedy}", ValueError):
        return arrays_in(content, None, _MOST_ARRAY_BYTES)


SCHEMA_VERSION = 3  # 1: the records of version 0.1.0, which named no schema; 2: of one receiver, a square on the axis
_ARRAYS = "arrays_sha256"  # the key of the npz file's hash in the JSON
_LED = "[A-Za-z0-9_-]{0,32}"  # name of an LED, in the names of files
_UNHASHED = ("seconds", "version")  # differ between runs with the same result


OF_FOLDERS: "dict[str, type[StageResult]]" = {}  # records that the folder of a lens may have, by stage
_Content = MutableMapping[str, Any]  # of a file, or of a result within it


class OnPage(NamedTuple):
    """Texts for pages on the results of a stage.

    ``title``: name, with {} for that of a face; empty for the stage's. ``further``: keys of facts that follow those by
    which a design is judged. ``in_row``: keys of facts for a row about the result.
    """

    title: str = ""
    further: tuple[str, ...] = ()
    in_row: tuple[str, ...] = ()


@public
class StageResult(Record):
    """Result of one stage. A class with a ``stage`` of its own registers it for the folders of results.

    ``version``: of the program. ``inputs``: SHA-256 of its inputs, by name. ``seconds``: of computing. ``criteria``:
    what it must keep, each with its judgement; they follow from its figures. ``rays``: number of rays traced. ``seed``:
    of these rays. ``warnings``: what limits its use, a sentence each.
    """

    stage: ClassVar[str]
    command: ClassVar[str] = ""  # the command that makes it, where not named like the stage
    made_from: ClassVar[tuple[str, ...]] = ("lens",)  # inputs whose hashes a record must state
    omit_if_empty: ClassVar[tuple[str, ...]] = ()  # fields that a record leaves out where they are empty
    judged_in: ClassVar[tuple[str, ...]] = ("criteria",)  # fields that hold judgements
    of_face: ClassVar[str] = ""  # beginning of the names of its files, which a face ends; empty for the whole lens
    on_page: ClassVar[OnPage] = OnPage()
    in_folder: ClassVar[bool] = True  # a record of the folder of a lens, where it is made from one

    version: Text = __version__
    inputs: dict[Text, Sha256] = Field(default_factory=dict)

    def judge(self) -> Iterable[Fact]:
        """Make the criteria that its fields declare."""
        return criteria_in(self)

    def cases(self, among: str = "") -> Iterator[Case[Self]]:
        """A case for each LED; ``among``: for each of its records in this field, such as "receivers"."""
        return Case(self).among(among) if among else iter([Case(self)])

    def all_criteria(self) -> Iterator[Fact]:
        """Its criteria, including those of further LEDs, under their names; most results have none."""
        for case in self.cases():
            yield from map(case.named, case.criteria)

    def deciding_criteria(self) -> Iterator[Fact]:
        """The criteria by which files pass or fail, including those of further LEDs."""
        return self.all_criteria()

    def judgements(self) -> Mapping[str, Iterable[Fact]]:
        """All judgements of its figures, by the field that holds them."""
        return {"criteria": self.judge()}

    def judgements_on(self, lens: Any) -> Mapping[str, Iterable[Fact]]:
        """Judgements by limits of a ``lens`` that the record does not hold, by the field that holds them."""
        return {}

    @model_validator(mode="before")
    @classmethod
    def _figures_told_by_criteria(cls, content: Any) -> Any:
        return with_told_by_criteria(cls, content, cls.judged_in) if isinstance(content, Mapping) else content

    @model_validator(mode="after")
    def _is_judged(self) -> Self:
        for field, made in self.judgements().items() if self._judges_itself() else ():
            if field not in self.model_fields_set:
                object.__setattr__(self, field, tuple(made))  # the record is frozen for everybody else
        return self

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        declare_criteria(cls)
        if "stage" in vars(cls) and cls.in_folder and "lens" in cls.made_from:
            OF_FOLDERS[cls.stage] = cls

    @classmethod
    def _judges_itself(cls) -> bool:
        field = cls.model_fields.get("criteria")
        return field is not None and not field.is_required()

    def _require_own_judgements(self) -> None:
        """Raise :class:`ValueError` if judgements, texts aside, are not those that follow from the figures.

        A file that somebody edited may state right hashes of wrong content. Judgements on another lens count nowhere,
        and are not made by the limits of this one.
        """
        lens = getattr(self, "lens", None)
        if not self._judges_itself() or (lens is not None and self.inputs.get("lens") != lens.sha256):
            return
        try:
            judgements = {field: tuple(made) for field, made in self.judgements().items()}
        except (ArithmeticError, LookupError):  # a volume of 0, a face that the lens has not
            raise ValueError(f"not what a {self.stage} of this lens can be") from None
        for field, made in judgements.items():
            require_same_judgements(field, sorted(vars(self)[field], key=_named), sorted(made, key=_named))

    @model_serializer(mode="wrap")
    def _drop_empty(self, dumped: Callable[[object], dict[str, object]]) -> dict[str, object]:
        return {name: value for name, value in dumped(self).items() if value or name not in self.omit_if_empty}

    @classmethod
    def schema_name(cls) -> str:
        """Name and version of the schema, as the JSON file states it."""
        return f"lensforge-{cls.stage}-{SCHEMA_VERSION}"

    @classmethod
    def rebuild_command(cls) -> str:
        """The remedy for damaged or outdated files: the command that makes them again."""
        return f"run `lensforge {cls.command or cls.stage}` again"

    @classmethod
    def stored_elsewhere(cls) -> tuple[str, ...]:
        """Names of the fields that are not stored in the JSON file."""
        fields = cls.model_fields.items()
        return tuple(
            name
            for name, info in fields
            if any(marker(info, mark) is not None for mark in (Given, Array, InFile, InCriterion))
        )

    def plain(self) -> dict[str, object]:
        """Numbers and texts as in the JSON file: without arrays, files and parts of other stages' results."""
        elsewhere = dict.fromkeys(self.stored_elsewhere(), True) | stored_beside(self)
        return self.model_dump(mode="json", exclude=elsewhere)

    @cached_property
    def sha256(self) -> str:
        """Hash of all fields except computing times and the program's version."""
        digest = hashlib.sha256()
        given = (name for name, info in type(self).model_fields.items() if marker(info, Given) is not None)
        skipped = stored_beside(self) | dict.fromkeys(given, True)
        for name, array in arrays_of(self):
            digest.update(name.encode() + array.tobytes())
        for result, stem in self._stems(self.stage):
            for field, _, _ in result._files(stem):
                if (value := getattr(result, field)) is not None:
                    digest.update(field.encode() + value)
        hashed = _without_unhashed(self.model_dump(mode="json", exclude=skipped))
        digest.update(json.dumps(hashed, sort_keys=True).encode())
        return digest.hexdigest()

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with the fields of ``update``; cached properties are dropped."""
        copy = super().model_copy(update=update, deep=deep)
        for name in set(copy.__dict__) - set(type(copy).model_fields):
            del copy.__dict__[name]  # cached from the fields of the original
        return copy

    def _entries(self, whole: bool = False) -> Iterator[tuple[str, Scalar]]:
        omitted = [name for name in self.omit_if_empty if not getattr(self, name)]
        elsewhere = (*self.stored_elsewhere(), *omitted)
        return ((key, value) for key, value in super()._entries(whole) if key.split(".")[0] not in elsewhere)

    def __str__(self) -> str:
        """The row as lines, as many as fit on a screen."""
        return table_text(type(self).__name__, self.shown_row())

    def _repr_html_(self) -> str:
        draw = getattr(self, "plot", None)
        return (plot_html(draw, type(self).__name__) if draw else "") + super()._repr_html_()

    @classmethod
    def _files(cls, stem: str) -> Iterator[tuple[str, InFile, str]]:
        """Each field that is a file, its mark, and the file's name beside ``stem``.json."""
        for field, info in cls.model_fields.items():
            if (mark := marker(info, InFile)) is not None:
                yield field, mark, mark.beside(cls.stage, stem)

    @classmethod
    def stems(cls, faces: Iterable[str]) -> list[str]:
        """Names of its JSON files, without suffix, under the nominal conditions of a lens with these ``faces``."""
        return [f"{cls.of_face}_{face}" for face in faces] if cls.of_face else [cls.stage]

    @property
    def stem(self) -> str:
        """Name of its JSON file under nominal conditions, without suffix."""
        return self.stage

    def _stems(self, stem: str) -> "Iterator[tuple[StageResult, str]]":
        """The results in ``stem``.json, this one first, and the stem of each one's files."""
        return ((case.result, f"{stem}{case.suffix}") for case in self.cases())

    @classmethod
    def _contents(cls, content: _Content, stem: str) -> Iterator[tuple[_Content, str]]:
        yield content, stem

    def file_names(self, stem: str) -> set[str]:
        """Names of all files that a result may have beside ``stem``.json, and of that."""
        files = (name for result, own_stem in self._stems(stem) for _, _, name in result._files(own_stem))
        return {f"{stem}.json", f"{stem}.npz", *files}

    def contents(self, stem: str | None = None) -> dict[str, bytes]:
        """Content of every file of the result, by name: JSON, npz, and the files of marked fields."""
        name = stem or self.stage
        arrays = dict(arrays_of(self))
        files = {
            file: value
            for result, own_stem in self._stems(name)
            for field, _, file in result._files(own_stem)
            if (value := getattr(result, field)) is not None
        }
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
        for _, _, name in self._files(stem or self.stage):
            if name not in files:
                (Path(folder) / name).unlink(missing_ok=True)  # left by an earlier result; this one has none

    @staticmethod
    def _write(folder: Path, files: Mapping[str, bytes]) -> None:
        for name in sorted(files, key=lambda name: name.endswith(".json")):
            write_file(Path(folder) / name, files[name])

    def products(self) -> dict[str, bytes]:
        """Content of the further files that :meth:`save` can write, by suffix; most results have none."""
        return {}

    def save(self, path: Path | str) -> None:
        """Write the result in the format given by the suffix of ``path``.

        ``.json``: the record, with its arrays as npz next to it. ``.png``, ``.svg``, ``.pdf``: its plot. Others: the
        files that it holds, such as ``.step`` or ``.ies``. Raises :class:`InputError` for any other suffix.
        """
        path = Path(path)
        products = self.products()
        draw = getattr(self, "plot", None)
        suffix = path.suffix.lower()
        if suffix == ".json":
            record_files = {f"{path.stem}.json", f"{path.stem}.npz"}
            files = {name: content for name, content in self.contents(path.stem).items() if name in record_files}
            self._write(path.parent, files)
            return
        if suffix in products:
            content = products[suffix]
        elif suffix[1:] in PLOT_KINDS and draw is not None:
            content = plot_file(draw, suffix[1:])
        else:
            kinds = ", ".join([*products, ".json", *(f".{kind}" for kind in (PLOT_KINDS if draw is not None else ()))])
            raise InputError(f"{path}: {its_type(self)} is saved as one of {kinds}; give such a name")
        write_file(path, content)

    @classmethod
    def read(cls, folder: Path, stem: str | None = None, **given: object) -> Self:
        """Read what :meth:`write` wrote; ``given``: the fields marked :class:`Given`. Raises :class:`InputError`."""
        folder = Path(folder)
        name = stem or cls.stage
        path = folder / f"{name}.json"
        first = f"run `lensforge {cls.command or cls.stage}` first"
        content = read_object(path, cls.schema_name(), cls.rebuild_command(), first) | given
        if _keeps_arrays(cls):
            arrays = read_arrays(folder / f"{name}.npz", content.pop(_ARRAYS, None), cls.rebuild_command())
            with refused(path, f"…; {cls.rebuild_command()}", ValueError):
                put_arrays(content, arrays)
        for place, own_stem in cls._contents(content, name):
            for field, mark, file_name in cls._files(own_stem):
                file = folder / file_name
                expected = cls.model_fields[field].is_required() or file.is_symlink() or file.exists()
                place[field] = (
                    read_file(file, missing=cls.rebuild_command(), most_bytes=mark.most_bytes) if expected else None
                )
        result = validated(cls, content, path, cls.rebuild_command())
        with refused(path, f"…; {cls.rebuild_command()}", ValueError):
            require_what_follows(result)
            for case in result.cases():
                case.result._require_own_judgements()
        missing = next((f"inputs.{name}" for name in cls.made_from if name not in result.inputs), "")
        if missing:
            raise InputError(f"{path}: {missing}: missing; {cls.rebuild_command()}")
        return result


def require_same_judgements(field: str, stated: Iterable[Fact], made: Iterable[Fact]) -> None:
    """Raise :class:`ValueError` if judgements that a file states in ``field`` are not those that were ``made``."""
    for stated_fact, made_fact in zip_longest(stated, made):
        if not agree(_judgement(stated_fact), _judgement(made_fact)):
            raise ValueError(f"{field}: {(stated_fact or made_fact).key}: not as it follows from the other entries")


def _named(fact: Fact) -> tuple[str, str]:
    """Name of a fact as criterion: another version of the program may state them in another order."""
    return fact.key, fact.place


def _judgement(fact: Fact | None) -> tuple[object, ...]:
    """Entries that must agree: all but texts."""
    if fact is None:
        return ()
    return fact.key, fact.place, fact.value, fact.standard_error, fact.sense, fact.limit, fact.unit, fact.tolerance


@public
class SimulatedResult(StageResult):
    """Result under nominal or other conditions.

    ``conditions``: those that differ from the nominal ones; None if all are nominal.
    """

    conditions: Conditions | None = None


@public
class ResultByLed(SimulatedResult):
    """Result in each state of a lens, such as with each of several LEDs.

    ``led``: name of the state; it ends the names of the files of all but the first. ``others``: results in the other
    states.
    """

    omit_if_empty: ClassVar[tuple[str, ...]] = ("led", "others")

    led: Annotated[str, Field(strict=True, pattern=f"^{_LED}$")] = ""
    others: "tuple[ResultByLed, ...]" = ()

    def cases(self, among: str = "") -> Iterator[Case[Self]]:
        """A case for each state."""
        for number, result in enumerate((self, *cast("tuple[Self, ...]", self.others))):
            case = Case(result, led=result.led if self.others else "", number=number)
            yield from case.among(among) if among else (case,)

    @classmethod
    def joined(cls, by_led: Mapping[str, Self]) -> Self:
        """The results of all states, by name, as one; "" names the only state."""
        first, *others = (result.changed(led=name) for name, result in by_led.items())
        conditions = next(filter(None, (result.conditions for result in (first, *others))), None)
        return first.changed(others=tuple(others), conditions=conditions) if others else first

    @property
    def by_led(self) -> dict[str, Self]:
        """Result of each state by its name, the first one's first; "" names the only state."""
        alone = self.changed(others=()) if self.others else self
        return {result.led: result for result in (alone, *cast("tuple[Self, ...]", self.others))}

    @classmethod
    def _contents(cls, content: _Content, stem: str) -> Iterator[tuple[_Content, str]]:
        yield from super()._contents(content, stem)
        others = content.get("others")
        for other in others if isinstance(others, list) else ():
            if isinstance(other, dict) and re.fullmatch(_LED, str(other.get("led"))):
                yield other, f"{stem}_{other['led']}"


def _without_unhashed(content: object) -> object:
    if isinstance(content, dict):
        return {key: _without_unhashed(value) for key, value in content.items() if key not in _UNHASHED}
    return [_without_unhashed(value) for value in content] if isinstance(content, list) else content


def _keeps_arrays(cls: type[Record]) -> bool:
    """True for records with an array of their own, or in the entries of a list."""
    fields = cls.model_fields.values()
    has_array = any(marker(info, Array) is not None for info in fields)
    entries = (argument for info in fields for argument in get_args(info.annotation))
    return has_array or any(
        _keeps_arrays(entry)
        for entry in entries
        if isinstance(entry, type) and issubclass(entry, Record) and entry is not cls
    )
