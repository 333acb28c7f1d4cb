"""The base of every section of a spec, and the types of its lengths and file names."""

from datetime import date, datetime
from inspect import Signature
from math import ceil, floor, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from lensforge.errors import InputError
from lensforge.records.validation import same
from lensforge.spec.fields import help_of, signature_of
from lensforge.spec.wrong_fields import spec_error

_MOST_PATH_CHARACTERS = 4096  # of Linux; other systems take fewer


class _Checked(type(BaseModel)):  # type: ignore[misc]  # pydantic's own metaclass, which has no public name
    """Turns the validation error of a section that a script constructs into the lines of the command line.

    A class that names its field ``positional`` takes that one without its name. Words and signature of a class are
    made when they are asked for: reading all of them takes a second.
    """

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        name: str | None = getattr(cls, "positional", None)
        if args and (name is None or len(args) > 1):
            raise InputError(f"{cls.__name__}: {len(args)} values without names; give its fields by name")
        if name is not None and args:
            if name in kwargs:
                raise InputError(f"{cls.__name__}: {name} is given twice, without its name and with it; leave out one")
            kwargs[name] = args[0]
        try:
            return super().__call__(**kwargs)
        except ValidationError as error:
            raise spec_error(error, cls.__name__, cls) from None

    @property
    def __signature__(cls) -> Signature:
        return signature_of(cls)

    @__signature__.setter
    def __signature__(cls, value: object) -> None:
        """Leave out pydantic's own, which a class has only once it has been used."""

    @property
    def __doc__(cls) -> str:  # type: ignore[override]
        return help_of(cls)


if TYPE_CHECKING:  # a type checker knows no metaclass without a name, and of this one it needs nothing
    _Model = BaseModel
else:
    _Model = _Checked("_Model", (BaseModel,), {"__module__": __name__})


class Section(_Model):
    """Immutable; a field that is not known, or a number that is not finite, is refused: :class:`InputError`."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True, defer_build=True
    )

    def __setattr__(self, name: str, value: Any) -> None:
        raise InputError(f"{type(self).__name__}.{name}: a spec does not change; make another with replace(...)")

    def __delattr__(self, name: str) -> None:
        raise InputError(f"{type(self).__name__}.{name}: a spec does not change; make another with replace(...)")

    def __eq__(self, other: object) -> bool:
        """True where all fields are equal, arrays to the bit."""
        if type(self) is not type(other):
            return NotImplemented
        return all(same(getattr(self, name), getattr(other, name)) for name in type(self).model_fields)

    def __hash__(self) -> int:
        return hash(self.model_dump_json())


def rounded_up(value: float, digits: int = 4) -> str:
    """``value`` > 0 to ``digits`` significant digits, rounded up: a least value in a message must itself be allowed."""
    unit = 10.0 ** (floor(log10(value)) + 1 - digits)
    return f"{ceil(value / unit * (1.0 - 1e-12)) * unit:.{digits}g}"


def _printable(words: str) -> str:
    if not words.isprintable():
        raise ValueError("holds a character that cannot be printed, such as a line break; leave it out")
    return words


def _usable_path(path: Path) -> Path:
    name = str(path)
    if len(name) > _MOST_PATH_CHARACTERS:
        raise ValueError(f"{len(name)} characters, a path has {_MOST_PATH_CHARACTERS} at most")
    if not name.isprintable():
        raise ValueError("holds a character that cannot be printed, such as a line break; rename the file")
    if name.startswith("~"):
        raise ValueError("~ does not stand for the home folder here, which differs by user; write the whole path")
    return path.absolute()


def iso_date(value: Any) -> str:
    """The ISO 8601 text of a date, or of its text. Raises ``ValueError`` for anything else, a time of day included."""
    try:
        if isinstance(value, date) and not isinstance(value, datetime):
            return value.isoformat()
        if isinstance(value, str) and len(value) == len("2026-01-31"):
            return date.fromisoformat(value).isoformat()
    except ValueError:
        pass
    raise ValueError("a date is written as year-month-day, such as 2026-01-31")


# From a nanometre to a kilometre, with room to spare: squares and ratios of lengths stay within floating point.
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9)]
MillimetresOrZero = Annotated[float, Field(ge=0.0, le=1e9)]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]  # mm
if TYPE_CHECKING:  # in a spec it is there, derived or given; only a section by itself may still be without it
    DerivedMillimetres = float
    DerivedMillimetresOrZero = float
else:
    DerivedMillimetres = Millimetres | None
    DerivedMillimetresOrZero = MillimetresOrZero | None
LEFT_OUT: Any = None  # of such a size
# Powers, intensities and weights: no light has less or more, and squares of any share of it stay within floating point.
Watts = Annotated[float, Field(ge=1e-30, le=1e12)]
Lumens = Annotated[float, Field(ge=1e-30, le=1e12)]
Weight = Annotated[float, Field(ge=0.0, le=1e12)]
# A relative name counts from the folder of the spec's file, in a script from the folder in which it runs.
FilePath = Annotated[Path, AfterValidator(_usable_path)]
Label = Annotated[str, Field(max_length=200), AfterValidator(_printable)]  # words of the user, shown on pages
CalendarDate = Annotated[str, BeforeValidator(iso_date)]  # 2026-01-31; a date of TOML, too
