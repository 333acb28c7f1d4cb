"""The specification of a design, read from TOML: validated once, immutable, every length in mm.

Each wrong field is reported in a line: its name, its value, what is allowed.
"""

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain, combinations
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import tomli_w
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from lensforge.errors import InputError, refused
from lensforge.optics.face_roles import CAVITY, bounding
from lensforge.optics.media import Media
from lensforge.public import public
from lensforge.results.arguments import with_known_names
from lensforge.results.files import write_file
from lensforge.results.validation import its_type
from lensforge.spec.application import Application, kinds_of_addons, require_all_below, with_tables
from lensforge.spec.bodies_section import BodySection, media_with, require_bodies
from lensforge.spec.crosstalk import has_crosstalk, limits_on_zones
from lensforge.spec.derived_values import derived_sizes, receiver_of
from lensforge.spec.double_lens import LensSection
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.feasible import require_drawn_over_plate, require_feasible
from lensforge.spec.housing_sections import (
    MOST_BODIES,
    MOST_SCENE_EVENTS,
    HousingSection,
    bodies_of,
    reflection_of,
    require_scene,
)
from lensforge.spec.lamps_section import AnyLamps, Lamps, lamps_of
from lensforge.spec.lamps_together import require_kinds, require_together
from lensforge.spec.lens_section import LensShape
from lensforge.spec.light_limits import (
    ColourSection,
    LightLimits,
    LimitSection,
    PhotometrySection,
    require_limits_fit,
    require_seen_from_afar,
)
from lensforge.spec.part_section import (
    BaseSection,
    DrawingSection,
    ManufactureSection,
    mouth_room_deg,
    undercut_room_deg,
    usual_ball_mm,
    usual_base,
)
from lensforge.spec.plate_section import PlateSection, require_plate
from lensforge.spec.processes import PROCESSES, Cutting, FaceLimits, Process
from lensforge.spec.receiver_fields import Receivers, ReceiverSection, named, require_target_fits
from lensforge.spec.receiver_sections import implied_receiver
from lensforge.spec.search_section import ConstraintsSection, EvaluateSection, OptimiseSection
from lensforge.spec.source_sections import NamedSource
from lensforge.spec.spec_files import NamedFrom, alike, changed, plain, read_toml, short
from lensforge.spec.spec_section import Section, check, fault_of, section_of
from lensforge.spec.state_section import StateSection, require_every_chip_lit, with_light_of_first
from lensforge.spec.target_sections import TargetSection
from lensforge.spec.tolerances_section import FaceTolerances, PartTolerances, TolerancesSection, lets_light_in
from lensforge.spec.trades import TradeName, trade_of

_Filled = TypeVar("_Filled", bound=Section)


def _filled(section: _Filled, derived: Mapping[str, Any]) -> _Filled:
    """``section`` and its tables with the ``derived`` values that they leave out; these count as left out."""
    given = {name: getattr(section, name) for name in section.model_fields_set}
    new = {
        name: _filled(getattr(section, name), value) if isinstance(value, Mapping) else value
        for name, value in derived.items()
        if isinstance(value, Mapping) or given.get(name) is None
    }
    if all(value is given.get(name) for name, value in new.items()):
        return section
    filled = type(section)(**{**given, **new})
    filled.model_fields_set.difference_update(name for name in new if given.get(name) is None)
    return filled


_MOST_STATES = 16
_MOST_BODIES = 8
_OF_GIVEN_LEVELS = ("steps_per_level", "rays")  # fields of optimise


def _unless(_other: str, description: str) -> Any:
    """A field without a default that a type checker lets out, as another one may be given in its place."""
    return Field(description=description)


