"""The result folder whose files are changed: every record that lensforge writes, of a small lens."""

import shutil
from pathlib import Path

import numpy as np

import lensforge as lf
from lensforge.runs import compared_folder, pipeline, toleranced_folder
from lensforge.spec import parse_spec

BASE_FILE, SNAPSHOT = "base.step", "level-0"
_FOLDER: list[Path] = []
_PARTS = 40  # of the yield study: two to four seconds
_RINGS = 24  # of triangles on each face: an STL of 100 kB, which is read in a millisecond


def use_folder(folder: Path, may_be_made: bool) -> None:
    """Take the samples from ``folder``; make it where it is missing."""
    _FOLDER[:] = [folder.resolve()]
    if may_be_made and not (folder / "run.json").exists():
        make_folder(folder)


def result_folder() -> Path:
    """The result folder. Raises :class:`RuntimeError` where none was chosen."""
    if not _FOLDER:
        raise RuntimeError("choose a result folder with use_folder() first")
    return _FOLDER[0]


def make_folder(folder: Path) -> None:
    """Run every stage and study of a small lens into ``folder``."""
    from fuzzing.spec_texts import small

    shutil.rmtree(folder, ignore_errors=True)
    pipeline.write_design(lf.design(parse_spec(small(), "sample"), accuracy="draft"), folder)
    pipeline.run_evaluate(folder)
    pipeline.run_export(folder, rings=_RINGS)
    pipeline.run_check(folder)
    pipeline.run_verify(folder)
    pipeline.run_stray(folder)
    toleranced_folder.run_sensitivity(folder)
    toleranced_folder.run_yield(folder, parts=_PARTS, rays=512, budget=False)
    pipeline.run_photometry(folder)
    _measure_part(folder)
    add_samples(folder)


def _measure_part(folder: Path) -> None:
    """Compare with a photograph of the light itself, and with points of the design's own surface."""
    from PIL import Image

    light = lf.load(folder).light.map
    seen = np.kron(light[::-1] / light.max(), np.ones((8, 8)))  # 8 pixels of the camera for each, row 0 on top
    photo, cloud = folder / "photo.png", folder / "points.csv"
    Image.fromarray(np.round(60000 * np.pad(seen, 10)).astype(np.uint16)).save(photo)
    low, high = 9.5, 9.5 + 8 * len(light)
    compared_folder.run_compare_photo(
        folder, on=photo, off=None, corners=[(low, low), (high, low), (high, high), (low, high)]
    )
    angles = np.arange(2000) * 2.399963  # the golden angle: even over the sphere
    z = np.linspace(0.02, 0.999, 2000)
    u = np.stack([np.sqrt(1.0 - z**2) * np.cos(angles), np.sqrt(1.0 - z**2) * np.sin(angles), z], axis=1)
    np.savetxt(cloud, u * lf.load(folder).lens.inner.radius(u)[:, None], delimiter=",")
    compared_folder.run_compare_surface(folder, points=cloud, surface="inner")
    photo.unlink()
    cloud.unlink()


def add_samples(folder: Path) -> None:
    """Write into a result folder the files that are read elsewhere: those of a sweep, a snapshot, and a base."""
    from lensforge.report.snapshots import Snapshot
    from lensforge.runs.sweep import sweep_of, variation_of

    run = lf.load(folder)
    variation = variation_of("constraints.max_radius_mm", [7.0, 8.0], ())
    sweep_of(run.spec, variation, [(variant, run) for variant in variation.variants(run.spec)]).write(folder)
    ring = np.stack([np.cos(np.arange(9.0)), np.sin(np.arange(9.0)), np.ones(9)], axis=1)
    surface = np.stack([(k + 1.0) * ring for k in range(5)])
    picture = np.add.outer(np.arange(8.0), np.arange(8.0))
    Snapshot(
        level=0, functions=9, step=4, nmse=0.5, efficiency=0.8, width=200.0, height=200.0, far_field=False,
        irradiance=picture, surface_mm=surface, slope=0.1 * surface[..., 0],
    ).write(folder, SNAPSHOT)  # fmt: skip
    _make_base(folder / BASE_FILE)


def _make_base(path: Path) -> None:
    """A clamping base with a bore, in the lens's coordinates."""
    import cadquery as cq

    base = cq.Workplane().circle(9.0).circle(4.0).extrude(-2.0)
    cq.exporters.export(base, str(path))
