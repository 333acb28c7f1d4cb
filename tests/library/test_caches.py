"""What is kept is kept by all that it depends on: asked again with one thing changed, the answer is the new one.

A cache without a row fails, but for those that hold no number.
"""

import functools
import importlib
import inspect
import json
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from addon_rows import addon_rows
from scenes import random_surface, small_spec, sphere

import lensforge
from lensforge.cad.boundary import lens_boundaries
from lensforge.cad.cutter_room import base_with_room, lens_plan
from lensforge.cad.form_error import fit_lens
from lensforge.cad.keep_out import read_keep_out
from lensforge.light.secondary_optics import tabled
from lensforge.optics.coatings import coating_tables, least_reflectance, reflectance_of
from lensforge.optics.exit_space import ExitColumn, _on_level
from lensforge.optics.media import Media, Medium, ReflectanceTable, SecondaryOptic
from lensforge.optics.scattering import RingScatter
from lensforge.scene.body_patches import BodyPatches
from lensforge.scene.housing import Housing
from lensforge.scene.lamp_pictures import _pictures
from lensforge.scene.lens import Lens, load_lens
from lensforge.scene.made_part import _noise
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.rough_faces import _tables
from lensforge.scene.target_pattern import target_light
from lensforge.search.face_fields import _directions
from lensforge.seeds import sobol
from lensforge.shop.face_samples import area_rule
from lensforge.shop.sheet import _width_points
from lensforge.spec import LensSection, TirSection
from lensforge.spec.fixed_surface import FixedSphere
from lensforge.spec.housing_sections import HousingFile
from lensforge.spec.tolerances_section import _causes
from lensforge.surfaces.asphere import sphere as ball
from lensforge.surfaces.bicubic_table import TableGrid, _cubic_pieces
from lensforge.surfaces.collimator import best_collimator
from lensforge.surfaces.grooved_collimator import ThinRoom, best_grooved_collimator
from lensforge.surfaces.reflector_cup import best_leaning_cup
from lensforge.surfaces.srbf import fibonacci_hemisphere

U = fibonacci_hemisphere(50)
NO_NUMBER = {  # pools, compiled functions, folders, words; and what is keyed by the object itself
    "kernels.compiled._folder_of", "kernels.parallel._pool", "kernels.precision.in_single",
    "cad.plate_mesh.lens_meshes", "scene.housing_room._require_beside_lens",
    "results.validation._alone", "search.constraint_points._extent_at", "search.constraint_points._outline",
}  # fmt: skip
BY_CONTENT = {
    "sources.modelled_rays._best",
    "spec.plate_section._read_outline",
    "surfaces.imported_face._sampled",
    "surfaces.solid_file._read",
    "surfaces.step_file._tested",
}
RINGS = RingScatter((0.0, 0.2, 0.7), ((0.0, 0.1, 0.4), (0.0, 0.3, 0.5)), (0.3, 0.9))
COATING = ReflectanceTable((0.0, 60.0), ((0.01, 0.05),))
PLANE = {"kind": "plane", "centre_mm": [0.0, 0.0, 100.0], "width_mm": 300.0, "height_mm": 300.0}
ROW = {"kind": "table", "places_mm": [[-30.0, 0.0], [30.0, 0.0]]}
BEST = {"index": 1.49, "radius_mm": 10.0, "side_mm": 1.0, "half_angle_rad": 0.1}


def lens(outer: float = 6.0, **changes: Any) -> Lens:
    return Lens.double(sphere(3.0), random_surface(2, outer, 0.01), small_spec(**changes), 0, "draft")


def receiver(lamps: dict[str, Any] = ROW, **changes: Any) -> Any:
    disc = [{"kind": "disc", "diameter_mm": 90.0}]
    spec = small_spec(
        target=None, lamps=lamps, base={"kind": "none"}, receivers=[{**PLANE, "targets": disc, **changes}]
    )
    return receivers_of(spec, 16)[0]


def coated(reflectance: float) -> Media:
    return small_spec(lens__outer={"offset_mm": 6.0, "coating": {"reflectance": reflectance}}).media