@public
@with_tables
class Spec(Section):
    """One design: source, starting lens, constraints and target, and the settings of every stage."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] = Field(
        default="lens",
        description="Name of the design, by default the name of the file. Its results go to cad_out/NAME.",
    )
    source: EmitterSection = _unless(
        "sources",
        "The LED: where light starts, how much, and in which directions; or give `sources`, or `states` with theirs.",
    )
    sources: Annotated[tuple[NamedSource, ...], Field(max_length=_MOST_STATES)] = Field(
        default=(), description="LEDs that one lens is for, in the place of `source`. Figures are stated with each."
    )
    states: Annotated[tuple[StateSection, ...], Field(max_length=_MOST_STATES)] = Field(
        default=(),
        description="Conditions that one lens is for, such as spot and flood. Figures are stated in each. `source` "
        "and `target` may be left out; then those of the first state count.",
    )
    lens: LensShape = Field(
        default_factory=LensSection, description="Material, and the two surfaces from which the search starts."
    )
    bodies: Annotated[tuple[BodySection, ...], Field(max_length=_MOST_BODIES)] = Field(
        default=(), description="Given optics that the light passes behind the lens, in this order: domes, covers."
    )
    scene: Annotated[tuple[HousingSection, ...], Field(max_length=MOST_BODIES)] = Field(
        default=(), description="Bodies in the light behind the lens: a bezel, a tube, a wall, a cover, a room."
    )
    scene_events: Annotated[int, Field(ge=1, le=MOST_SCENE_EVENTS)] = Field(
        default=1,
        description="Most bodies of `scene` from which light goes on, one after another, by reflection or through a "
        "clear one, in which it may be reflected totally one time less.",
    )
    constraints: ConstraintsSection = Field(
        description="Limits that every lens of the search keeps: room for the LED, wall, size, and what can be made."
    )
    target: TargetSection | None = Field(
        default=None, description="The light that is wanted, with the receiver that it names; or give `receivers`."
    )
    receivers: Receivers = Field(
        default=(), description="Surfaces that the light falls on, each with its targets; or give `target` alone."
    )
    lamps: AnyLamps | None = Field(
        default=None, description="Lamps whose light every receiver sees together; by default one at the origin."
    )
    limits: LightLimits = Field(default=(), description="Light that must be at least, or at most, so much.")
    application: TradeName | None = Field(
        default=None,
        description="Trade that the light is for. Its figures, by which its people judge a light, are stated first. "
        "By default that of the limits, such as those of kind screen.",
    )
    if TYPE_CHECKING:  # tables that add-ons bring, for scripts that are checked
        roads: tuple[Application, ...] = ()
        offices: tuple[Application, ...] = ()
        sports: tuple[Application, ...] = ()
        routes: tuple[Application, ...] = ()
    colour: ColourSection | None = Field(default=None, description="Colour of the beam; by default it is not computed.")
    optimise: OptimiseSection = Field(default_factory=OptimiseSection, description="Settings of the search.")
    evaluate: EvaluateSection = Field(
        default_factory=EvaluateSection, description="Settings of the simulation of the finished lens."
    )
    base: BaseSection = Field(
        default_factory=BaseSection, description="The clamping base, which holds the lens below z = 0."
    )
    plate: PlateSection | None = Field(
        default=None, description="The plate that carries the lenses of `lamps` in one piece; by default none is made."
    )
    manufacture: ManufactureSection = Field(
        default_factory=ManufactureSection, description="Equipment of the shop, and names for its files."
    )
    drawing: DrawingSection = Field(
        default_factory=DrawingSection, description="Title block and notes of the drawing for the shop."
    )
    tolerances: TolerancesSection = Field(
        default_factory=TolerancesSection,
        description="Errors of part, mounting and LED, for `lensforge yield` and for a robust search.",
    )
    photometry: PhotometrySection = Field(
        default_factory=PhotometrySection,
        description="Lighting that the lens is for: general, or of an area or a road.",
    )

    @property
    def trade(self) -> TradeName | None:
        """The trade that its application or its limits tell; None for neither."""
        return trade_of(self.application, self.limits)

    @model_validator(mode="before")
    @classmethod
    def _first_of_several(cls, content: Any) -> Any:
        return with_light_of_first(content) if isinstance(content, Mapping) else content

    @model_serializer(mode="wrap")
    def _as_before_states(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        """The spec without what it lacks: one without states, application or scene keeps its hash of before them."""
        later = ("states", "application", "scene", "scene_events")
        return {name: value for name, value in write(self).items() if name not in later or (value and value != 1)}

    @check
    def _sources_are_told_apart(self) -> None:
        if not self.sources:
            return
        if self.states:
            raise ValueError("states and sources: both are given; give each LED as the source of a state")
        if (duplicate := alike(source.name for source in self.sources)) is not None:
            raise ValueError(f"sources: {duplicate}; give each its own")
        if self.source != self.sources[0].source:
            raise ValueError("source and sources: both are given; give the one LED, or all of them as sources")

    @check
    def _with_derived_values(self) -> None:
        """Derive what is left out; it counts as left out, so that it follows when the spec is changed or saved."""
        sizes = derived_sizes(self.each_source, self.lens, self.constraints, self.target)
        for name, derived in sizes.items():
            self._fill(name, derived)
        process = self.manufacture.process or (self.lens.made_alone if self.plate is None else "moulded")
        of_shop = {"cutter_radius_mm": usual_ball_mm(self.constraints), "required": PROCESSES[process].is_judged}
        self._fill("manufacture", {"process": process, **of_shop})
        hidden = self.lens.drawn_from_below is not None
        without_base = self.lens.drawn_mm is not None and not self.base.model_fields_set
        base = usual_base(self.base, self.manufacture, self.constraints, hidden)
        self._fill("base", {"kind": "none"} if without_base else base)

    def _fill(self, name: str, derived: Mapping[str, Any]) -> None:
        section: Section | None = getattr(self, name)
        if section is None:
            return
        try:
            object.__setattr__(self, name, _filled(section, derived))
        except InputError as error:
            raise ValueError(str(error).replace(type(section).__name__, name, 1)) from None

    def replace(self, changes: Mapping[str, object] | None = None, /, **sections: object) -> "Spec":
        """Make another spec: ``spec.replace(target={"distance_mm": 200.0})``, or dotted names in ``changes``.

        A section is replaced by an object of its kind, or changed by a table of fields; all others stay as they
        were given. Raises :class:`InputError` for an invalid change.
        """
        if changes is not None and not isinstance(changes, Mapping):
            raise InputError(
                f"replace: {short(changes)} is {its_type(changes)}; give a table of changes or sections by name"
            )
        content = changed(self.model_dump(exclude_unset=True), {**(changes or {}), **sections})
        return parse_spec(content, f"{self.name}, changed")

    def made_by(self, process: Process) -> "Spec":
        """The spec of the same body by another process. Raises :class:`InputError` for a part that it does not make.

        Drafts that follow from the process stay those of the body, which was not searched for it.
        """
        of_others = {
            name: ManufactureSection.model_fields[name].default
            for other in PROCESSES.values()
            for name in other.fields
            if other.name != process
        }
        changes: dict[str, Any] = {"base.draft_deg": self.manufacture.draft_deg(self.base.draft_deg)}
        if self.plate is not None or self.base.kind not in ("cylinder", "square"):
            changes = {}
        if (flange := self.lens.rim_flange) is not None:
            changes["lens.flange.draft_deg"] = self.manufacture.draft_deg(flange.draft_deg)
        return self.replace(
            changes,
            manufacture={**of_others, "process": process, "required": False},
        )

    def with_levels(self, levels: tuple[int, ...]) -> "Spec":
        """The spec of a lens whose ``lens.levels`` a search has chosen: with these numbers, without a time to keep."""
        if self.lens.levels == levels:
            return self
        changes: dict[str, Section] = {"lens": self.lens.changed(levels=levels)}
        if "seconds" in self.optimise.model_fields_set:
            changes["optimise"] = self._optimise_without({"seconds"})
        return self.changed(**changes)

    def with_automatic_levels(self) -> "Spec":
        """The spec of a search that chooses its levels, if the kind has some, without settings of given ones."""
        if type(self.lens).model_fields["levels"].default != "auto":
            return self
        lens = self.lens.changed(levels="auto")
        optimise = self._optimise_without({*_OF_GIVEN_LEVELS})
        return self.changed(lens=lens, optimise=optimise)

    def _optimise_without(self, names: set[str]) -> OptimiseSection:
        kept = self.optimise.model_fields_set - names
        return OptimiseSection(**{name: getattr(self.optimise, name) for name in kept})

    def save(self, path: Path | str) -> None:
        """Write the spec as TOML; :func:`load_spec` reads an equal one. Raises :class:`InputError`."""
        if not isinstance(path, Path | str):
            raise InputError(f"save: {short(path)} is {its_type(path)}; give the path of a TOML file")
        content = self.to_toml()
        # A NUL in the path, half a character in a text.
        with refused(repr(str(path)), "cannot be written (…); try another path", ValueError):
            write_file(path, content.encode())

    def to_toml(self) -> str:
        """Spec as TOML: what was given, each kind named."""
        return tomli_w.dumps(plain({"name": self.name, **self.model_dump(mode="json", exclude_unset=True)}))

    @check
    def _sizes_are_known(self) -> None:
        missing = " and ".join(f"constraints.{name}" for name in self.constraints.missing)
        if not missing:
            return
        kind = next(source.kind for source in self.each_source if source.extent_mm is None)
        needed = f"{missing}: missing: room for the LED, which a source of kind {kind!r} does not state; give it"
        raise ValueError(f"{needed} (`lensforge new` measures it in a ray file)")

    @check
    def _states_are_told_apart(self) -> None:
        if not self.all_states and has_crosstalk(self.limits):
            raise ValueError("limits: crosstalk is between states; give states, or a limit of kind zone")
        if not self.states:
            return
        if (duplicate := alike(state.name for state in self.states)) is not None:
            raise ValueError(f"states: {duplicate}; give each its own")
        if len(self.states) == 1:
            raise ValueError(f"states: {self.states[0].name!r} is the only one; add another, or state it in the spec")
        require_every_chip_lit(self.states)
        for state in self.states:
            if state.wavelength_nm is not None and self.lens.dispersion is None:
                raise ValueError(
                    f"states: {state.name}: wavelength_nm = {state.wavelength_nm:g}: {self.lens.material} has one "
                    "index at all wavelengths; name a material of the catalogue, or leave the wavelength out"
                )
        for (name, spec), (other, other_spec) in combinations(self.by_state.items(), 2):
            if spec == other_spec:
                raise ValueError(
                    f"states: {name!r} and {other!r} do not differ; change LED, place, temperature, target or limits"
                )

    @check
    def _sections_fit_together(self) -> None:
        require_bodies(self.bodies, self.lens, self.constraints, self.all_lamps)
        require_scene(self.scene, self.lens, self.all_lamps)
        for name, spec in self.by_state.items():
            with fault_of(f"states: {name}" if self.states else ""):
                spec._require_fitting_light()

    def _require_fitting_light(self) -> None:
        field = "receivers.centre_mm: distance of the plane" if self.receivers else "target.distance_mm"
        for receiver in self.all_receivers:
            receiver.require_outside(self.lens, self.constraints, field)
            require_target_fits(receiver, self.all_lamps.period_mm is not None)
        require_seen_from_afar(self.photometry, self.all_receivers, self.constraints)
        require_limits_fit(self.limits, self.all_receivers, self.lens.leaks, bodies_of(self.scene))
        require_all_below(self.applications, self.all_receivers)
        if self.evaluate.window_mm is not None and (self.target is None or self.target.distance_mm is None):
            raise ValueError(
                f"evaluate.window_mm = {self.evaluate.window_mm:g} goes with a target on a plane, target.distance_mm; "
                "leave it out, or give a receiver of kind plane its own window_mm"
            )

    @property
    def media(self) -> Media:
        """The media that light passes: those of the lens, and the bodies behind it; how bodies of the scene reflect."""
        walls = reflection_of(self.scene)
        return replace(media_with(self.bodies, self.lens), walls=walls, wall_events=self.scene_events)

    @property
    def grown_mm(self) -> float:
        """Length (mm) by which the lens at work reaches farther than its constraints ask of it as designed."""
        limits = self.constraints
        reach_mm = hypot(limits.max_radius_mm, limits.tallest_mm if self.lens.radius_about_axis else 0.0)
        strain = self.lens.scale - 1.0
        return strain * reach_mm + abs(strain) * self.base.seat_mm

    @property
    def all_states(self) -> tuple[StateSection, ...]:
        """The states that the lens is for: those of ``states``, or one with each of ``sources``; none for one alone."""
        return self.states or tuple(
            StateSection(name=led.name, weight=led.share, source=led.source) for led in self.sources
        )

    @property
    def by_state(self) -> "dict[str, Spec]":
        """The spec of each state by its name, all else as it is; "" is the name of the only one."""
        by_name = {state.name: self._in(state) for state in self.all_states}
        if not any(has_crosstalk(spec.limits) for spec in by_name.values()):
            return by_name or {"": self}
        receivers = {name: spec.all_receivers for name, spec in by_name.items()}
        with fault_of("limits"):
            zones = {name: limits_on_zones(spec.limits, name, receivers) for name, spec in by_name.items()}
        return {name: spec.changed(limits=zones[name]) for name, spec in by_name.items()}

    def _in(self, state: StateSection) -> "Spec":
        with fault_of(f"states: {state.name}"):
            changes = state.changes(self.source)
            if state.temperature_c is not None:
                changes["lens"] = self.lens.at(state.temperature_c)
        spec = self.changed(**changes, sources=(), states=())
        if state.target is not None:
            spec._fill("target", receiver_of(state.target))
        return spec

    def of_state(self, name: str) -> "Spec":
        """The spec of the state ``name``; itself for "". Raises :class:`InputError` where there is no such state."""
        by_state = self.by_state if name else {"": self}
        if name not in by_state:
            known = ", ".join(repr(state.name) for state in self.all_states) or "none, the lens has one condition"
            raise InputError(f"state = {name!r}: no state of that name; known: {known}")
        return by_state[name]

    @property
    def in_first_state(self) -> "Spec":
        """The spec of its first state; itself where there is one alone."""
        return next(iter(self.by_state.values()))

    @property
    def each_source(self) -> tuple[EmitterSection, ...]:
        """The LED as it stands in each state."""
        return tuple(spec.source for spec in self.by_state.values())

    @property
    def receivers_in_states(self) -> tuple[ReceiverSection, ...]:
        """The receivers of one state after the other."""
        return tuple(chain.from_iterable(spec.all_receivers for spec in self.by_state.values()))

    @property
    def limits_in_states(self) -> tuple[LimitSection, ...]:
        """The limits of one state after the other."""
        return tuple(chain.from_iterable(spec.limits for spec in self.by_state.values()))

    @property
    def base_made(self) -> BaseSection:
        """The base that is made, with its draft: none where a plate holds the lenses."""
        if self.plate is not None:
            return BaseSection(kind="none")
        draft_deg = self.manufacture.draft_deg(self.base.draft_deg)
        return self.base.changed(draft_deg=draft_deg) if draft_deg else self.base

    @property
    def all_lamps(self) -> Lamps:
        """The lamps whose light the receivers see."""
        return lamps_of(self.lamps)

    @property
    def of_one_lamp(self) -> "Spec":
        """The spec of the lens alone, at the origin."""
        return self if self.lamps is None else self.changed(lamps=None)

    @check
    def _lamps_have_room(self) -> None:
        if self.lamps is not None and not self.all_lamps.is_single:
            lenses = self.photometry.lenses
            receivers = self.receivers_in_states
            require_together(
                self.all_lamps, self.lens.apart(self.all_lamps), self.constraints, self.base_made, receivers, lenses
            )
            unfit = {"sources": bool(self.sources), "states": bool(self.states)}
            unfit["optimise.robust"] = bool(self.optimise.robust)
            require_kinds(self.lamps, receivers, unfit, self.limits)
            if self.evaluate.window_mm is not None:
                raise ValueError("evaluate.window_mm: of lamps together the whole receiver counts; leave it out")

    @check
    def _temperature_can_be_off(self) -> None:
        tolerance = self.tolerances.temperature_k
        amount = 0.0 if tolerance is None else tolerance.amount
        with fault_of("tolerances.temperature_k"):
            for sign in (-1.0, 1.0):
                self.lens.warmed_by(sign * amount)

    @check
    def _plate_holds_its_lenses(self) -> None:
        temperatures = {spec.lens.at_work_c for spec in self.by_state.values()} - {None}
        varied = self.tolerances.temperature_k is not None and self.tolerances.temperature_k.amount > 0.0
        if self.plate is not None and (temperatures or varied):
            raise ValueError("plate: its lenses are at the temperature of reference; leave out temperatures, or it")
        if self.plate is not None and self.lens.is_opaque:
            raise ValueError(f"plate: goes with lenses, not with lens.kind = {self.lens.kind!r}; leave it out")
        if self.plate is not None:
            require_plate(self.plate, self.lamps, self.constraints)
            if self.lens.flange_room_mm is not None:
                raise ValueError("lens.flange: the plate holds the lenses; leave out one of the two")
            require_drawn_over_plate(self.lens, self.manufacture)
            if self.base.kind == "step":
                raise ValueError("base.file: the plate holds the lenses; leave out one of the two")

    @property
    def all_receivers(self) -> tuple[ReceiverSection, ...]:
        """The receivers with their names; of a target alone the one that it implies."""
        if (self.target is None) == (not self.receivers):
            given = "both are given" if self.receivers else "neither is given"
            also = (
                "; limits judge the light, the search needs a target, too" if self.limits and not self.receivers else ""
            )
            raise ValueError(f"target or receivers: {given}; give one: what light is wanted, and where{also}")
        return (implied_receiver(self.target),) if self.target is not None else named(self.receivers)

    @property
    def part_tolerances(self) -> PartTolerances:
        """All tolerances: ``[tolerances]``, and those of the faces."""
        return PartTolerances.of(self.tolerances, self.lens.faces, self.lens.roles)

    def with_tolerances(self, tolerances: PartTolerances) -> "Spec":
        """The spec with these ``tolerances``. Raises :class:`InputError` for those of another lens's faces."""
        given = PartTolerances.of(tolerances, tolerances.faces, self.lens.roles)
        none = FaceTolerances()
        faces = {name: face.with_tolerances(given.faces.get(name, none)) for name, face in self.lens.faces.items()}
        section = TolerancesSection(**given.model_dump(exclude_unset=True, exclude={"faces"}))
        return self.changed(lens=self.lens.changed(**faces), tolerances=section)

    def is_cut(self, face: str) -> bool:
        """True for a face that is designed for the cutter of ``[manufacture]``: the base gives it room there.

        Its concave radius is bounded by the cutter's or more, or the whole part is required to be cut.
        """
        radius_mm = self.face_limits(face).concave_radius_mm
        designed = radius_mm is not None and radius_mm >= self.manufacture.tool_radius_mm
        return self.manufacture.cuts == "lens" and (designed or self.manufacture.required)

    def cutting(self, face: str) -> Cutting | None:
        """Cut of a face, of the lens or of an insert; None if no tool makes one."""
        return self.manufacture.making.cutting(self.lens.is_revolved(face))

    def asked_draft_deg(self, face: str) -> float | None:
        """Draft of a face that a check asks for: the stated one, or that of a mould; None without any."""
        stated_deg = self.lens.faces[face].draft_deg
        return self.manufacture.making.face_draft_deg if stated_deg is None else stated_deg

    def face_limits(self, face: str) -> FaceLimits:
        """Limits that a search keeps of a face: those stated, and of a face that it shapes what the process asks."""
        section = self.lens.faces[face]
        stated = FaceLimits(section.concave_radius_mm, section.draft_deg)
        if section.fixed is not None or self.lens.role(face).follows or not self.manufacture.required:
            return stated
        shop = self.manufacture
        undercut_deg = min(self._undercut_room_deg(face), shop.max_tilt_deg)
        return shop.making.asks(shop, self.lens.is_revolved(face), undercut_deg).and_stated(stated)

    def _undercut_room_deg(self, face: str) -> float:
        """Farthest (degrees) that base and mouth let a face be undercut; in a cavity by the mouth of the first one."""
        if self.lens.role(face).before != CAVITY:
            return 0.0 if self.plate is not None else undercut_room_deg(self.base, self.manufacture, self.constraints)
        start_mm = self.lens.faces[face].offset_mm
        is_alone = bounding(self.lens.roles, CAVITY) == (self.lens.role(face),)
        if start_mm is None or self.bore_depth_mm is None or not is_alone:
            return 0.0
        return mouth_room_deg(start_mm, start_mm + self.bore_depth_mm, self.manufacture.cutter_radius_mm)

    @property
    def bore_depth_mm(self) -> float | None:
        """Depth of the bore below a cavity; None where the spec does not know it: of a plate, and of a base's file."""
        if self.plate is not None or self.base.kind == "step":
            return None
        return 0.0 if self.base.kind == "none" else self.base.height_mm

    @property
    def applications(self) -> tuple[Application, ...]:
        """The entries of all tables of applications."""
        return tuple(entry for kind in kinds_of_addons() for entry in getattr(self, kind.table))

    @property
    def has_limits(self) -> bool:
        """True where the light must keep limits: those of ``limits``, of classes of applications, and on its colour."""
        of_colour = self.colour is not None and self.colour.has_limits
        return bool(self.limits_in_states or self.applications or of_colour)

    @property
    def counts_photons(self) -> bool:
        """True where its trade or one of its limits asks for photons, for which the spectrum is needed."""
        return self.trade == "horticulture" or any(limit.counts_photons for limit in self.limits_in_states)

    @property
    def has_uniform_region(self) -> bool:
        """True where a target names a region of uniform light."""
        targets = chain.from_iterable(section.targets for section in self.receivers_in_states)
        return any(target.pair("uniform") is not None for target in targets)

    @check
    def _settings_match_levels(self) -> None:
        given = self.optimise.model_fields_set
        if self.optimise.robust and self.lens.is_opaque:
            clear = " or ".join(repr(kind) for kind, section in LensShape.kinds.items() if lets_light_in(section.roles))
            raise ValueError(f"optimise.robust goes with lens.kind = {clear}, not {self.lens.kind!r}; leave it out")
        self.optimise.require_limits(bool(self.limits_in_states or self.applications))
        if self.lens.levels != "auto":
            if self.optimise.seconds is not None:
                raise ValueError('optimise.seconds goes with lens.levels = "auto"; leave out one of the two')
            steps = self.optimise.steps_per_level
            levels = self.lens.shape_levels
            if steps is not None and len(steps) != len(levels):
                first = "one for lens.profile, " if len(levels) > len(self.lens.levels) else ""
                raise ValueError(
                    f"optimise.steps_per_level has {len(steps)} numbers, must have {len(levels)}: {first}one for each "
                    f"of lens.levels = {list(self.lens.levels)}"
                )
            return
        for name in _OF_GIVEN_LEVELS:
            if name in given and getattr(self.optimise, name):
                raise ValueError(f"optimise.{name} goes with numbers in lens.levels; leave it out, or give levels")

    @check
    def _starts_within_the_largest_radius(self) -> None:
        largest = self.constraints.max_radius_mm
        for name, face in self.lens.faces.items():
            on_axis = self.lens.role(name).on_axis  # a height, which the radius about the axis does not limit
            if face.offset_mm is not None and face.offset_mm > largest and not on_axis:
                raise ValueError(
                    f"lens.{name}.offset_mm = {face.offset_mm:g} is beyond constraints.max_radius_mm = {largest:g}, "
                    "the largest lens; lower it, or raise the radius"
                )

    @check
    def _only_a_linear_lens_is_extruded(self) -> None:
        if self.manufacture.making.is_drawn and self.lens.drawn_mm is None:
            raise ValueError(
                f'manufacture.process = "{self.manufacture.process}": a lens of kind "{self.lens.kind}" is drawn '
                'through no die; take lens.kind = "extruded", or process = "milled" or "moulded"'
            )

    @check
    def _linear_lens_stands_alone(self) -> None:
        if self.lens.drawn_mm is None:
            return
        given = {
            "base": self.base.kind != "none",
            "plate": self.plate is not None,
            "bodies": bool(self.bodies),
            "constraints.keep_out": self.constraints.keep_out is not None,
        }
        for name in (name for name, is_given in given.items() if is_given):
            raise ValueError(
                f"{name}: does not go with lens.kind = {self.lens.kind!r}, drawn from end to end and standing on its "
                "feet; leave it out"
            )

    @check
    def _limits_can_be_kept(self) -> None:
        require_feasible(self.lens, self.constraints, self.manufacture)


