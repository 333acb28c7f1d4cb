"""What every section of a spec has in common."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from lensforge.errors import InputError

_UNIONS = ("source", "target", "intensity", "spectrum", "fixed_inner", "fixed_outer")


class _Checked(type(BaseModel)):  # type: ignore[misc]  # pydantic's own metaclass, which has no public name
    """Turns the validation error of a section that a script constructs into the one line of the command line.

    A class that names its field ``positional`` takes that one without its name.
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
            raise first_error(error, cls.__name__) from None


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
        """Whether all fields are equal, arrays to the bit."""
        if type(self) is not type(other):
            return NotImplemented
        return all(_same(getattr(self, name), getattr(other, name)) for name in type(self).model_fields)

    def __hash__(self) -> int:
        return hash(self.model_dump_json())


def its_type(value: object) -> str:
    """The type of ``value`` for a message: ``a str``, ``an int``."""
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one == other)


def first_error(error: ValidationError, origin: str) -> InputError:
    """The one line for the first wrong field of what ``origin`` names, its value, and what is allowed."""
    first = error.errors(include_url=False)[0]
    field = _field(first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    given = first["input"]
    shown = repr(given) if isinstance(given, str | int | float | bool | Path) or given is None else type(given).__name__
    value = "" if isinstance(given, Mapping | BaseModel) else f" = {shown[:80]}"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    text = f"{origin}: {field}{value}: {message}{more}" if field or value else f"{origin}: {message}{more}"
    return InputError(" ".join(text.replace(": : ", ": ").split()))


def _field(location: tuple[int | str, ...]) -> str:
    """The path to a field as the user wrote it: without the ``kind`` that chose the form of a section."""
    return ".".join(
        str(part) for before, part in zip((None, *location), location, strict=False) if before not in _UNIONS
    )


# From a nanometre to a kilometre, with room: squares and ratios of lengths stay within floating point.
Millimetres = Annotated[float, Field(ge=1e-6, le=1e9)]
MillimetresOrZero = Annotated[float, Field(ge=0.0, le=1e9)]
Coordinate = Annotated[float, Field(ge=-1e9, le=1e9)]  # mm
# A relative name counts from the folder of the spec's file, in a script from the folder in which it runs.
FilePath = Annotated[Path, AfterValidator(lambda path: path.absolute())]
