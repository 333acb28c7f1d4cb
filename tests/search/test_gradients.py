"""The merit of a step in every kind of scene: its gradient by differences, and in torch on a device."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from nightly import first_by_day
from scenes import DEVICES, tolerance_changes
from search_scenes import LARGE, RECEIVERS, STATES, WHITE, Step

from lensforge.light.reference_hits import TableFace

CPU = torch.device("cpu")
LED = Path(__file__).parents[2] / "examples" / "led.tm25ray"
SPHERE = {"kind": "sphere", "radius_mm": 3.0, "centre_z_mm": -1.0}
DOME = {"kind": "asphere", "vertex_z_mm": 6.5, "radius_mm": -6.0, "conic_constant": -0.2, "coefficients": [-1e-5]}
DISPERSED = {"source": {"kind": "square", "side_mm": 1.0, "spectrum": WHITE}, "lens__material": "PC"}
ROBUST = {"optimise__robust": True}
PERIOD = {
    "kind": "plane", "centre_mm": [0.0, 0.0, 40.0], "width_mm": 60.0, "height_mm": 60.0 * 3.0**0.5,
    "targets": [{"kind": "rectangle", "width_mm": 60.0, "height_mm": 100.0, "uniform_mm": 50.0}],
}  # fmt: skip
COLOURS = {
    "source": {
        "kind": "chips",
        "chips": [
            {
                "x_mm": x,
                "y_mm": y,
                "width_mm": 0.6,
                "height_mm": 0.6,
                "spectrum": {"kind": "line", "wavelength_nm": wave},
            }
            for x, y, wave in ((-0.4, 0.0, 630.0), (0.4, 0.0, 530.0), (0.0, 0.7, 460.0))
        ],
    },
    "colour": {"within": "tenth", "weight": 30.0},
}
LAMPS = {"lamps": {"kind": "grid", "columns": 3, "rows": 2, "pitch_mm": 20.0}}
KINDS = {"lamps": {"kind": "grid", "columns": 3, "rows": 3, "pitch_mm": 20.0, "kinds": "place"}}
TABLE = {"kind": "table", "places_mm": [[-25.0, 6.0], [0.0, 0.0], [21.0, -9.0]], "turns_deg": [20.0, 0.0, 245.0]}
EYES = {"kind": "luminance", "at_most": 1.0, "unit": "w_per_m2_sr", "blur_deg": 30.0, "spot_mm": 4.0}
SEEN = {"limits": [EYES | {"eyes_mm": [[8.0, -3.0, 15.0], [40.0, 9.0, 20.0]]}, EYES | {"eyes_deg": [[-20.0, 35.0]]}]}
HALF = {"kind": "zone", "zone": {"kind": "rectangle", "width_mm": 120.0, "height_mm": 120.0}, "at_least_share": 0.5}
BRIGHT = {"kind": "points", "at_mm": [[40, 40], [-40, 20]], "at_least": 60.0, "unit": "w_per_m2"}
OF_PARTS = {"optimise__robust": 0.9, "limits": [HALF, BRIGHT], **tolerance_changes(LARGE)}
BEZEL = {
    "kind": "cylinder", "name": "bezel", "radius_mm": 40.0, "bore_radius_mm": 11.0, "length_mm": 2.0,
    "centre_mm": [1.0, -2.0, 16.0], "tilt_deg": [8.0, -5.0],
}  # fmt: skip
WALL = {
    "kind": "box",
    "name": "wall",
    "size_mm": [60.0, 1.0, 30.0],
    "centre_mm": [3.0, 22.0, 20.0],
    "rotate_z_deg": 9.0,
}
SCENE = {"scene": [BEZEL, WALL]}
MIRROR = {"surface": "mirror", "reflectance": 0.8}
BY_MIRROR = {"scene": [BEZEL, WALL | MIRROR | {"size_mm": [60.0, 1.0, 90.0], "centre_mm": [3.0, 16.0, 60.0]}]}
BY_WALLS = {
    "scene": [*BY_MIRROR["scene"], BEZEL | {
        "name": "ring", "surface": "diffuse", "reflectance": 0.8, "bore_radius_mm": 25.0, "length_mm": 30.0,
        "centre_mm": [1.0, 4.0, 30.0]}],
    "limits": [{"kind": "loss", "cause": "housing", "at_most_share": 0.1}],
}  # fmt: skip
BLOCK = {
    "kind": "box", "name": "block", "size_mm": [50.0, 40.0, 30.0], "centre_mm": [9.0, -6.0, 70.0],
    "tilt_deg": [25.0, -20.0], "patch_mm": 9.0,
}  # fmt: skip
ON_BLOCK = {"kind": "body", "body": "block", "unit": "w_per_m2"}
LIT = {
    "scene": [WALL | {"centre_mm": [3.0, 16.0, 25.0]}, BLOCK],
    "limits": [
        ON_BLOCK | {"facing": [0.0, 0.0, -1.0], "within_deg": 60.0, "at_least": 60.0},
        ON_BLOCK | {"of": "mean", "at_most": 10.0},
    ],
}
BEHIND = BLOCK | {"patch_mm": None, "name": "behind", "size_mm": [300.0, 300.0, 2.0], "centre_mm": [9.0, 6.0, 120.0]}
BEHIND |= {"tilt_deg": [9.0, -12.0]}
FAR_SIDE = ON_BLOCK | {"facing": [-0.4, -0.4, 1.0], "within_deg": 50.0}
LIT_BY_WALL = {
    "scene": [WALL | {"centre_mm": [3.0, 16.0, 25.0]}, BLOCK, BEHIND | MIRROR],
    "limits": [FAR_SIDE | {"at_least": 60.0}, FAR_SIDE | {"of": "mean", "at_least": 10.0}, *LIT["limits"]],
}
LEDS = [
    {"name": "large", "share": 3.0, "source": {"kind": "square", "side_mm": 1.0, "flux_w": 2.0}},
    {"name": "aside", "source": {"kind": "disc", "diameter_mm": 0.6, "flux_w": 0.5, "position_mm": [0.1, -0.2, 0.0]}},
]
SPECS: dict[str, dict[str, Any]] = {
    "free": {},
    "symmetric": {"lens__symmetry": "square"},
    "fixed inner": {"lens": {"levels": [9, 25], "inner": {"fixed": SPHERE}, "outer": {"offset_mm": 6.0}}},
    "fixed outer": {"lens": {"levels": [9, 25], "inner": {"offset_mm": 3.0}, "outer": {"fixed": DOME}}},
    "ray file": {"source": {"kind": "rayfile", "model": "rays", "file": str(LED), "origin": "virtual_focus"}},
    "dispersed": DISPERSED,
    "lossless": {"optimise__fresnel": False},
    "all receivers": {"target": None, "receivers": list(RECEIVERS.values())},
    "lamps without an end": {"lamps": {"kind": "endless", "pitch_mm": 200.0}},
    "lamps in hexagons without an end": {
        "lamps": {"kind": "endless", "lattice": "hexagon", "pitch_mm": 60.0},
        "target": None,
        "receivers": [PERIOD],
    },
    "lamps in a ring": {
        "lamps": {"kind": "ring", "count": 3, "diameter_mm": 40.0},
        "target": None,
        "receivers": list(RECEIVERS.values()),
    },
    "lenses of three kinds, mirrored, coloured": KINDS | COLOURS | {"lens__symmetry": "mirror_y"},
    "lenses of two kinds, turned, all receivers": {
        "lamps": {**TABLE, "kinds": ["wide", "narrow", "wide"]},
        "target": None,
        "receivers": list(RECEIVERS.values()),
    },
    "lamps on poles": {
        "lamps": {"kind": "table", "places_mm": [[-30, 5], [25, 0, -4]], "aims_mm": [[10, 0, 90], [-20, 30, 80]]},
        "target": None,
        "receivers": list(RECEIVERS.values()),
    },
    "seen by eyes": SEEN,
    "seen by eyes, robust, coloured": SEEN | COLOURS | ROBUST | tolerance_changes(LARGE),
    "beside bodies, all receivers": SCENE | {"target": None, "receivers": list(RECEIVERS.values())},
    "beside bodies, lamps, seen by eyes": SCENE | SEEN | LAMPS,
    "by a mirror, all receivers": BY_MIRROR | {"target": None, "receivers": list(RECEIVERS.values())},
    "on a body": LIT,
    "on a body by a mirror": LIT_BY_WALL,
    "robust, large": ROBUST | tolerance_changes(LARGE),
    "robust, symmetric": ROBUST | tolerance_changes(LARGE) | {"lens__symmetry": "square"},
    "coloured, all receivers": COLOURS | {"target": None, "receivers": list(RECEIVERS.values())},
    "coloured, lamps, mirrored": COLOURS | LAMPS | {"lens__symmetry": "mirror_x"},
    "a share of the parts": OF_PARTS,
    "a share of the parts, two LEDs": OF_PARTS | {"source": None, "sources": LEDS},
    "a share of the parts, two states": OF_PARTS | STATES,
    "robust, two states": ROBUST | tolerance_changes(LARGE) | STATES,
    "coloured, robust, dispersed": COLOURS | ROBUST | tolerance_changes(LARGE) | {"lens__material": "PC"},
}
WITH_WALLS = SPECS | {"by walls": BY_WALLS}  # which are diffuse, and facets: no slopes of their own differences


ON_DEVICES = [  # scenes in which rays are traced in other ways
    "free", "ray file", "dispersed", "lossless", "all receivers", "lamps in a ring",
    "lenses of two kinds, turned, all receivers", "robust, large", "seen by eyes", "coloured, robust, dispersed",
    "beside bodies, all receivers", "by a mirror, all receivers", "by walls", "on a body", "on a body by a mirror",
]  # fmt: skip


def close(gradients: tuple[torch.Tensor, ...], wanted: tuple[torch.Tensor, ...]) -> bool:
    return all(torch.linalg.norm(a - b) <= 1e-9 * torch.linalg.norm(b) for a, b in zip(gradients, wanted, strict=True))


@pytest.mark.parametrize("changes", SPECS.values(), ids=SPECS)
def test_the_gradient_is_that_of_differences(changes: dict[str, Any]) -> None:
    """Through constraints, image and tracer, for weights and offsets of both surfaces."""
    step = Step(changes)
    by = 1e-8
    _, *gradients = step.values()
    for which, (gradient, way) in enumerate(zip(gradients, step.ways, strict=True)):
        move = (by, 0.0) if which == 0 else (0.0, by)
        with torch.no_grad():
            change = (step.loss(move) - step.loss((-move[0], -move[1]))).item() / (2.0 * by)
        assert change == pytest.approx((gradient * way).sum().item(), rel=2e-4)


def spread_in_frame_of_wall(directions: np.ndarray, normals: np.ndarray, draws: np.ndarray) -> np.ndarray:
    """Lambert's law in a frame that turns with no ray."""
    along = np.cross(normals, [0.3, -0.5, 0.8])
    along /= np.linalg.norm(along, axis=1)[:, None]
    azimuth = 2.0 * np.pi * draws[:, 1:]
    across = np.cos(azimuth) * along + np.sin(azimuth) * np.cross(normals, along)
    return np.asarray(np.sqrt(draws[:, :1]) * across + np.sqrt(1.0 - draws[:, :1]) * normals)


