"""One crooked design of each kind, and what every stage says of it: no symmetry, no unit value, no two entries alike.

``designs/NAME`` holds a spec and the lens of a search of a few steps. The stages begin with two steps more from there,
so that their lens is of today's code, and go on at small numbers of rays. ``python tests/stated/crooked.py NAME …``
searches for the stored lenses anew.
"""

import io
import json
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from addon_rows import has_addon
from PIL import Image
from presets import WITH_TABLE_ERROR
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

import lensforge as lf
from lensforge.results.arguments import threads_of_torch
from lensforge.results.fact import Fact, Group
from lensforge.sources.rayfiles.ray_file import RayFile
from lensforge.sources.rayfiles.ray_file_io import write_rayfile

DESIGNS = Path(__file__).parent / "designs"
# Double on poles with two roads that differ; TIR and reflector with levels; turned lenses of a plate, moulded; kinds by
# place; several LEDs of unlike files behind which bodies stand; coloured chips.
NAMES = (*(("roads",) if has_addon("road") else ()), "tir", "cup", "plate", "kinds", "leds", "chips")
FILES = {"near": 1800, "far": 700}  # rays in each file
FILE_EFFICACIES = {"near": 300.0, "far": 240.0}  # lm/W
FEW_RAYS = WITH_TABLE_ERROR.replace(
    "crooked",
    photometry_rays=(2**12, 2**12),
    verify_rays=2**10,
    effort={"validation_rays": 2048},
    stray_rays=256,
    studies={"compared_rays": 1024},
)
# By the tables of a search one of 500 rays of these lenses lands beyond the edge of its pixel.
FINE = FEW_RAYS.replace("crooked_fine", nodes_per_sigma=FEW_RAYS.evaluate_nodes_per_sigma)
ACCURACY = {"tir": FINE, "cup": FINE}
HOT_C = 95.0  # of the lens in the results "warm"
STRAY = {"stray": lambda run: lf.stray_light(run.part)}
STUDIES: dict[str, dict[str, Callable[[Any], Any]]] = dict.fromkeys(("tir", "plate"), STRAY)
# Corners of a photograph, and what its light is against the simulated one: larger, turned, shifted.
SHOT = {"corners": [[61.0, 33.0], [455.0, 58.0], [431.0, 322.0], [38.0, 291.0]], "gamma": 1.8}
STUDIES["roads"] = STRAY
if has_addon("measure"):
    STUDIES["roads"] = STRAY | {
        "compare": lambda run: lf.compare(
            run.light, on=photographed(run), off=run.folder / "off.png", lens=run.lens, **SHOT
        )
    }
    STUDIES["chips"] = {
        "compare_inner": lambda run: lf.compare(run.lens, points=measured(run, "rigid"), surface="inner"),
        "correct_inner": lambda run: lf.correct(
            run.lens, points=measured(run, "none"), surface="inner", gain=0.7, wavelength_mm=2.1, registration="none"
        ),
    }
SENSITIVITY = {"sensitivity": lambda run: lf.sensitivity(run.lens)}
STUDIES |= {"tir": STRAY | SENSITIVITY, "cup": SENSITIVITY, "leds": STRAY | SENSITIVITY}
BY_LED = ("verify", "stray", "photometry")  # results that hold one of their own kind for each further LED
_SEARCHED_STEPS = 12  # for each level of a stored lens


@dataclass(frozen=True)
class Place:
    """Where a fact stands: result and key, the numbers of its group and of itself among those of the same key.

    ``led``: of several, in a result of :data:`BY_LED`, whose groups are counted with each anew.
    """

    stage: str
    key: str
    group: int = 0
    number: int = 0
    title: str = ""
    led: int = 0


