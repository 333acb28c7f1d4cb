# Run by us: lensforge's nightly tests run this program, with Mitsuba 3 (pip install mitsuba numpy).
"""The light of the exported part by Mitsuba 3: its rays, its dielectric. Usage: python mitsuba_check.py [RAYS].

Light that a face reflects beside what it transmits is not counted: the expected figures are of light that is refracted,
or totally reflected.
"""

import sys

import mitsuba as mi
import numpy as np
from kit_figures import HERE, KIT, judged, landings, shares, source_rays

mi.set_variant("scalar_rgb")
MOST_EVENTS = 12


def main() -> int:
    """Trace the rays, and compare."""
    rays = source_rays(int(sys.argv[1]) if len(sys.argv) > 1 else None)
    glass = {"type": "dielectric", "int_ior": KIT["refractive_index"], "ext_ior": 1.0}
    scene = mi.load_dict({"type": "scene", "lens": {"type": "obj", "filename": str(HERE / "lens.obj"), "glass": glass}})
    random = np.random.default_rng(1)
    ends = [end for end in (passed(scene, ray, random) for ray in rays.tolist()) if end is not None]
    points, directions = np.array(ends).reshape(-1, 2, 3).swapaxes(0, 1)
    share, zones = shares(landings(points, directions), len(rays))
    return judged(f"Mitsuba {mi.__version__}", share, zones, len(rays))


def passed(scene, ray, random):
    """Point and direction at which a ray leaves the lens upwards; None if it is lost."""
    light = mi.BSDFContext(mi.TransportMode.Importance)
    way = mi.Ray3f(mi.Point3f(ray[:3]), mi.Vector3f(ray[3:]))
    inside = False
    for _ in range(MOST_EVENTS):
        hit = scene.ray_intersect(way)
        if not hit.is_valid():
            return None if inside or way.d.z <= 0.0 else (list(way.o), list(way.d))
        if hit.p.z <= 0.0:
            return None  # the base, or below the lens
        if inside and random.random() > np.exp(-KIT["absorption_per_mm"] * hit.t):
            return None
        sample, _ = hit.bsdf().sample(light, hit, random.random(), mi.Point2f(random.random(2).tolist()))
        if mi.has_flag(mi.BSDFFlags(sample.sampled_type), mi.BSDFFlags.DeltaTransmission):
            inside = not inside
        elif sample.pdf < 1.0:
            return None  # reflected in part
        way = hit.spawn_ray(hit.to_world(sample.wo))
    return None


if __name__ == "__main__":
    sys.exit(main())
