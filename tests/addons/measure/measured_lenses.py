"""A lens, and clouds of points as a probe would find them on parts that are deformed on purpose."""

import numpy as np
from scenes import hemisphere_directions as directions
from scipy.spatial.transform import Rotation

from lensforge.scene.lens import Lens
from lensforge.spec import parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

LEVELS = (9, 25, 81)


def surface(offset_mm, seed, relative=0.02):
    basis = SrbfBasis(LEVELS, 1.75)
    noise = np.random.default_rng(seed).normal(size=basis.size)
    return SrbfSurface(basis, offset_mm * relative * noise * basis.sigmas / basis.sigmas.max(), offset_mm)


def lens(source=None, **evaluate):
    content = {
        "name": "measured",
        "source": source or {"kind": "square", "side_mm": 1.0},
        "lens": {"levels": LEVELS, "inner": {"offset_mm": 6.0}, "outer": {"offset_mm": 13.0}},
        "constraints": {
            "cavity_height_mm": 1.0,
            "cavity_radius_mm": 1.0,
            "min_thickness_mm": 1.0,
            "max_radius_mm": 20.0,
        },
        "target": {
            "kind": "flat_top",
            "width_mm": 160.0,
            "distance_mm": 150.0,
            "receiver_mm": 300.0,
            "uniform_mm": 100.0,
        },
        "evaluate": {"rays": 16384, "pixels": 24, **evaluate},
    }
    return Lens.double(surface(6.0, 1), surface(13.0, 2), parse_spec(content, "test"), 0, "draft")


def dent(u, height_mm, towards=(0.5, 0.3, 0.8), width=0.35):
    """A smooth radial bump (mm) around one direction: no function of the basis."""
    axis = np.array(towards) / np.linalg.norm(towards)
    return height_mm * np.exp((u @ axis - 1.0) / width**2)


def waves(u, frequency, height_mm, seed, count=100):
    """Random form error (mm rms) of one spatial ``frequency`` (1/rad): plane waves in every direction of space."""
    rng = np.random.default_rng(seed)
    along = rng.normal(size=(count, 3))
    along *= 2.0 * np.pi * frequency / np.linalg.norm(along, axis=1, keepdims=True)
    phases = 2.0 * np.pi * rng.random(count)
    return height_mm * np.sqrt(2.0 / count) * np.cos(u @ along.T + phases).sum(axis=1)


def probed(of, count=6000, height_mm=0.0, noise_mm=0.0, rotation=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0), seed=3):
    """Points of the deformed surface in the machine's coordinates: turned by ``rotation`` (rad), then shifted."""
    u = directions(count, seed)
    radius = of.radius(u) + dent(u, height_mm)
    noise = noise_mm * np.random.default_rng(seed + 1).normal(size=count)
    points = u * radius[:, None] + noise[:, None] * of.normal(u)
    return Rotation.from_rotvec(rotation).apply(points) + np.array(shift)