@public
@with_known_names
def load_spec(path: Path | str) -> Spec:
    """Read a spec from a TOML file.

    Args:
        path: the file; those that it names count from its folder.
    Returns: The spec, with all defaults and derived sizes.
    Raises: :class:`InputError` with a line for each wrong field.
    Example:
        >>> spec = lf.load_spec("examples/quickstart.toml")
        >>> print(spec.replace(target={"distance_mm": 200.0}).to_toml())
    """
    if not isinstance(path, Path | str):
        raise InputError(f"load_spec: {short(path)} is {its_type(path)}; give the path of a TOML file")
    path = Path(path)
    content = read_toml(path, missing="`lensforge new` writes one, `lensforge examples` lists the shipped ones")
    content.setdefault("name", path.stem)
    return section_of(Spec, content, str(path), NamedFrom(path.parent, there=True))


def parse_spec(content: Mapping[str, object], origin: str, folder: Path | None = None) -> Spec:
    """Validate ``content``, whose files count from ``folder``; ``origin`` names it in the error."""
    return section_of(Spec, content, origin, None if folder is None else NamedFrom(folder, there=False))


def require_spec(spec: object, verb: str) -> Spec:
    """Return ``spec`` if it is one. Raises :class:`InputError` for a path or anything else where a spec belongs."""
    if isinstance(spec, Spec):
        return spec
    advice = "read it with load_spec first" if isinstance(spec, Path | str) else "make one with Spec(...) or load_spec"
    raise InputError(f"{verb}: {short(spec)} is {its_type(spec)}, no Spec; {advice}")