def rooms(of: Lens) -> list[float]:
    base = base_with_room(of)
    return [base.relief_step_mm or 0.0, base.relief_setback_mm or 0.0, base.bore_setback_mm or 0.0]


def target(diameter_mm: float, width_mm: float = 300.0) -> np.ndarray:
    plane = receiver(width_mm=width_mm)
    section = lensforge.PlaneReceiver(**{**PLANE, "targets": [{"kind": "disc", "diameter_mm": diameter_mm}]})
    return target_light(section.targets, plane)


CUT = {"lens__inner": {"offset_mm": 3.0, "concave_radius_mm": 1.0}, "lens__outer": {"offset_mm": 6.0, "draft_deg": 0.0}}


def wall_hits(thick: float, high: float, folder: Path) -> list[float]:
    """Corners of a wall of a file, whose name stays the same, at a height."""
    import trimesh

    trimesh.creation.box((9.0, 9.0, thick)).export(folder / "wall.stl")
    housing = Housing.of([HousingFile(name="wall", file=folder / "wall.stl", centre_mm=(0.0, 0.0, high))])
    assert housing is not None
    corners: list[float] = np.sort(housing.tree.corners[:, :, 2].ravel()).tolist()
    return corners


def lit_hits(height_mm: float, place_mm: tuple[float, float, float], radius_mm: float) -> list[list[float]]:
    """Corners of the sides of a box that light from a ball can meet."""
    from lensforge.spec.housing_sections import HousingBox

    housing = Housing.of([HousingBox(name="wall", size_mm=(9.0, 9.0, height_mm), centre_mm=(0.0, 0.0, 30.0))])
    assert housing is not None
    corners: list[list[float]] = np.sort(housing.lit_from([place_mm], radius_mm).tree.corners.reshape(-1, 9)).tolist()
    return corners


def opaque_corners(height_mm: float) -> list[list[float]]:
    """Corners of a box beside a clear one of the same height."""
    from lensforge.spec.housing_sections import HousingBox

    box = {"size_mm": (9.0, 9.0, height_mm), "centre_mm": (0.0, 0.0, 30.0)}
    clear = {"surface": "clear", "refractive_index": 1.5, "centre_mm": (20.0, 0.0, 30.0)}
    housing = Housing.of([HousingBox(name="wall", **box), HousingBox(name="pane", **box | clear)])
    assert housing is not None and housing.opaque is not None
    corners: list[list[float]] = np.sort(housing.opaque.tree.corners.reshape(-1, 9)).tolist()
    return corners


def wall_patches(thick: float, patch_mm: float, folder: Path) -> list[float]:
    """Areas of the patches of a wall of a file, whose name stays the same."""
    import trimesh

    trimesh.creation.box((9.0, 9.0, thick)).export(folder / "measured.stl")
    patches = BodyPatches.of(HousingFile(name="wall", file=folder / "measured.stl", patch_mm=patch_mm))
    areas: list[float] = np.sort(patches.areas_mm2).tolist()
    return areas


