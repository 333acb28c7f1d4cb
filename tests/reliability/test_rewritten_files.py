"""Files that a shop's program has written again: judged by geometry and light, whatever their bytes are.

The command reads them from the folder. A part that is the same passes, with a note in the result and on the page; one
that is not fails, and says why.
"""

import io
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import cadquery as cq
import pytest
import trimesh
from click.testing import CliRunner
from made_once import copied
from nightly import first_by_day

import lensforge as lf
from lensforge.cli.cli import cli
from lensforge.report.pipeline import write_report

pytestmark = pytest.mark.usefixtures("undrawn")

NOTE = "{} is not the file that was exported: judged by its geometry and light"


@pytest.fixture
def folder(small_run: lf.Run, tmp_path: Path) -> Path:
    return copied(small_run.folder, tmp_path / "run")


def rewritten_step(folder: Path, change: Callable[[cq.Shape], cq.Shape], unit: str = "MM") -> None:
    """Write the STEP again by cadquery: without names of faces, with another header, in ``unit``."""
    from OCP.Interface import Interface_Static

    path = folder / "lens.step"
    shape = change(cq.importers.importStep(str(path)).val())
    Interface_Static.SetCVal_s("write.step.unit", unit)
    try:
        cq.exporters.export(cq.Workplane(shape), str(path))
    finally:
        Interface_Static.SetCVal_s("write.step.unit", "MM")
    assert b"OPTICAL_INNER" not in path.read_bytes()


def rewritten_stl(folder: Path, change: Callable[[trimesh.Trimesh], trimesh.Trimesh]) -> None:
    """Write the STL again by trimesh, as text, its triangles in another order."""
    path = folder / "lens.stl"
    mesh = change(trimesh.load(path))
    mesh.update_faces(range(len(mesh.faces))[::-1])
    path.write_text(mesh.export(file_type="stl_ascii"), encoding="ascii")


def verified(folder: Path) -> tuple[int, str, str]:
    """Exit code of the command, what it prints, and what it says beside."""
    done = CliRunner().invoke(cli, ["verify", str(folder)])
    return done.exit_code, done.stdout, done.stderr


@pytest.mark.nightly("ten seconds; by day an altered file is named")
def test_files_written_again_pass_with_a_note(folder: Path) -> None:
    rewritten_step(folder, lambda shape: shape, "INCH")
    rewritten_stl(folder, lambda mesh: mesh)
    with pytest.raises(lf.InputError, match=r"lens\.step: not the file .* or `lensforge verify`"):
        lf.load(folder)
    code, printed, errors = verified(folder)
    assert code == 0, errors
    assert printed.startswith("CAD files: pass\n")
    for name in ("lens.step", "lens.stl"):
        assert NOTE.format(name) in errors
    run = lf.load(folder)
    assert run.verdict.files == "pass" and run.proof.altered_files == ("lens.step", "lens.stl")
    assert NOTE.format("lens.step") in str(run.proof)
    write_report(folder)
    assert NOTE.format("lens.stl") in (folder / "report.html").read_text(encoding="utf-8")
    (folder / "lens.stl").write_bytes((folder / "lens.stl").read_bytes() + b"\n")
    with pytest.raises(lf.InputError, match=r"lens\.step: not the file"):  # verified were other bytes
        lf.load(folder)


def thicker(shape: cq.Shape) -> cq.Shape:
    """A base 1 mm too thick, with its opening."""
    bottom = cq.Workplane(shape).faces("<Z").wires().toPending().extrude(-1.0, combine=False).val()
    return shape.fuse(bottom).clean()


def deeper(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.vertices[mesh.vertices[:, 2] < -1e-3, 2] -= 1.0
    return mesh


@pytest.mark.nightly("a minute: exports of other bodies")
@pytest.mark.parametrize(
    ("step", "stl", "says"),
    first_by_day(
        1,
        [
            (thicker, deeper, "lens.step is another body than the one exported"),
            (lambda shape: shape.scale(1.001), lambda mesh: mesh.apply_scale(1.001), "scaled by 1.001"),
        ],
        "half a minute each",
    ),
)
def test_another_body_fails_and_says_why(
    folder: Path, step: Callable[[cq.Shape], cq.Shape], stl: Callable[[trimesh.Trimesh], trimesh.Trimesh], says: str
) -> None:
    rewritten_step(folder, step)
    rewritten_stl(folder, stl)
    code, printed, _ = verified(folder)
    assert code == 1 and printed.startswith("CAD files: fail\n")
    assert says in " ".join(printed.split()), printed
    assert "finer mesh" not in printed


@pytest.mark.nightly("half a minute")
def test_a_3mf_that_was_packed_again_passes_with_a_note_and_a_damaged_one_is_refused(folder: Path) -> None:
    path = folder / "lens.3mf"
    packed, again = ZipFile(path), io.BytesIO()
    with ZipFile(again, "w") as target:
        for name in packed.namelist():
            target.writestr(name, packed.read(name))
    path.write_bytes(again.getvalue())
    code, printed, errors = verified(folder)
    assert code == 0 and printed.startswith("CAD files: pass\n"), errors
    assert "lens.3mf is not the file that was exported: judged by its geometry" in errors
    path.write_bytes(again.getvalue()[:-100])
    code, _, errors = verified(folder)
    assert code == 2 and "lens.3mf: not readable as 3MF" in errors
