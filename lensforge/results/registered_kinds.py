"""Records and sections of several kinds: a class that extends such a base and names its ``kind`` is one of them.

A field of the base takes any of its kinds, chosen by ``kind``, wherever they are defined: in the package, or in a
script of a user's own.
"""

from collections.abc import Callable, Iterator
from functools import reduce
from inspect import get_annotations
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, GetCoreSchemaHandler
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, core_schema

from lensforge.errors import InputError
from lensforge.public import public


@public
class OfSeveralKinds(BaseModel):
    """A direct subclass is the base of several kinds, ``kinds`` by their names.

    A kind is a class that extends the base and has a field ``kind: Literal["name"]`` of its own: it registers itself.
    Raises :class:`InputError` for a name that another class has. ``usual_kind``: kind of a table that names none; by
    default every table has to name one.
    """

    if TYPE_CHECKING:  # a field of every kind; where it stands among the others its class says
        kind: str

    model_config = ConfigDict(defer_build=True)

    kinds: ClassVar[dict[str, type[Any]]]
    usual_kind: ClassVar[str | None] = None
    has_schema: ClassVar[bool]  # a class with a field of the base is built already, from the kinds that there were

    @classmethod
    def __pydantic_init_subclass__(cls, **settings: Any) -> None:
        super().__pydantic_init_subclass__(**settings)
        if OfSeveralKinds in cls.__bases__:
            cls.kinds = {}
            cls.has_schema = False
        elif (kind := kind_of(cls)) is not None and "kind" in get_annotations(cls):
            known = cls.kinds.setdefault(kind, cls)
            written_in = vars(known).get("_written_in", known.__module__)  # a public class names the library itself
            if (written_in, known.__qualname__) != (cls.__module__, cls.__qualname__):
                raise InputError(f"{cls.__name__}: kind = {kind!r} is that of {known.__name__}; take another name")
            cls.kinds[kind] = cls  # a cell of a notebook that runs again makes its class anew
            cls.build_holders_again()

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """The schema of any of the kinds for the base, and of a kind its own."""
        if not _is_base(cls):
            finished: Callable[[CoreSchema], CoreSchema] | None = getattr(cls, "finished_schema", None)
            return handler(source) if finished is None else finished(handler(source))
        cls.has_schema = True
        if cls.usual_kind is None:
            return handler.generate_schema(Annotated[reduce(or_, cls.kinds.values()), Field(discriminator="kind")])
        choices = {kind: handler.generate_schema(model) for kind, model in cls.kinds.items()}
        return core_schema.tagged_union_schema(choices, discriminator=cls._kind_in)

    @classmethod
    def _kind_in(cls, value: Any) -> str | None:
        """The kind of a table or an object; the usual one if none is named."""
        usual = cls.usual_kind
        kind = value.get("kind", usual) if isinstance(value, dict) else getattr(value, "kind", usual)
        return kind if isinstance(kind, str) else None

    @classmethod
    def build_holders_again(cls) -> None:
        """Rebuild all classes that hold the base and were built before its present kinds."""
        known: dict[type[BaseModel], bool] = {}
        for model in _extending(BaseModel) if cls.has_schema else ():
            _build_again(model, cls.kinds, known)


def _is_base(model: type[BaseModel]) -> bool:
    return "kinds" in vars(model)


def kind_of(model: type[BaseModel]) -> str | None:
    """The ``kind`` that names a class among others; None for a class without one."""
    field = model.model_fields.get("kind")
    named = None if field is None else get_args(field.annotation)
    return named[0] if named and len(named) == 1 else None


def add_list(model: type[BaseModel], name: str, entry: type[BaseModel], field: Any) -> None:
    """Add a list ``field`` of any number of entries to a class not used yet, as an add-on does."""
    several: Any = tuple
    model.__annotations__[name] = several[entry, ...]
    model.model_fields[name] = FieldInfo.from_annotated_attribute(several[entry, ...], field)


def add_empty_list(model: type[BaseModel], name: str, fault: str) -> None:
    """Add a list that must be empty to such a class: any entry is refused with ``fault``."""

    def refuse(given: Any) -> Any:
        if given:
            raise ValueError(fault)
        return ()

    empty: Any = Annotated[tuple[()], BeforeValidator(refuse)]
    model.__annotations__[name] = empty
    field = Field(default=(), description=f"Empty: {fault}.")
    model.model_fields[name] = FieldInfo.from_annotated_attribute(empty, field)


def models_in(annotation: Any) -> tuple[type[BaseModel], ...]:
    """The one or more classes that a field may hold; for a base all of its kinds."""
    models: dict[type[BaseModel], None] = {}
    for model in _named_in(annotation):
        models |= dict.fromkeys(
            model.kinds.values() if issubclass(model, OfSeveralKinds) and _is_base(model) else [model]
        )
    return tuple(models)


def _named_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and get_origin(annotation) is None:
        if issubclass(annotation, BaseModel):
            yield annotation
        return
    inner = get_args(annotation)
    for part in inner[:1] if get_origin(annotation) is Annotated else inner:
        yield from _named_in(part)


def _extending(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for subclass in model.__subclasses__():
        yield subclass
        yield from _extending(subclass)


def _build_again(model: type[BaseModel], kinds: dict[str, type[Any]], known: dict[type[BaseModel], bool]) -> bool:
    """Rebuild a class if it holds the base of ``kinds`` at any depth, inner classes first; True if so."""
    if model not in known:
        known[model] = False  # of a class within itself
        annotations = [field.annotation for field in model.model_fields.values()]
        of_base = any(vars(model_in).get("kinds") is kinds for part in annotations for model_in in _named_in(part))
        within = [_build_again(inner, kinds, known) for part in annotations for inner in models_in(part)]
        known[model] = of_base or any(within)
        if known[model] and model.__pydantic_complete__:
            model.model_rebuild(force=True)
    return known[model]