# By the cache: the question, and arguments of which the first two and any two others differ in one thing.
ASKED: dict[str, tuple[Callable[..., Any], list[tuple[Any, ...]]]] = {
    "cad.boundary.lens_boundaries": (
        lambda design: lens_boundaries(design)[1].faces[0].shape.radius(U), [(lens(),), (lens(6.5),)]),
    "cad.cutter_room.base_with_room": (rooms, [(lens(**CUT),), (lens(**CUT, manufacture__cutter_radius_mm=2.5),)]),
    "cad.cutter_room.lens_plan": (
        lambda design: lens_plan(design).base.height_mm, [(lens(),), (lens(base__height_mm=3.5),)]),
    "cad.form_error._fits": (lambda design: fit_lens(design)[1].faces[0].shape.control, [(lens(),), (lens(6.5),)]),
    "light.secondary_optics.tabled": (lambda *faces: tabled(SecondaryOptic("a", Medium(1.5), *faces)).tables,
                                    [(ball(7.0), ball(9.0)), (ball(7.0), ball(9.5)), (ball(7.5), ball(9.0))]),
    "optics.coatings.coating_tables": (
        lambda media, span: next(iter(coating_tables(media, span).faces.values())),
        [(coated(0.01), (500.0, 500.0)), (coated(0.03), (500.0, 500.0))]),
    "optics.coatings.reflectance_of": (
        lambda *all_: reflectance_of(*all_, (500.0, 500.0)).at(np.full(3, 500.0), np.array([1.0, 0.8, 0.3])),
        [(COATING, 1.0), (replace(COATING, reflectance=((0.02, 0.05),)), 1.0)]),
    "optics.coatings.least_reflectance": (
        least_reflectance, [(COATING, 1.0), (replace(COATING, reflectance=((0.02, 0.05),)), 1.0)]),
    "optics.exit_space._on_level": (
        lambda *all_: _on_level(*all_)[1],
        [(ExitColumn(5.0, ((0.0, 2.0),)), 50.0), (ExitColumn(5.5, ((0.0, 2.0),)), 50.0),
         (ExitColumn(5.0, ((0.0, 2.0),)), 60.0), (ExitColumn(5.0, ((0.0, 2.5),)), 50.0)]),
    "scene.body_patches._patches": (
        wall_patches, [(2.0, 3.0, Path()), (3.0, 3.0, Path()), (2.0, 1.5, Path())]),
    "scene.housing._housing": (wall_hits, [(2.0, 30.0, Path()), (3.0, 30.0, Path()), (2.0, 35.0, Path())]),
    "scene.housing._opaque": (opaque_corners, [(2.0,), (3.0,)]),
    "scene.housing._lit_tree": (
        lit_hits,
        [(2.0, (0.0, 0.0, 0.0), 3.0), (3.0, (0.0, 0.0, 0.0), 3.0), (2.0, (0.0, 0.0, 60.0), 3.0),
         (2.0, (0.0, 0.0, 0.0), 6.0)]),
    "scene.made_part._noise": (_noise, [(9, 2), (10, 2), (9, 3)]),
    "scene.lamp_pictures._pictures": (
        lambda design: [raster.receiver.pose.origin_mm for raster in _pictures(design).rasters],
        [(receiver(),), (receiver({**ROW, "places_mm": [[-30.0, 0.0], [40.0, 0.0]]}),),
         (receiver({**ROW, "turns_deg": [0.0, 20.0]}),), (receiver(centre_mm=[0.0, 0.0, 110.0]),)]),
    "scene.lens._lens_in": (lambda outer, folder: _of_file(outer, folder), [(6.0, Path()), (6.5, Path())]),
    "scene.rough_faces._tables": (
        lambda *all_: [column for shifts in (_tables(tuple(all_)),) for column in shifts],
        [(RINGS, None), (None, RINGS), (replace(RINGS, follows=False), None)]),
    "scene.target_pattern._drawn": (target, [(90.0, 300.0), (120.0, 300.0), (90.0, 200.0)]),
    "search.face_fields._directions": (_directions, [(TableGrid(9),), (TableGrid(11),)]),
    "seeds._few": (sobol, [(64, 4, 7), (64, 4, 8), (128, 4, 7), (64, 5, 7), (64, 4, 7, 1)]),
    "shop.face_samples.area_rule": (lambda *all_: area_rule(*all_).weights, [(24, 32), (25, 32), (24, 40)]),
    "shop.sheet._width_points": (_width_points, [("iii",), ("mmm",)]),
    "spec.fixed_surface._shape_of": (
        lambda radius, centre: FixedSphere(radius_mm=radius, centre_z_mm=centre).apex_mm,
        [(6.0, 0.0), (6.5, 0.0), (6.0, 0.3)]),
    "spec.tolerances_section._causes": (
        lambda kind: sorted(_causes(kind.roles)), [(LensSection,), (TirSection,)]),
    "surfaces.asphere._kept_profile": (
        lambda radius, centre: FixedSphere(radius_mm=radius, centre_z_mm=centre).surface.radius(U),
        [(6.0, 0.0), (6.5, 0.0), (6.0, 0.3)]),
    "surfaces.bicubic_table._cubic_pieces": (lambda order: [list(row) for row in _cubic_pieces(order)], [(0,), (1,)]),
    "surfaces.collimator.best_collimator": (
        lambda **fields: [float(size) for size in vars(best_collimator(**fields)).values() if isinstance(size, float)],
[BEST, BEST | {"radius_mm": 12.0}, BEST | {"draft_rad": 0.1}]),
    "surfaces.grooved_collimator.best_grooved_collimator": (
        lambda height, radius, draft: list(vars(best_grooved_collimator(
            1.5, ThinRoom(height, radius, 0.5, 1.0), 1.0, 0.1, draft_rad=draft)).values()),
        [(9.0, 15.0, 0.035), (8.0, 15.0, 0.035), (9.0, 9.0, 0.035), (9.0, 15.0, 0.08)]),
    "surfaces.reflector_cup.best_leaning_cup": (
        lambda *sizes: list(vars(best_leaning_cup(*sizes)).values()),
        [(radius, 1.0, 0.4, 0.3, 0.88, 0.9, 20.0, draft) for radius, draft in ((12.0, 0.0), (12.0, 0.1), (9.0, 0.0))],
    ),
    **addon_rows("CACHES"),
}  # fmt: skip


