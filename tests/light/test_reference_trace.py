"""The reference tracer against the kernels: the same tables, so every ray agrees, and so do the gradients."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from chains import clear, collimator, mirrors, reflector, tables_of, upwards
from hard_rays import all_hits, approach, gap, hard_rays
from landed import Landed, by_kernels, in_torch, on_device
from scenes import DEVICES, random_surface, table_of
from shells import BOWL, DOME
from test_as_made import ODD
from test_event_chains import FILM, MOVED, NAMES, TABLE

from lensforge.kernels.fate import Fate
from lensforge.light.reference_hits import TableFace
from lensforge.light.table_trace import Scene
from lensforge.optics.face_roles import CAVITY, OUTSIDE
from lensforge.optics.media import CoverGlass, FaceCoating, Media, Medium
from lensforge.scene.body import Body
from lensforge.search.searches import device_of
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid, tabulate

GRID = TableGrid(64)
SCENE = Scene(Media(Medium(1.4936)), GRID)
DISTANCE = 100.0
pytestmark = pytest.mark.parametrize("device", DEVICES)


def _tables(seed: int, roughness: float, *radii: float) -> list[torch.Tensor]:
    inner, outer = radii or (0.8, 2.45)
    surfaces = random_surface(seed, inner, roughness), random_surface(seed + 1, outer, 0.8 * roughness)
    return [table_of(surface, GRID).requires_grad_() for surface in surfaces]


def _both(device: str, tables: list[torch.Tensor], rays: RayBundle, scene: Scene = SCENE) -> tuple[Landed, Landed]:
    """By the kernels, and on the device, copied back."""
    return by_kernels(tables, scene, rays, DISTANCE), in_torch(on_device(tables, scene, rays, device), DISTANCE)


def _agree(kernels: Landed, reference: Landed) -> None:
    """The same to rounding, which the way to the receiver multiplies: some rays land 50 m aside."""
    assert torch.equal(reference.fates, kernels.fates)
    assert torch.allclose(reference.carried, kernels.carried, rtol=1e-10, atol=0.0)
    assert torch.allclose(reference.sin2_exit, kernels.sin2_exit, rtol=0.0, atol=1e-11)
    gentle = kernels.sin2_exit < 0.99  # nearer to the critical angle, rounding grows on the way to the receiver
    apart = (reference.hits - kernels.hits).norm(dim=1)
    far = kernels.hits.norm(dim=1)
    assert (apart <= 1e-9 + 5e-10 * far)[gentle].all()
    assert torch.allclose(reference.hits, kernels.hits, rtol=1e-7, atol=1e-7)


def test_every_fate_is_that_of_the_kernels(device: str) -> None:
    """From everywhere to everywhere, through lenses that reflect, and whose surfaces cross."""
    rng = np.random.default_rng(0)
    count = 4000
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = rng.normal(size=(count, 3)) * 0.5
    origins[:10] = 0.0
    directions[10:20] = [0.0, 0.0, 1.0]
    origins[20] = np.nan
    directions[21] = np.nan
    rays = RayBundle(origins, directions, rng.random(count))
    seen: set[int | str] = set()
    for seed, roughness, radii in ((1, 0.06, (0.8, 1.6)), (3, 0.15, (1.0, 1.3)), (5, 0.0, (1.0, 0.5))):
        kernels, reference = _both(
            device, _tables(seed, roughness, *radii), rays, replace(SCENE, media=Media(Medium(1.6)))
        )
        _agree(kernels, reference)
        assert torch.equal(reference.missed_receiver, kernels.missed_receiver)
        seen |= set(kernels.fates.tolist()) | ({"missed_receiver"} if kernels.missed_receiver.any() else set())
    assert seen == set(Fate) - {Fate.NOT_CONVERGED, Fate.EVENT_LIMIT, Fate.FLANGE} | {"missed_receiver"}


LOSSY = clear(absorption=0.02, coatings=mirrors(0.9, wall=OUTSIDE))
COATED = clear(coatings=(FaceCoating("cap", CAVITY, TABLE), FaceCoating("exit", OUTSIDE, FILM)))
TIR = collimator(0.05)
CHAINS = {  # a body, its media, how it was made, events of a chain, Fresnel's losses
    "TIR": (TIR, clear(absorption=0.02), None, 6, True),
    "TIR, coated, behind a glass": (
        TIR, replace(COATED, cover_glass=CoverGlass(1.52, 2.0, 20.0, 0.001, FILM)), None, 6, True,
    ),
    "TIR without losses": (TIR, COATED, None, 6, False),
    "TIR, a mirror, as made and rough": (
        TIR, LOSSY, replace(MOVED, slopes=dict.fromkeys(NAMES, 0.005)), 6, True,
    ),
    "TIR, few events, a flange": (
        TIR, clear(coatings=(*mirrors(0.0, wall=OUTSIDE), *mirrors(0.8, side=CAVITY))), None, 2, True,
    ),
    "TIR before bodies and a glass": (
        TIR, replace(clear(absorption=0.02), bodies=(DOME, BOWL), cover_glass=CoverGlass(1.52, 2.0, 60.0, 0.001, FILM)),
        None, 6, True,
    ),
    "two faces, as made and rough, before bodies": (
        Body.of({"inner": sphere(3.0, 0.5), "outer": sphere(6.0, -1.0)}),
        replace(clear(absorption=0.02), bodies=(DOME, BOWL)), ODD, None, True,
    ),
    "reflector": (reflector(5.0, 1.0, 8.0), clear(coatings=mirrors(0.9, mirror=CAVITY)), None, 2, True),
}  # fmt: skip


@pytest.mark.parametrize("name", CHAINS)
def test_chains_of_events_and_their_gradients_are_those_of_the_kernels(name: str, device: str) -> None:
    body, media, made, events, fresnel = CHAINS[name]
    tables = torch.from_numpy(tables_of(body, GRID)).requires_grad_()
    chain = None if events is None else body.chain(events)
    rays = upwards(1500, 3, 0.5)
    scene = Scene(media, GRID, fresnel, made, chain)
    kernels, reference = _both(device, list(tables), rays, scene)
    _agree(kernels, reference)
    for lost in ("absorbed", "lost_in_glass", "lost_in_bodies"):
        one, other = (getattr(landed.exits, lost) for landed in (reference, kernels))
        assert (one is None) == (other is None), lost
        assert one is None or torch.allclose(one, other, rtol=1e-9, atol=1e-14), lost
    by_torch, by_hand = (torch.autograd.grad(landed.mixed(DISTANCE), tables)[0] for landed in (reference, kernels))
    assert torch.linalg.norm(by_torch - by_hand) < 1e-8 * torch.linalg.norm(by_hand)
    if events == 2 and "TIR" in name:
        assert {Fate.FLANGE, Fate.EVENT_LIMIT} <= set(reference.fates.tolist())


@pytest.mark.parametrize(("seed", "roughness"), [(1, 0.01), (2, 0.03), (3, 0.06)])
def test_hard_rays_cross_where_the_kernel_says(device: str, seed: int, roughness: float) -> None:
    count = 4000
    grid = TableGrid(100)
    table = tabulate(grid, random_surface(seed, 2.0, roughness, levels=(25, 81, 289)))
    starts, directions = hard_rays(table, grid, count, seed)
    lengths, hit, lost = all_hits(starts, directions, table, grid)
    face = TableFace.of(torch.from_numpy(table), grid, device=torch.device(device))
    crossing = face.next_crossing(approach(starts, directions, device=device))
    paths = crossing.paths_mm.cpu().numpy()
    above = starts[:, 2] + paths * directions[:, 2] >= 0.0
    assert np.array_equal(crossing.found.cpu().numpy() & above, hit)
    assert not lost.any() and not crossing.lost.any()
    assert np.abs(paths - lengths)[hit].max() < 1e-9


def test_rays_from_outside_come_in_where_a_dense_scan_says(device: str) -> None:
    """From far and from a hair above the face, past it and through it, down to the plane z = 0."""
    count = 1500
    grid = TableGrid(100)
    rng = np.random.default_rng(4)
    table = tabulate(grid, random_surface(1, 2.0, 0.06, levels=(25, 81)))
    u = rng.normal(size=(count, 3))
    u[:, 2] = np.abs(u[:, 2])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    starts = u * ((gap(u, table, grid) + 1.0) * (1.0 + 10.0 ** rng.uniform(-4.0, 0.5, count)))[:, None]
    aims = rng.normal(size=(count, 3)) * 2.0
    aims[:, 2] = np.abs(aims[:, 2])
    directions = (aims - starts) / np.linalg.norm(aims - starts, axis=1, keepdims=True)
    face = TableFace.of(torch.from_numpy(table), grid, device=torch.device(device))
    crossing = face.next_crossing(approach(starts, directions, -1.0, device))
    paths = crossing.paths_mm.cpu().numpy()
    fall = np.where(directions[:, 2] < 0.0, -starts[:, 2] / np.minimum(directions[:, 2], -1e-300), np.inf)
    ways = np.minimum(fall, 15.0)[:, None] * np.linspace(0.0, 1.0, 2000)
    inside = gap(starts[:, None] + ways[..., None] * directions[:, None], table, grid) > 0.0
    first = np.where(inside.any(axis=1), ways[np.arange(count), inside.argmax(axis=1)], np.inf)
    enters = crossing.found.cpu().numpy()
    step = ways[:, 1]
    assert not crossing.lost.any() and 300 < enters.sum() < count - 300
    assert not (~enters & np.isfinite(first)).any()
    at = starts[enters] + paths[enters, None] * directions[enters]
    assert np.abs(gap(at, table, grid)).max() < 1e-9
    assert (paths <= first + 1e-9)[enters].all()
    seen = enters & np.isfinite(first)  # the others come in for less than a step of the scan
    assert seen.sum() > 0.97 * enters.sum() and (paths >= first - step - 1e-9)[seen].mean() > 0.99


def test_a_device_is_found_by_its_name(device: str) -> None:
    assert device_of(device) == (None if device == "cpu" else torch.device("cuda"))