@dataclass(frozen=True)
class Case:
    """A crooked design as a stranger sees it.

    ``lens``: lens.json. ``results``: by the name of their stage. ``facts``: groups of each result. ``rays``: those that
    a stage took, by its name: a list for each call, of replicate, factor of the flux, positions, directions, flux (W)
    and wavelengths (nm) or None.
    """

    name: str
    folder: Path
    lens: dict[str, Any]
    results: dict[str, Any]
    facts: dict[str, list[Group]]
    rays: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def files(self) -> dict[str, tuple[float, float]]:
        """Flux (W) and lm/W of each ray file of the specs, by its stem."""
        return {
            name: (float(led_rays(name)[2].sum(dtype=float)), lm_per_w) for name, lm_per_w in FILE_EFFICACIES.items()
        }

    def json(self, stage: str) -> dict[str, Any]:
        """The record of a stage as its file has it."""
        return json.loads((self.folder / f"{stage}.json").read_text(encoding="utf-8"))

    def with_led(self, led: int) -> "Case":
        """What a stranger sees of one of several LEDs, as if it were the only one: its records, arrays, files, rays."""
        sources = self.lens["spec"]["sources"]
        if not sources:
            return self
        name = sources[led]["name"]
        folder = self.folder.parent / f"with_{led}"
        if not folder.exists():
            folder.mkdir()
            for path in self.folder.iterdir():
                file = folder / path.name
                if path.stem in (*BY_LED, "evaluate") and path.suffix in (".json", ".npz"):
                    file.write_bytes(_of_led(path, led))
                else:
                    other = path.with_stem(f"{path.stem}_{name}")
                    file.symlink_to(other if led and other.exists() else path)
        spec = self.lens["spec"] | {"source": sources[led]["source"], "sources": []}
        per_led = len(self.rays["photometry"]) // len(sources)
        rays = self.rays | {
            "photometry": self.rays["photometry"][led * per_led : (led + 1) * per_led],
            "tables": self.rays["tables of LEDs"][led], "stray": self.rays["stray"][led:],
        }  # fmt: skip
        return replace(self, name=f"{self.name} {name}", folder=folder, lens=self.lens | {"spec": spec}, rays=rays)

    def of_leds(self) -> "list[Case]":
        """The case with each of its LEDs."""
        return [self.with_led(led) for led in range(len(self.lens["spec"]["sources"]))] or [self]

    def stated(self) -> Iterator[tuple[Place, Fact]]:
        """Every fact of every result, with its place."""
        for stage, groups in self.facts.items():
            seen: dict[str, int] = {}
            leds = len(self.lens["spec"]["sources"]) or 1 if stage in BY_LED else 1
            counted = Counter(group.key for group in groups)
            for group in groups:
                before: dict[str, int] = {}
                led, number = divmod(seen.get(group.key, 0), max(1, counted[group.key] // leds))
                for fact in group.facts:
                    place = Place(stage, fact.key, number, before.get(fact.key, 0), group.title, led)
                    yield place, fact
                    before[fact.key] = before.get(fact.key, 0) + 1
                seen[group.key] = seen.get(group.key, 0) + 1


@dataclass(frozen=True)
class Expected:
    """What an oracle says of a fact. ``within``: the largest distance of the value, ``error_within``: of its error.

    None in ``standard_error``: none is stated. A ``limit`` is its sign and value, "" where none is asked.
    """

    value: float | str | None
    within: float = 0.0
    unit: str = ""
    standard_error: float | None = None
    error_within: float = 0.0
    limit: tuple[str, float] | None = None
    limit_within: float = 0.0  # of one that follows from measures
    state: str = ""
    possible: Any = None  # an Ellipsis: not compared
    possible_within: float = 0.0


def _of_led(path: Path, led: int) -> bytes:
    """Record or arrays of a stage without the other LEDs; of one of these as the first has its own."""
    if path.suffix == ".json":
        content = json.loads(path.read_text(encoding="utf-8"))
        others = content.pop("others", [])
        return json.dumps(content | (others[led - 1] if led else {})).encode()
    start = f"others.{led - 1}."
    file = io.BytesIO()
    arrays = {name: values for name, values in np.load(path).items() if led or not name.startswith("others.")}
    np.savez(file, **{name.removeprefix(start): values for name, values in arrays.items() if not led or start in name})
    return file.getvalue()


def led_rays(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (mm), directions and flux (W) of the rays of a file, uneven over 2 x 0.4 mm and in direction."""
    count = FILES[name]
    a, b, c, e = np.random.default_rng(len(name)).random((4, count))
    shift, along = ((3.0, 0.5, -0.4), 2.0) if name == "near" else ((0.1, -0.2, 0.05), 1.4)
    x, y = along * (a**1.2 - 0.5), 0.4 * (b - 0.5)
    sine = np.sqrt(c)
    turn = 2 * np.pi * e
    directions = np.stack([sine * np.cos(turn), sine * np.sin(turn) * (0.6 + 0.4 * a), np.sqrt(1 - c) + 0.05], axis=1)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    p = np.stack([x, y, 0.1 * a], axis=1)
    if name == "near":  # its light goes along +x of the file
        p = p[:, [2, 0, 1]]
        directions = directions[:, [2, 0, 1]]
    flux = (0.5 + a * c) / count * (0.37 if name == "near" else 0.81)
    return (p + shift).astype("f4"), directions.astype("f4"), flux.astype("f4")


def write_leds(folder: Path) -> None:
    """The ray files that the specs name."""
    for name in FILES:
        p, d, flux = led_rays(name)
        total = float(flux.sum(dtype=float))
        lumens = total * FILE_EFFICACIES[name]
        file = RayFile(p, d, flux, flux_unit="W", header_flux_w=total, header_flux_lm=lumens)
        write_rayfile(folder / f"{name}.tm25ray", file, "tm25")


def spec_of(name: str, folder: Path, changes: dict[str, Any] | None = None) -> lf.Spec:
    """The spec of a design, with its files, in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(DESIGNS / name / "spec.toml", folder / "spec.toml")
    if name == "leds":
        write_leds(folder)
    spec = lf.load_spec(folder / "spec.toml")
    return spec.replace(changes) if changes else spec


def measured(run: Any, registration: str) -> Path:
    """A file of points of the inner face with errors of form and noise; a cone is left out, some lie beyond the rim."""
    face = run.lens.surfaces["inner"]
    count = 430
    rng = np.random.default_rng(8)
    z = 1 - 1.17 * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * 2.4
    u = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    u = u[(u @ [0.8, 0.36, 0.48] < 0.9) & ((z > 0) | (z < -0.13))]
    x, y, z = u.T
    error = 24e-3 * (x * y + 0.7 * x * z - 0.5 * y * y) + 9e-3 * np.cos(7.0 * np.arctan2(0.8 * x + 0.6 * y, z + 0.3))
    noise = 5e-4 * rng.normal(size=len(u))[:, None] * face.normal(u)
    points = u * (face.radius(u) + error)[:, None] + noise
    if registration == "rigid":
        points = Rotation.from_rotvec([0.011, -0.017, 0.023]).apply(points) + np.array([0.031, -0.022, 0.014])
    np.savetxt(run.folder / f"points_{registration}.csv", points, delimiter=",", header="x,y,z")
    return run.folder / f"points_{registration}.csv"


def photographed(run: Any) -> Path:
    """Photographs of the light on the first receiver, 4 % larger, turned by 2.5 degrees, shifted; a few pixels clip."""
    light = run.light.map
    wide = run.light.first.width
    high = run.light.first.height
    corners = np.array([[-wide, high], [wide, high], [wide, -high], [-wide, -high]]) / 2
    i, j = np.indices((350, 490))
    from skimage.transform import ProjectiveTransform

    to_mm = ProjectiveTransform.from_estimate(np.array(SHOT["corners"]), corners)
    x, y = (to_mm(np.stack([j.ravel(), i.ravel()], axis=1)) - [0.02 * wide, -0.03 * high]).T
    c = np.cos(np.radians(2.5)) / 1.04
    s = np.sin(np.radians(2.5)) / 1.04
    at = [((c * y - s * x) / high + 0.5) * len(light) - 0.5, ((c * x + s * y) / wide + 0.5) * light.shape[1] - 0.5]
    seen = map_coordinates(light / light.max(), at, order=1, mode="nearest").reshape(i.shape)
    dark = 0.04 + 0.05 * j / 490 + 0.03 * i / 350
    for name, picture in (("on", 0.925 * seen + dark), ("off", dark)):
        values = np.round(65535 * np.clip(picture, 0, 1) ** (1 / SHOT["gamma"])).astype(np.uint16)
        Image.fromarray(values).save(run.folder / f"{name}.png")
    return run.folder / "on.png"


class Record:
    """Rays that the stages draw, and the tables of the far field that they make of them, by the name of the stage."""

    def __init__(self) -> None:
        self.stage = "design"
        self.rays = dict[str, list[Any]]()

    def begins(self, stage: str) -> None:
        """From now on they are of this stage."""
        self.stage = stage

    @contextmanager
    def kept(self) -> Iterator[None]:
        """What is traced is kept: bundles of a simulation, and what goes to the far field."""
        from lensforge.light import evaluation, exit_light, replicate_rays, simulation
        from lensforge.proof import casts

        drawn = simulation.bundles
        sent = exit_light.exit_rays
        fitted = exit_light.fit
        exact = evaluation._through_exact
        cast = casts.stray_in_sandbox

        def bundles(*arguments: Any) -> Iterator[Any]:
            kept = list[Any]()
            self.rays.setdefault(self.stage, []).append(kept)
            for replicate, share, bundle in drawn(*arguments):
                kept.append((replicate, share, *arrays(bundle)))
                yield replicate, share, bundle

        def exit_rays(lens: Any, rays: Any, *more: Any) -> Any:
            if self.stage == "photometry":  # by the same rays an evaluation judges roads
                self.rays.setdefault("photometry", []).append(arrays(rays))
            return sent(lens, rays, *more)

        def through_exact(lens: Any, traced: Any, rays: Any) -> Any:
            self.rays.setdefault(f"{self.stage} tables", []).append(arrays(rays))
            return exact(lens, traced, rays)

        def stray(stl: bytes, *, rays: Any, **more: Any) -> Any:
            self.rays.setdefault(self.stage, []).append(arrays(rays))
            return cast(stl, rays=rays, **more)

        def tables_of(light: Any, rival: Any = None) -> list[Any]:
            if light.rival is not None:
                rival = (light.rival.doubt, tables_of(light.rival.light))
            return [light.grid.c_deg, light.grid.gamma_deg, light.samples, rival]

        def fit(*given: Any) -> Any:
            result = fitted(*given)
            if self.stage == "photometry":
                self.rays["tables"] = tables_of(result)
                self.rays.setdefault("tables of LEDs", []).append(self.rays["tables"])
            return result

        def arrays(bundle: Any) -> tuple[Any, ...]:
            return bundle.origins, bundle.directions, bundle.flux, bundle.wavelengths_nm

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(simulation, "bundles", bundles)
            patch.setattr(replicate_rays, "bundles", bundles)
            patch.setattr(exit_light, "exit_rays", exit_rays)
            patch.setattr(exit_light, "fit", fit)
            patch.setattr(evaluation, "_through_exact", through_exact)
            patch.setattr(casts, "stray_in_sandbox", stray)
            yield


def made(name: str, folder: Path) -> Case:
    """The design of this name, run through every stage in ``folder``."""
    from undrawn import undrawn

    from lensforge.report.folder import opened

    record = Record()
    spec = spec_of(name, folder / "spec")
    start = lf.load_lens(stored(name, folder / "spec"))
    with record.kept(), undrawn(), threads_of_torch(1):
        run = lf.run(
            spec,
            folder / "run",
            accuracy=ACCURACY.get(name, FEW_RAYS),
            seed=3,
            start=start,
            warn=lambda _: None,
            announce=record.begins,
        )
        results = dict(run.found)
        if name == "leds":  # of which the second LED is hot, too
            record.begins("warm")
            results["warm"] = lf.evaluate(run.lens, temperature_c=HOT_C)
            results["warm"].write(run.folder, "warm")
        for stage, study in STUDIES.get(name, {}).items():
            record.begins(stage)
            with opened(run.folder) as here:
                results[stage] = here.write(study(run))
    lens = json.loads((run.folder / "lens.json").read_text(encoding="utf-8"))
    facts = {stage: run.facts(result) for stage, result in results.items()}
    return Case(name, run.folder, lens, results, facts, record.rays)


def stored(name: str, folder: Path) -> Path:
    """The stored lens, whose files are those in ``folder``."""
    text = (DESIGNS / name / "lens.json").read_text(encoding="utf-8").replace("FOLDER", folder.as_posix())
    (folder / "lens.json").write_text(text, encoding="utf-8")
    return folder / "lens.json"


def search(name: str, folder: Path) -> None:
    """Search for the lens of a design and store it, without a checksum: its files lie elsewhere."""
    steps = [_SEARCHED_STEPS] * len(spec_of(name, folder).optimise.steps_per_level or ())
    spec = spec_of(name, folder, {"optimise.steps_per_level": steps, "optimise.rays": 4096})
    design = lf.design(spec, accuracy="draft", seed=1, warn=print, force=True)
    design.lens.save(folder / "lens.json")
    content = json.loads((folder / "lens.json").read_text(encoding="utf-8"))
    content.pop("content_sha256", None)
    content["spec"] = json.loads(spec_of(name, folder).model_dump_json())
    text = json.dumps(content, separators=(",", ":")).replace(folder.as_posix(), "FOLDER")
    (DESIGNS / name / "lens.json").write_text(text + "\n", encoding="utf-8")
    print(name, design, len(text))


if __name__ == "__main__":
    for chosen in sys.argv[1:] or NAMES:
        search(chosen, Path("/tmp/crooked") / chosen)