def _of_file(outer: float, folder: Path) -> np.ndarray:
    path = folder / "lens.json"
    lens(outer).save(path)
    return load_lens(path).outer.radius(U)


def caches() -> Iterator[str]:
    """The caches of the package, of functions that take arguments."""
    for module in pkgutil.walk_packages(lensforge.__path__, "lensforge."):
        if not module.name.endswith("__main__"):
            for name, member in vars(importlib.import_module(module.name)).items():
                local = getattr(member, "__module__", "") == module.name
                if local and isinstance(member, functools._lru_cache_wrapper) and inspect.signature(member).parameters:
                    yield f"{module.name.partition('.')[2]}.{name}"


def test_every_cache_has_a_row() -> None:
    names = set(caches())
    assert names == {*ASKED, *NO_NUMBER, *BY_CONTENT, "cad.keep_out._meshed"}
    for name in (*BY_CONTENT, "cad.keep_out._meshed", "scene.lens._lens_in"):
        module, _, function = name.rpartition(".")
        first = next(
            iter(inspect.signature(getattr(importlib.import_module(f"lensforge.{module}"), function)).parameters)
        )
        assert first in ("content", "file"), "the bytes that were read"


def answered(ask: Callable[..., Any], arguments: Any) -> Any:
    return ask(**arguments) if isinstance(arguments, dict) else ask(*arguments)


@pytest.mark.parametrize("name", ASKED)
def test_an_answer_is_that_of_what_is_asked(name: str, tmp_path: Path) -> None:
    """No two are alike though the others are kept, and each is the same when asked again after all others."""
    ask, asked = ASKED[name]
    asked = [
        tuple(tmp_path if argument == Path() else argument for argument in call) if isinstance(call, tuple) else call
        for call in asked
    ]
    module, _, function = name.rpartition(".")
    kept = getattr(importlib.import_module(f"lensforge.{module}"), function)
    kept.cache_clear()
    answers = [_plain(answered(ask, arguments)) for arguments in asked]
    assert len({json.dumps(answer) for answer in answers}) == len(asked)
    for arguments, wanted in zip(asked[::-1], answers[::-1], strict=True):
        assert _plain(answered(ask, arguments)) == wanted


def _plain(answer: Any) -> Any:
    if isinstance(answer, np.ndarray):
        return answer.tolist()
    return [_plain(part) for part in answer] if isinstance(answer, list | tuple) else answer


@pytest.mark.usefixtures("cad_read_here")
def test_a_keep_out_of_the_same_name_is_another_one(tmp_path: Path) -> None:
    import cadquery as cq

    tall = []
    for height in (2.0, 3.0, 2.0):
        cq.exporters.export(cq.Workplane().box(1.0, 1.0, height), str(tmp_path / "clip.step"))
        vertices = read_keep_out(tmp_path / "clip.step").solids[0].vertices
        tall.append(float(np.ptp(vertices[:, 2])))
    assert tall == pytest.approx([2.0, 3.0, 2.0])
