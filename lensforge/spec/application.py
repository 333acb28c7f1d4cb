"""Applications: what the lamps of a lens are for, each with the class of a standard that its light is to reach.

A spec has them in tables of their own, such as ``[[roads]]``, which add-ons bring. The intensities of the lamps judge
them.
"""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Annotated, ClassVar, Self, TypeVar

from pydantic import Field

from lensforge.addon import absent_tables, usable_addons
from lensforge.public import public
from lensforge.results.registered_kinds import add_empty_list, add_list
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.receiver_sections import FarFieldReceiver
from lensforge.spec.spec_section import Label, Section

MOST_APPLICATIONS = 32  # of one table
_ALL_BELOW = 90.0  # degrees from the axis: all that is below a lamp
_SAME = 0.01  # relative: what is stated twice agrees this well

_Spec = TypeVar("_Spec", bound=Section)


@public
class Application(Section):
    """Place that equal lamps of the lens light, and the class of a standard that they are to reach there.

    ``table``: name of its table in a spec; ``of_table``: description of that; ``noun``: what one of its entries is.
    """

    table: ClassVar[str]
    of_table: ClassVar[str]
    noun: ClassVar[str]

    name: Label | None = Field(default=None, description="Name in records and on pages.")
    share: Annotated[float, Field(ge=1e-12, le=1000.0)] = Field(
        default=1.0,
        description="Weight in the search of what its class lacks, beside those of other entries; the classes of "
        "all must be held.",
    )
    lighting_class: str = Field(description="Class of a standard.")
    lamp_lm: Annotated[float, Field(ge=1e-9, le=1e9)] | None = Field(
        default=None,
        description="Luminous flux of the sources of a lamp; by default of the source times photometry.lenses, or "
        "as a file states.",
    )

    @property
    def height_m(self) -> float | None:
        """Height of the lamps above what they light; None if they have none."""
        return None

    @property
    def summary(self) -> str:
        """Its class, and what else tells it from others, in words."""
        return self.lighting_class

    @classmethod
    def warnings(cls, table: Sequence[Self], receivers: Sequence[ReceiverSection]) -> Iterator[str]:
        """Warn of what the ``table`` and the receivers of a spec state twice and differently."""
        return iter(())


def kinds_of_addons() -> tuple[type[Application], ...]:
    """All applications that add-ons bring."""
    return tuple(kind for addon in usable_addons() for kind in addon.applications())


def with_tables(spec: type[_Spec]) -> type[_Spec]:
    """A spec with a field more for each table of applications that an add-on brings."""
    for kind in kinds_of_addons():
        field = Field(default=(), max_length=MOST_APPLICATIONS, description=kind.of_table)
        add_list(spec, kind.table, kind, field)
    for table, fault in absent_tables().items():
        add_empty_list(spec, table, fault)
    return spec


def names_of(applications: Sequence[Application]) -> tuple[str, ...]:
    """A name for each, table by table: its own, or its noun, with a number where the table has several."""
    tables = [[*entries] for _, entries in groupby(applications, key=type)]
    return tuple(
        application.name or (application.noun if len(table) == 1 else f"{application.noun} {number}")
        for table in tables
        for number, application in enumerate(table, start=1)
    )


def name_before(label: str, names: Iterable[str]) -> str | None:
    """The longest of ``names`` with which the ``label`` of a limit begins, as in ``name: figure``, or None."""
    before = [name for name in names if label.startswith(f"{name}: ")]
    return max(before, key=len, default=None)


def require_all_below(applications: Sequence[Application], receivers: Sequence[ReceiverSection]) -> None:
    """Raise ``ValueError`` for applications without a far field that has all light below a lamp."""
    far = next((receiver for receiver in receivers if isinstance(receiver, FarFieldReceiver)), None)
    if applications and (far is None or far.half_angle_deg < _ALL_BELOW):
        far_fields = "there is none" if far is None else f"the first has half_angle_deg = {far.half_angle_deg:g}"
        raise ValueError(
            f"{applications[0].table}: their far lamps and their glare are light at up to {_ALL_BELOW:g} degrees from "
            f"the axis, on a receiver of kind far_field; {far_fields}; give it half_angle_deg = {_ALL_BELOW:g}"
        )


def application_warnings(
    applications: Sequence[Application], receivers: Sequence[ReceiverSection], lenses: int, source_lm: float | None
) -> Iterator[str]:
    """Warn of what a spec states twice and differently, such as the lumens of a lamp of ``lenses``.

    ``source_lm``: lumens of the source of one lens, where they are known; of one lens alone nobody counts them.
    """
    whole_lm = lenses * (source_lm or 0.0)
    for application, name in zip(applications, names_of(applications), strict=True):
        lamp_lm = application.lamp_lm
        if lamp_lm and whole_lm and lenses > 1 and abs(lamp_lm / whole_lm - 1.0) > _SAME:
            yield (
                f"{application.table}: {name}: lamp_lm = {lamp_lm:g}, but {lenses} lenses over {source_lm:.4g} lm have "
                f"{whole_lm:.4g} lm: its light is judged with the former, the files have the latter; correct one, or "
                "leave out lamp_lm"
            )
    for kind in kinds_of_addons():
        table = [application for application in applications if type(application) is kind]
        yield from kind.warnings(table, receivers)