def test_the_gradient_by_a_diffuse_wall_is_that_of_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a frame of the wall alone: that of a ray turns with it, which changes no mean."""
    monkeypatch.setattr("lensforge.scene.housing.diffused", spread_in_frame_of_wall)
    wall = BY_MIRROR["scene"][1] | {"surface": "diffuse"}
    scene = {"scene": [BEZEL, wall], "target": None, "receivers": list(RECEIVERS.values())}
    test_the_gradient_is_that_of_differences(scene)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("name", ON_DEVICES)
def test_loss_and_gradient_on_a_device_are_those_of_the_kernels(name: str, device: str) -> None:
    step = Step(WITH_WALLS[name])
    assert close(step.values(device=torch.device(device)), step.values())


IN_SINGLE = ["free", "lamps without an end", "all receivers", "robust, large"]


@pytest.mark.parametrize("name", first_by_day(4, IN_SINGLE + [name for name in SPECS if name not in IN_SINGLE]))
def test_loss_and_gradient_in_single_precision_are_those_in_double(name: str) -> None:
    """Lamps without an end are traced in double precision: rays that graze their plane come from far."""
    values = Step(SPECS[name], single=True).values()
    wanted = Step(SPECS[name]).values()
    errors = [torch.linalg.norm(a - b) / torch.linalg.norm(b) for a, b in zip(values, wanted, strict=True)]
    assert max(errors) == 0.0 if "without an end" in name else 1e-9 < max(errors) < 2e-5


def test_chunks_add_up_and_search_for_each_crossing_once(monkeypatch: pytest.MonkeyPatch) -> None:
    step = Step({})
    whole = step.values(device=CPU)
    searched: list[int] = []
    search = TableFace.next_crossing
    monkeypatch.setattr(TableFace, "next_crossing", lambda face, rays: (searched.append(1), search(face, rays))[1])
    assert close(step.values(device=CPU, chunk=150), whole)
    assert len(searched) == 2 * 7, "seven chunks, two surfaces, and none again in the backward pass"


def test_every_ray_has_its_own_noise_at_a_rough_face_in_chunks_too() -> None:
    step = Step(ROBUST | tolerance_changes(LARGE | {"outer_roughness_mrad": 20.0}))
    assert close(step.values(device=CPU, chunk=150), step.values())


def test_receivers_count_by_their_shares() -> None:
    """Each alone, and both together with shares of 3 to 1; the light near total reflection counts once."""
    first = RECEIVERS["far field"]
    second = RECEIVERS["sphere"]
    alone = [Step({"target": None, "receivers": [receiver]}).loss().item() for receiver in (first, second)]
    both = Step({"target": None, "receivers": [{**first, "share": 3.0}, second]})
    assert both.loss().item() == pytest.approx(0.75 * alone[0] + 0.25 * alone[1], rel=1e-9)
