"""``manufacturing.html`` and ``.pdf``, ``points.csv`` and ``sag.csv`` from the files of a result folder."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup
from matplotlib.figure import Figure

from lensforge.errors import InputError
from lensforge.files import read_json, replacing
from lensforge.drawings.dimensions import dimensions
from lensforge.drawings.pdf import write_pdf
from lensforge.drawings.points import write_points, write_sag
from lensforge.drawings.section import dimensioned_section
from lensforge.lens import Lens, load_lens
from lensforge.report.drawing import to_svg
from lensforge.report.surface_figures import curvature_map, sag_map

HTML_FILE, PDF_FILE, POINTS_FILE, SAG_FILE = "manufacturing.html", "manufacturing.pdf", "points.csv", "sag.csv"
DATUM = (
    "A is the plane z = 0, in which both optical faces end; B is the optical axis z through the origin of the STEP; "
    "a clocking flat lies across +x. Lengths in mm. The optical faces are the named faces OPTICAL_OUTER and "
    "OPTICAL_INNER of the STEP file, which alone defines them: tables and pictures are for measuring and reading."
)

Pictures = list[tuple[str, Figure]]


def build_handover(directory: Path) -> dict[str, Any]:
    """Write the four files; return their names, hashes of what they describe, and the count of failed verdicts.

    Raises :class:`InputError` where ``lens.json``, ``export.json`` or ``check.json`` is missing, or where a file has
    changed since it was exported.
    """
    directory = Path(directory)
    lens = load_lens(directory / "lens.json")
    export, check = (_stage(directory, name) for name in ("export", "check"))
    hashes = {name: _unchanged(directory / name, file["sha256"]) for name, file in export["files"].items()}
    rows = {
        POINTS_FILE: write_points(lens, directory / POINTS_FILE),
        SAG_FILE: write_sag(lens, check, directory / SAG_FILE),
    }
    hashes |= {name: _sha256(directory / name) for name in rows}
    content = _content(lens, export, check, hashes)
    figures = _pictures(lens, directory / "check.npz", check)
    _write_html(directory / HTML_FILE, content, figures)
    title = f"{content['name']}: for manufacture"
    write_pdf(directory / PDF_FILE, title, _as_text(title, content), figures)
    failed = sum(not verdict["holds"] for verdict in check["verdicts"])
    return {"files": [HTML_FILE, PDF_FILE, *rows], "points": rows[POINTS_FILE], "sha256": hashes, "refused": failed}


def _stage(directory: Path, name: str) -> dict[str, Any]:
    path = directory / f"{name}.json"
    if not path.exists():
        raise InputError(f"{path}: no such file; run `lensforge {name} {directory}` first")
    content: dict[str, Any] = read_json(path)
    return content


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _unchanged(path: Path, wanted: str) -> str:
    """The hash of a file that is what export.json says it is."""
    if not path.is_file() or _sha256(path) != wanted:
        raise InputError(f"{path}: not the file that export.json describes; run `lensforge export {path.parent}` again")
    return wanted


def _content(lens: Lens, export: dict[str, Any], check: dict[str, Any], hashes: dict[str, str]) -> dict[str, Any]:
    spec = lens.spec
    facts = {
        "Material": spec.lens.material,
        "Refractive index": f"{spec.lens.refractive_index:g}",
        "To be made": {"part": "the lens itself", "insert": "mould inserts"}[spec.manufacture.make],
        "Volume": f"{export['volume_mm3']:.3f} mm³",
        "Form of the STEP's faces against the design": f"{export['form_error_nm']['max']:.2f} nm at most",
        "Their normals": f"{1e3 * export['normal_error_mrad']['max']:.1f} µrad at most",
        "STEP schema": export.get("step_schema", "AP214"),
        "Thinnest wall": f"{check['min_wall_mm']:.4f} mm",
        "lensforge": lens.version,
    }
    faces = {
        name: {
            "Best-fit sphere, radius": f"{check[name]['best_fit_sphere']['radius_mm']:.4f} mm",
            "Departure from it, peak to valley": f"{1e3 * check[name]['best_fit_sphere']['pv_mm']:.2f} µm",
            "Departure, rms": f"{1e3 * check[name]['best_fit_sphere']['rms_mm']:.2f} µm",
            "Tightest hollow, radius": _length(check[name]["curvature"]["smallest_concave_radius_mm"]),
            "Largest ball that reaches all": _length(check[name]["cutter"]["largest_radius_mm"]),
            "Steepest place": f"{check[name]['largest_tilt_deg']:.2f}°",
            "Least draft": f"{check[name]['draft_deg']['min']:.2f}°",
        }
        for name in ("outer", "inner")
    }
    return {
        "name": spec.name,
        "datum": DATUM,
        "facts": facts,
        "dimensions": dimensions(lens),
        "faces": faces,
        "verdicts": check["verdicts"],
        "gates": export["gates"] + check["gates"],
        "hashes": hashes,
    }


def _length(value: float | None) -> str:
    return "any" if value is None else f"{value:.4f} mm"


def _pictures(lens: Lens, maps_file: Path, check: dict[str, Any]) -> Pictures:
    figures: Pictures = [("Section at y = 0, to scale", dimensioned_section(lens))]
    with np.load(maps_file) as maps:
        for name in ("outer", "inner"):
            radius = check[name]["cutter"]["radius_mm"]
            figures.append((f"{name}: departure from the best-fit sphere", sag_map(maps[f"{name}_sag_mm"])))
            caption = f"{name}: smaller curvature; line: where a ball of {radius:g} mm just fits"
            figures.append((caption, curvature_map(maps[f"{name}_kappa_min"], radius)))
    return figures


def _write_html(path: Path, content: dict[str, Any], figures: Pictures) -> None:
    environment = Environment(loader=PackageLoader("lensforge.drawings"), autoescape=select_autoescape())
    drawn = [(caption, Markup(to_svg(f, f"handover{k}", caption))) for k, (caption, f) in enumerate(figures)]
    page = environment.get_template("manufacturing.html").render(**content, pictures=drawn)
    with replacing(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _as_text(title: str, content: dict[str, Any]) -> list[str]:
    lines = [title, "", *(f"{key}: {value}" for key, value in content["facts"].items()), "", "Datum", content["datum"]]
    lines += ["", "Dimensions (mm)", *(f"{d.value_mm:10.4f}  {d.name}" for d in content["dimensions"])]
    for name, facts in content["faces"].items():
        lines += ["", f"Face {name}", *(f"{key}: {value}" for key, value in facts.items())]
    lines += ["", "Verdicts"]
    lines += [
        f"[{'yes' if v['holds'] else 'NO '}] {v['name']}, {v['surface']}: {v['reason']}" for v in content["verdicts"]
    ]
    lines += [
        "",
        "Gates",
        *(f"[{'yes' if g['passed'] else 'NO '}] {g['name']} = {g['value']:.6g} {g['unit']}" for g in content["gates"]),
    ]
    return [*lines, "", "SHA-256", *(f"{digest}  {name}" for name, digest in content["hashes"].items())]
