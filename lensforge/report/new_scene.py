"""Spec of ``lensforge new``: from a light, an LED and a size to the tables of a spec, and to its checked text."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import reduce
from operator import attrgetter, getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lensforge.errors import InputError
from lensforge.light.lens_light import source_of
from lensforge.optics.material import MATERIALS
from lensforge.sources.build_source import cavity_around
from lensforge.spec import Spec, parse_spec
from lensforge.spec.derived_values import WHY, rounded_length
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.lens_section import LensShape, LightShape
from lensforge.spec.new_spec import new_text
from lensforge.spec.part_section import usual_flat_mm
from lensforge.spec.source_sections import RayfileSource
from lensforge.spec.tolerances_section import lets_light_in
from lensforge.spec.zoom_states import room_for_travel, travel_mm, zoom_states

if TYPE_CHECKING:  # torch, which the search needs, takes a second to load
    from lensforge.search.lens_advice import LensAdvice

Tables = dict[str, Any]  # of a spec, by their names

USUAL = "usual"
CUTTERS = f"radius of the shop's ball cutter in mm, {USUAL} (as such a lens is made), mould, or none (not made)"


def millimetres(given: str, answer: str, allowed: str) -> float:
    """Length (mm) in ``answer``. Raises :class:`InputError` that quotes ``given`` and says what is ``allowed``."""
    try:
        value = float(answer)
    except ValueError:
        value = 0.0
    if not 1e-6 <= value <= 1e9:
        raise InputError(f"{given}: must be {allowed}")
    return value


@dataclass(frozen=True)
class NewScene:
    """A scene without its lens: tables of ``light``, ``source`` and ``constraints``, and the ``material``, if any.

    ``light``: ``target``, ``receivers`` for a plane beside the axis, or the ``states`` of a zoom. ``of_source``: a note
    on the source. ``thin``: its lens is to be low. ``line_mm``: length of a line of light, along which a linear lens
    lies; None of other light.
    """

    name: str
    light: Tables
    source: Tables
    constraints: Tables
    material: str | None = None
    of_source: str = ""
    thin: bool = False
    line_mm: float | None = None

    @staticmethod
    def of(name: str, light: Tables, source: Tables, max_radius_mm: float, of_source: str = "") -> "NewScene":
        """The scene of these tables; the cavity around a ray file is measured. Raises :class:`InputError`."""
        known = "".join(
            character if character.isascii() and (character.isalnum() or character in "-_") else "_"
            for character in name
        )[:64]
        constraints: Tables = {"max_radius_mm": max_radius_mm}
        if source["kind"] == "rayfile":
            constraints |= cavity_around(RayfileSource(**deepcopy(source)))
        return NewScene(known or "lens", light, source, constraints, of_source=of_source)

    def zoomed(self, spot_deg: float, flood_deg: float) -> "NewScene":
        """The scene of a zoom between beams of these full widths, with room for the travel of its LED.

        Raises :class:`InputError` for a source that does not tell its size.
        """
        travel = travel_mm(spot_deg, flood_deg, self.constraints["max_radius_mm"])
        led = EmitterSection.kinds[self.source["kind"]](**deepcopy(self.source))
        room = room_for_travel(led.extent_mm or self.constraints["cavity_radius_mm"], travel)
        states = zoom_states(spot_deg, flood_deg, travel)
        return replace(self, light={"states": states}, constraints={**self.constraints, **room})

    def of_material(self, material: str | None) -> "NewScene":
        """The scene with a lens of this material. Raises :class:`InputError` for one that is not known."""
        if material is not None and material not in MATERIALS:
            raise InputError(f"--material {material}: must be one of {', '.join(MATERIALS)}")
        return replace(self, material=material)

    def require_thin(self, kind: str) -> None:
        """Raise :class:`InputError` for a thin lens of a ``kind`` that has none."""
        known = [name for name, section in LensShape.kinds.items() if section.may_be_thin]
        if self.thin and kind not in known:
            raise InputError(f"--thin: goes with --lens {' or '.join(known)}, not {kind!r}; leave one of the two out")

    @staticmethod
    def takes_material(kind: str) -> bool:
        """True for a lens that light enters."""
        return lets_light_in(LensShape.kinds[kind].roles)

    def advice(self) -> "LensAdvice":
        """Advice on the kinds of lens for its target. Raises :class:`InputError` where the usual one has no room."""
        from lensforge.search.lens_advice import LensAdvice, light_shape

        usual = self._spec(self.content(LensShape.usual_kind))
        shape = light_shape(usual)
        return LensAdvice.of(dict(self._specs(shape)), source_of(usual), shape)

    def _specs(self, shape: LightShape) -> Iterator[tuple[str, Spec]]:
        """A spec with each kind of lens that has room within these sizes, by its name."""
        from lensforge.search.start_faces import start_faces

        for kind in (kind for kind, section in LensShape.kinds.items() if section.is_advised):
            with suppress(InputError):
                made = self._spec(self.content(kind, shape=shape))
                start_faces(made)
                yield kind, made

    def content(self, kind: str, shop: Tables | None = None, shape: LightShape = "picture") -> Tables:
        """Tables of a spec with this ``kind`` of lens for light of a ``shape``; ``shop``: those of its making."""
        section = LensShape.kinds[kind]
        first = section.first_tables(shape)
        shaped = [role.name for role in section.roles if role.follows is None and not role.is_open]
        faces = {name: first["lens"].get(name, {}) for name in shaped}
        named = {} if kind == LensShape.usual_kind else {"kind": kind}
        material = {"material": self.material} if self.takes_material(kind) else {}
        tables = {
            "source": self.source,
            "lens": {**named, **material, **first["lens"], **faces},
            "constraints": self.constraints,
            **self.light,
            **(shop or {}),
            "base": first.get("base"),
            "optimise": first.get("optimise"),
        }
        if section.lies_along_y and self.line_mm is not None and "target" in tables:
            target = tables["target"]
            tables["target"] = {**target, "width_mm": target["height_mm"], "height_mm": target["width_mm"]}
            tables["lens"] = {**tables["lens"], "length_mm": self.line_mm}
        return {"name": self.name, **{name: deepcopy(table) for name, table in tables.items() if table is not None}}

    def tables(self, kind: str, cutter: str, shape: LightShape) -> Tables:
        """Tables of a spec with this ``kind`` of lens for light of a ``shape``.

        ``cutter``: one of the :data:`CUTTERS`.
        """
        unlimited = self._spec(self.content(kind, shape=shape))
        moulded = cutter == USUAL and unlimited.manufacture.process == "moulded"
        content = self.content(kind, _made_with("mould" if moulded else cutter, unlimited), shape)
        if self.thin:
            content = self._thinned(content, shape)
        made = self._spec(content)
        if _takes_flat(made):
            content["base"] = {**content.get("base", {}), "flat_mm": usual_flat_mm(made.base)}
        return content

    def _thinned(self, content: Tables, shape: LightShape) -> Tables:
        """``content`` with a thin lens, as low as its light allows or as the height that is given."""
        from lensforge.search.start_faces import start_conditions

        if shape != "round":
            raise InputError("--thin: the groove of a thin lens is round, and this light is not; leave --thin out")
        thick = self._spec(content)
        try:
            tables = thick.lens.thin_tables(start_conditions(thick))
        except InputError as error:
            raise InputError(f"--thin: {error}") from None
        merged = {name: {**content.get(name, {}), **table} for name, table in tables.items()}
        return {**content, **merged}

    def text(
        self,
        kind: str,
        cutter: str,
        folder: Path,
        examples: Sequence[str],
        *,
        force: bool,
        warn: Callable[[str], object],
    ) -> str:
        """TOML of the spec with derived values, after the check of what is possible. Raises :class:`InputError`.

        ``cutter``: one of the :data:`CUTTERS`; None for the usual ball, or a mould where no ball reaches. ``examples``:
        names of shipped specs, the nearest first. Files are named as from ``folder``. ``warn`` is called with a line
        for each doubt.
        """
        from lensforge.search.lens_advice import light_shape
        from lensforge.search.scene_check import SceneCheck

        shape = light_shape(self._spec(self.content(kind)))
        content = self.tables(kind, cutter, shape)
        made = self._spec(content)
        if cutter == USUAL and made.manufacture.process == "moulded":
            warn("no ball reaches the inner edges of this lens: it has the limits of a mould; --cutter selects others")
        if made.manufacture.process == "moulded":
            warn("manufacture.shrinkage is not given: ask the moulder for that of the plastic, such as 0.005")
        scenes = {name: SceneCheck.of(alone, source_of(alone)) for name, alone in made.by_state.items()}
        for scene in scenes.values():
            scene.require_light(force=force)
            for warning in scene.warnings():
                warn(warning)
        for warning in _unsuited(type(made.lens), shape):
            warn(warning)
        reasons = _with_derived(content, made)
        lit = content["receivers"][0]["targets"][0] if "receivers" in content else content.get("target", {})
        section = made.all_receivers[0]
        for table, read in ((content["source"], made.source), (lit, section.targets[0])):
            if "file" in table:
                table["file"] = _relative(attrgetter("file")(read).resolve(), folder)
        wanted = {name or "target": alone.all_receivers[0] for name, alone in made.by_state.items()}
        title = "; ".join(
            (
                made.source.title,
                *(f"{name}: {receiver.targets[0].description} {receiver.place}" for name, receiver in wanted.items()),
            )
        )
        bounds = "; ".join(f"{name or 'target'}: {scene.targets[0].possible_words}" for name, scene in scenes.items())
        possible = f"{bounds[:1].upper()}{bounds[1:]}, {made.lens.title} of largest radius."
        if examples:
            possible += f"\n# Nearest shipped examples: {', '.join(examples)}."
        head = title[:1].upper() + title[1:]
        return new_text(content, reasons, head, possible, list(_flange_for(made)), self.of_source)

    def _spec(self, content: Tables) -> Spec:
        return parse_spec(deepcopy(content), "new")


def _made_with(cutter: str, unlimited: Spec) -> Tables:
    """Tables on the making of a lens by one of the :data:`CUTTERS`, whose limits the search keeps.

    ``unlimited``: the spec without them.
    """
    if cutter == "none":
        return {"manufacture": {"process": "none"}}
    if cutter == "mould":
        return {"manufacture": {"process": "moulded"}, "tolerances": {"preset": "moulded"}}
    if unlimited.manufacture.process == "turned" or (cutter == USUAL and unlimited.manufacture.making.is_drawn):
        return {}
    usual_mm = unlimited.manufacture.cutter_radius_mm
    radius_mm = usual_mm if cutter == USUAL else millimetres(f"--cutter {cutter}", cutter, f"the {CUTTERS}")
    return {"manufacture": {"process": "milled", "cutter_radius_mm": radius_mm}}


def _takes_flat(made: Spec) -> bool:
    """True where a round base has room for a flat beside the lens, and its light is not round."""
    base = made.base_made
    round_light = all(map(made.lens.is_revolved, made.lens.names))
    return base.kind == "cylinder" and not round_light and made.constraints.max_radius_mm < usual_flat_mm(base)


def _flange_for(made: Spec) -> Iterator[str]:
    """The line of a flange, by which a moulded lens of a kind that takes one is filled and held."""
    if made.manufacture.process == "moulded" and "flange" in type(made.lens).model_fields:
        radius_mm = made.constraints.max_radius_mm
        wide = rounded_length(2.4 * radius_mm)
        thick = rounded_length(min(1.5, 0.15 * radius_mm))
        yield f"flange = {{ diameter_mm = {wide:g}, thickness_mm = {thick:g} }}  # to fill it at, and to hold it by"


def _with_derived(content: Tables, made: Spec) -> dict[str, str]:
    """Add the derived values of ``made`` to its tables; the reasons for them, under their dotted names."""
    reasons = {}
    for name, why in WHY.items():
        section, _, field = name.rpartition(".")
        if section.removeprefix("lens.") not in (*content, *made.lens.names):
            continue  # a face of another kind of lens
        value = attrgetter(name)(made)
        table = reduce(getitem, section.split("."), content)
        if field not in table and value is not None:
            table[field] = value
            reasons[name] = why
    return reasons


def _relative(file: Path, folder: Path) -> str:
    try:
        return file.relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(file)


_OF_TWO_FACES: dict[LightShape, str] = {"beside": "light to one side", "picture": "a picture"}


def _unsuited(kind: type[LensShape], shape: LightShape) -> Iterator[str]:
    """A line where another kind of lens suits light of that ``shape`` better."""
    if shape in _OF_TWO_FACES and shape not in kind.draws:
        fault = f"{_OF_TWO_FACES[shape]} takes two faces, --lens {LensShape.usual_kind}"
        yield f"lens: {fault}; a {kind.title} has a larger error there"
