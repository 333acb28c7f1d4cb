"""Bodies in the light against Mitsuba 3: a tube with a bezel, a grille, a ribbed cover, a rail of three lamps, a room.

    pip install lensforge[mitsuba]
    python benchmarks/mitsuba_scenes.py [--rays 65536] [--seed 7] [--only "ribbed cover"]

Light leaves the lens by our tracer, as other tests hold that to Mitsuba; the rays are those by which verification
draws a source. What they meet is Mitsuba's: its cylinders, disks and cubes, meshes of trimesh, its diffuse reflection,
its dielectric with the polarisation of light. Of that, light is followed that enters, leaves, or is reflected totally.
Prints a table: each figure, ours and Mitsuba's with their standard errors, and the distance over both.
"""

import lensforge as lf  # before torch, whose idle threads then sleep

# isort: split
import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, NamedTuple

import mitsuba as mi
import numpy as np
import trimesh

from lensforge.light.lens_light import searched_source
from lensforge.light.simulation import TracedLens
from lensforge.proof.proof_inputs import independent_rays
from lensforge.search.start_faces import start_faces
from lensforge.spec import parse_spec
from lensforge.spec.accuracy import PRESETS

BASIS: dict[str, Any] = {
    "name": "scene",
    "source": {"kind": "square", "side_mm": 1.0, "flux_w": 1.0},
    "lens": {"levels": [9], "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}, "symmetry": "none"},
    "constraints": {
        "cavity_height_mm": 0.5, "cavity_radius_mm": 1.0, "min_thickness_mm": 1.0, "max_radius_mm": 7.0,
    },
    "target": {"kind": "disc", "diameter_mm": 80.0, "distance_mm": 150.0, "receiver_mm": 160.0},
    "base": {"diameter_mm": 16.0},
    "manufacture": {"required": False},
    "evaluate": {"rays": 2**20, "pixels": 32},
}  # fmt: skip
DISTANCE_MM, HALF_MM = 150.0, 80.0  # of the receiver
TUBE = (20.0, 16.0, 30.0)  # outer radius, bore, length of the tube; it stands 15 to 45 mm above the LED
OPENING = 12.0  # of the bezel on it, 2 mm thick
RIBS = 9  # of the grille, 3 mm wide, 8 mm high, every 9 mm
RAIL = (16.0, 220.0)  # radius and length of the handrail
COVER = (120.0, 2.0, 4.0)  # width and thickness of the clear cover, 25 mm above the LED, and the height of its ribs
TEETH = 20  # of the cover, from flank to flank at 67 degrees: light leaves one and enters the next
INDEX = 1.49
MOST = 100  # faces that Mitsuba follows light to
EVENTS = 8  # bodies and total reflections; Mitsuba follows all
ROOM = (400.0, 300.0, 240.0)
SHARES = {"floor": 0.3, "ceiling": 0.8, "walls": 0.5}
FLOOR, CEILING = "room-floor", "room-ceiling"


class Scene(NamedTuple):
    """Changes of the spec, Mitsuba's shapes, and the figures of both by name.

    ``clear``: light goes through them. ``reflections``: of a room, that are counted.
    """

    changes: dict[str, Any]
    shapes: dict[str, Any]
    figures: Callable[[lf.Light], Iterator[tuple[str, float, float]]]
    counted: Callable[["Hits"], dict[str, np.ndarray]]
    clear: bool = False
    reflections: int = 1


class Hits(NamedTuple):
    """Rays with their flux and places on the receiver, and the paths to it, to the first body, and its name."""

    flux: np.ndarray
    window: np.ndarray
    ahead: np.ndarray
    names: np.ndarray
    bounced: np.ndarray  # names of the sides that a ray meets then, one after another
    taken: np.ndarray  # flux that a clear body keeps


def saved(mesh: trimesh.Trimesh) -> dict[str, Any]:
    """A mesh as Mitsuba reads it."""
    path = Path(mkdtemp()) / "body.ply"
    mesh.export(path)
    return {"type": "ply", "filename": str(path), "face_normals": True}


def annulus(inner: float, outer: float, height: float, z: float) -> dict[str, Any]:
    """A ring whose middle is at z."""
    ring = trimesh.creation.annulus(inner, outer, height, sections=1024)
    ring.apply_translation([0.0, 0.0, z])
    return saved(ring)


def cover() -> trimesh.Trimesh:
    """A plate with ribs of a triangular section along y, on the side away from the lens."""
    width, thick, high = COVER
    across = np.linspace(-0.5 * width, 0.5 * width, 2 * TEETH + 1)
    tops = thick + high * (np.arange(len(across)) % 2)
    outline = np.concatenate([np.stack([across, tops], axis=1), np.stack([across, 0.0 * across], axis=1)])
    count = len(across)
    side = [[k, k + 1, count + k] for k in range(count - 1)]
    side += [[k + 1, count + k + 1, count + k] for k in range(count - 1)]
    around = [*range(count), *reversed(range(count, 2 * count))]
    points = [[x, y, 25.0 + z] for y in (-0.5 * width, 0.5 * width) for x, z in outline]
    faces = [*side, *([c + 2 * count, b + 2 * count, a + 2 * count] for a, b, c in side)]
    for a, b in zip(around, np.roll(around, -1).tolist(), strict=True):
        faces += [[a, a + 2 * count, b], [b, a + 2 * count, b + 2 * count]]
    mesh = trimesh.Trimesh(points, faces)
    mesh.fix_normals()
    assert mesh.is_watertight and mesh.volume > 0.0
    return mesh


def blocked_and_lit(light: lf.Light) -> Iterator[tuple[str, float, float]]:
    """Light in the window, and what each body takes."""
    (receiver,) = light.receivers
    yield "in the window", receiver.efficiency.value, receiver.efficiency.standard_error or 0.0
    for body in receiver.blocked:
        yield f"blocked by {body.name}", body.share.value, body.share.standard_error or 0.0


def on_bodies(light: lf.Light) -> Iterator[tuple[str, float, float]]:
    """Share of the light on each measured body."""
    for body in light.on_bodies:
        area = 1e-6 * body.area_mm2
        yield f"on {body.name}", area * body.mean.value, area * (body.mean.standard_error or 0.0)


def ends(hits: Hits) -> dict[str, np.ndarray]:
    """Flux of each ray that counts for a figure of blocked light."""
    met = hits.ahead & (hits.names != "")
    parts = {f"blocked by {name}": hits.flux * (met & (hits.names == name)) for name in np.unique(hits.names[met])}
    return {"in the window": hits.flux * (hits.window & ~met)} | parts


def through(hits: Hits) -> dict[str, np.ndarray]:
    """Flux of each ray behind a clear body, in the window, and that which the body keeps."""
    return {"in the window": hits.flux * hits.window, "blocked by cover": hits.taken}


def on_rail(hits: Hits) -> dict[str, np.ndarray]:
    """Flux of each ray that meets the handrail, whose lamps each have the flux of one."""
    return {"on rail": 3.0 * hits.flux * (hits.names == "rail")}


def on_sides(hits: Hits) -> dict[str, np.ndarray]:
    """Flux of each ray on every side, direct and by way of others."""
    names = (FLOOR, CEILING, *(f"room-wall-{number}" for number in range(1, 5)))
    on = {f"on {name}": np.zeros(len(hits.flux)) for name in names}
    flux = hits.flux
    for met in (hits.names, *hits.bounced.T):
        for name in names:
            on[f"on {name}"] += flux * (met == name)
        flux = flux * [SHARES.get(name.removeprefix("room-"), SHARES["walls"]) for name in met.tolist()]
    return on


def side_at(place: np.ndarray) -> str:
    """Name of the side of the room in which a place lies."""
    apart = place / (0.5 * np.array(ROOM))
    axis = int(np.abs(apart).argmax())
    names = (("room-wall-3", "room-wall-1"), ("room-wall-4", "room-wall-2"), (CEILING, FLOOR))
    return names[axis][int(apart[axis] > 0.0)]


def scenes() -> dict[str, Scene]:
    """All of them, by name."""
    to = mi.ScalarTransform4f
    outer, bore, length = TUBE
    ribs = [[9.0 * (number - RIBS // 2), 0.0, 30.0] for number in range(RIBS)]
    radius, long = RAIL
    middle, turn = [10.0, -6.0, 120.0], to().rotate([0, 1, 0], 70.0)
    rail = {"kind": "cylinder", "name": "rail", "radius_mm": radius, "length_mm": long, "centre_mm": middle}
    ends_of_rail = {
        f"rail {sign}": {
            "type": "disk",
            "to_world": to().translate(middle) @ turn @ to().translate([0, 0, sign * long / 2]) @ to().scale(radius),
        }
        for sign in (-1.0, 1.0)
    }
    room = {"kind": "room", "name": "room", "size_mm": ROOM, "centre_mm": (12.0, -30.0, 85.0), "patch_mm": 60.0}
    tube = {"kind": "cylinder", "name": "tube", "radius_mm": outer, "bore_radius_mm": bore, "length_mm": length}
    bezel = {"kind": "cylinder", "name": "bezel", "radius_mm": 40.0, "bore_radius_mm": OPENING, "length_mm": 2.0}
    rib = {"kind": "box", "size_mm": [3.0, 120.0, 8.0]}
    lamps = {"kind": "table", "places_mm": [[-70.0, 0.0], [0.0, 20.0], [70.0, 5.0]]}
    exported = Path(mkdtemp()) / "cover.stl"
    cover().export(exported)
    diffuse = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}}
    sides = room | {"surface": "diffuse", "reflectance": SHARES["walls"]}
    sides |= {f"{side}_reflectance": SHARES[side] for side in ("floor", "ceiling")}
    cube = to().translate([12.0, -30.0, 85.0]) @ to().scale([0.5 * side for side in ROOM])
    in_room = {"scene": [sides]}, {"room": {"type": "cube", "bsdf": diffuse, "to_world": cube}}, on_bodies, on_sides
    return {
        "tube with a bezel": Scene(
            {"scene": [tube | {"centre_mm": [0.0, 0.0, 30.0]}, bezel | {"centre_mm": [0.0, 0.0, 46.5]}]},
            {"tube": annulus(bore, outer, length, 30.0), "bezel": annulus(OPENING, 40.0, 2.0, 46.5)},
            blocked_and_lit,
            ends,
        ),
        "black grille": Scene(
            {"scene": [rib | {"name": f"rib-{k}", "centre_mm": place} for k, place in enumerate(ribs)]},
            {
                f"rib-{k}": {"type": "cube", "to_world": to().translate(place) @ to().scale([1.5, 60.0, 4.0])}
                for k, place in enumerate(ribs)
            },
            blocked_and_lit,
            ends,
        ),
        "ribbed cover": Scene(
            {
                "scene": [
                    {"kind": "file", "name": "cover", "file": exported, "surface": "clear", "refractive_index": INDEX}
                ],
                "scene_events": EVENTS,
            },
            {"cover": saved(cover()) | {"bsdf": {"type": "dielectric", "int_ior": INDEX, "ext_ior": 1.0}}},
            blocked_and_lit,
            through,
            clear=True,
        ),
        "handrail, three lamps": Scene(
            {"scene": [rail | {"tilt_deg": [0.0, 70.0], "patch_mm": 12.0}], "lamps": lamps},
            {
                "rail": {
                    "type": "cylinder", "radius": radius, "p0": [0, 0, -long / 2], "p1": [0, 0, long / 2],
                    "to_world": to().translate(middle) @ turn,
                }
            }
            | ends_of_rail,
            on_bodies,
            on_rail,
        ),
        "room": Scene(*in_room),
        "room, four reflections": Scene({**in_room[0], "scene_events": 4}, *in_room[1:], reflections=4),
    }  # fmt: skip


class Crossed(NamedTuple):
    """A ray behind clear bodies: point, direction, and the share of its flux that is left, 0 of one that stays."""

    point: list[float]
    way: list[float]
    share: float


def crossed(scene: Any, point: list[float], way: list[float], rng: np.random.Generator) -> Crossed:
    """Follow a ray while it enters clear bodies, leaves them, or is reflected totally, with its polarisation."""
    context = mi.BSDFContext(mi.TransportMode.Importance)
    ray = mi.Ray3f(mi.Point3f(point), mi.Vector3f(way), 0.0, [587.6] * 4)
    light = mi.Spectrum(1.0)
    for _ in range(MOST):
        hit = scene.ray_intersect(ray)
        if not hit.is_valid():
            return Crossed(list(ray.o), list(ray.d), float(light[0, 0][0]))
        found, weight = hit.bsdf().sample(context, hit, rng.random(), mi.Point2f(rng.random(), rng.random()))
        reflected = found.wo.z * hit.wi.z > 0.0
        if reflected and mi.fresnel(hit.wi.z, INDEX)[0] < 1.0:
            break
        light = hit.to_world_mueller(weight, -hit.wi, found.wo) @ light
        ray = hit.spawn_ray(hit.to_world(found.wo))
    return Crossed(point, way, 0.0)


def cast(lens: lf.Lens, wanted: Scene, rays: int, seed: int) -> Hits:
    """Rays of the source through the lens, and then into Mitsuba's scene."""
    spec = lens.spec
    source = searched_source(spec)
    exits = TracedLens.of(lens, PRESETS["standard"].evaluate_nodes_per_sigma).trace(
        independent_rays(spec.of_one_lamp, source, rays, seed)
    )
    lamps = spec.all_lamps.lamps
    chosen = np.random.default_rng(3).integers(len(lamps), size=rays)
    places = np.array([lamp.place_mm for lamp in lamps])[chosen]
    left = exits.left_lens
    points, ways = (exits.points + places)[left], exits.directions[left]
    content = {key.replace(" ", "_").replace(".", "_"): shape | {"id": key} for key, shape in wanted.shapes.items()}
    scene = mi.load_dict({"type": "scene"} | content)
    rng, context = np.random.default_rng(5), mi.BSDFContext()
    names, bounced = np.full(rays, "", dtype=object), np.full((rays, wanted.reflections), "", dtype=object)
    paths = np.full(rays, np.inf)
    at, going, share = exits.points + places, exits.directions.copy(), np.ones(rays)
    for row, point, way in zip(np.flatnonzero(left).tolist(), points.tolist(), ways.tolist(), strict=True):
        if wanted.clear:
            at[row], going[row], share[row] = crossed(scene, point, way, rng)
            continue
        hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(point), mi.Vector3f(way)))
        if not hit.is_valid():
            continue
        name = hit.shape.id()
        paths[row], names[row] = float(hit.t), name.split(" ")[0]
        if name == "room":
            names[row] = side_at(np.array(hit.p) - [12.0, -30.0, 85.0])
            for reflection in range(wanted.reflections):
                found, _ = hit.bsdf().sample(context, hit, rng.random(), mi.Point2f(rng.random(), rng.random()))
                hit = scene.ray_intersect(hit.spawn_ray(hit.to_world(found.wo)))
                bounced[row, reflection] = side_at(np.array(hit.p) - [12.0, -30.0, 85.0])
    upwards = left & (going[:, 2] > 0.0)
    reach = np.where(upwards, (DISTANCE_MM - at[:, 2]) / np.where(upwards, going[:, 2], 1.0), np.inf)
    lands = (at + np.where(upwards, reach, 0.0)[:, None] * going)[:, :2]
    window = upwards & (np.abs(lands) <= HALF_MM).all(axis=1)
    flux = np.where(left, exits.flux, 0.0)
    return Hits(flux * share, window, paths < reach, names, bounced, flux * (1.0 - share))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=2**16, help="of Mitsuba")
    parser.add_argument("--seed", type=int, default=7, help="of Mitsuba's rays")
    parser.add_argument("--only", help="name of one scene")
    options = parser.parse_args()
    mi.set_variant("scalar_spectral_polarized")
    print("| scene | share of the light | lensforge | Mitsuba | apart, σ |\n|---|---|---|---|---|")
    for name, scene in scenes().items():
        if options.only not in (None, name):
            continue
        spec = parse_spec(BASIS | scene.changes, "scene")
        lens = lf.Lens(start_faces(spec), spec, 0, PRESETS["standard"])
        counted = scene.counted(cast(lens, scene, options.rays, options.seed))
        for figure, ours, error in scene.figures(lf.evaluate(lens)):
            each = counted[figure]
            theirs = float(each.sum())
            noise = float(each.std() * np.sqrt(len(each)))
            apart = (ours - theirs) / np.hypot(error, noise)
            print(
                f"| {name} | {figure} | {ours:.5f} ± {error:.5f} | {theirs:.5f} ± {noise:.5f} | {apart:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
