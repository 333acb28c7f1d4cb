"""STL, 3MF and STEP files from outside: bounded before any work, and read in a child process that may crash."""

import random
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from nightly import NIGHTLY, first_by_day

import lensforge as lf
from lensforge.cad.custom_base import read_custom_base
from lensforge.cad.mesh_files import parse_stl
from lensforge.cad.step import parse_step
from lensforge.errors import InputError
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.results import file_bounds as stl_bounds
from lensforge.results.sandbox import Child, ChildLimits, Ending

LIMITS = ChildLimits(memory_mib=400, seconds=60.0)


def child_of(tmp_path: Path, body: str, limits: ChildLimits = LIMITS) -> tuple[Ending, str]:
    """Ending of a child whose work is ``body``."""
    script = tmp_path / "script.py"
    lines = "".join(f"    {line}\n" for line in body.splitlines())
    text = f"from lensforge.results.sandbox import serve\ndef work(folder):\n{lines}serve(work)\n"
    script.write_text(text, encoding="utf-8")
    folder = tmp_path / "work"
    folder.mkdir(exist_ok=True)
    with Child(script, folder, limits) as child:
        return child.wait()


def test_a_child_ends_in_the_way_that_it_says(tmp_path: Path) -> None:
    assert child_of(tmp_path, "pass") == (Ending.DONE, "")
    refusal = "from lensforge.errors import InputError\nraise InputError('bad:\\n worse')"
    assert child_of(tmp_path, refusal) == (Ending.REFUSED, "bad: worse")
    assert child_of(tmp_path, "1 / 0") == (Ending.FAILED, "stopped its reader (ZeroDivisionError: division by zero)")
    ending, message = child_of(tmp_path, "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)")
    assert (ending, message) == (Ending.CRASHED, "stopped its reader (SIGSEGV)")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems may not limit processor time")
def test_a_child_that_the_system_ends_after_its_processor_time_is_said_to_take_too_long(tmp_path: Path) -> None:
    body = "import os, signal\nos.kill(os.getpid(), signal.SIGXCPU)"
    assert child_of(tmp_path, body) == (Ending.TIME, "took more than 60 s of processor time")


def test_a_child_that_takes_too_long_ends_with_all_that_it_started(tmp_path: Path) -> None:
    body = (
        "import subprocess, time\n"
        "process = subprocess.Popen(['sleep', '600'])\n"
        "(folder / 'pid').write_text(str(process.pid))\n"
        "time.sleep(600)"
    )
    ending, message = child_of(tmp_path, body, ChildLimits(400, 1.0))
    assert (ending, message) == (Ending.TIME, "took more than 4 s")
    grandchild = int((tmp_path / "work" / "pid").read_text(encoding="utf-8"))
    deadline = time.monotonic() + 5.0  # a process that was killed ends when the system comes to it
    while is_running(grandchild) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not is_running(grandchild)


@pytest.mark.nightly("five seconds")
@pytest.mark.skipif(sys.platform != "linux", reason="other systems may not limit processor time")
def test_processor_time_is_limited_and_a_busy_machine_does_not_count(tmp_path: Path) -> None:
    busy = child_of(tmp_path, "while True:\n    pass", ChildLimits(400, 2.0))
    assert busy == (Ending.TIME, "took more than 2 s of processor time")
    assert child_of(tmp_path, "import time\ntime.sleep(2.5)", ChildLimits(400, 2.0)) == (Ending.DONE, "")


def is_running(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return state.rpartition(")")[2].split()[0] not in "ZX"


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit memory")
def test_a_child_that_needs_too_much_memory_says_so(tmp_path: Path) -> None:
    assert child_of(tmp_path, "bytes(2**30)") == (Ending.MEMORY, "needs more than 400 MiB of memory")


def binary(triangles: np.ndarray) -> bytes:
    """A binary STL of corners [t, 3, 3]."""
    records = np.zeros(len(triangles), stl_bounds._RECORDS)
    records["corners"] = triangles
    return bytes(80) + len(triangles).to_bytes(4, "little") + records.tobytes()


def ball(subdivisions: int = 4) -> np.ndarray:
    return np.array(trimesh.creation.icosphere(subdivisions, 5.0).triangles)


def changed(value: float) -> bytes:
    corners = ball(2)
    corners[7, 1, 2] = value
    return binary(corners)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "states 0 triangles, 84 bytes, and has 0"),
        (binary(ball(2))[:-1], "states 320 triangles, 16084 bytes, and has 16083"),
        (binary(np.zeros((0, 3, 3))), "holds no triangles"),
        (changed(1e30), r"a vertex lies at 1e\+30 mm, at most 10000 mm is read"),
        (changed(np.inf), "a vertex lies at inf mm"),
        (changed(np.nan), "a vertex lies at nan mm"),
        (b"solid x\nfacet\nvertex 1 2 3\nendfacet\nendsolid", "1 facets, but 1 vertices"),
        (b"solid x\nfacet\nvertex 1 2 3\nvertex 1 2 1e-\nvertex 0 0 0\nendfacet\nendsolid", "not readable as STL"),
        (b"solid x\nfacet\nvertex 1 2 3\nvertex 1 2 1e999\nvertex 0 0 0\nendfacet\nendsolid", "lies at inf mm"),
    ],
    ids=["empty", "short", "none", "far", "infinite", "nan", "corner", "number", "overflow"],
)
def test_a_hostile_stl_is_refused_before_any_work(content: bytes, message: str) -> None:
    for read in (parse_stl, read_part_mesh):
        with pytest.raises(InputError, match=message) as caught:
            read(content)
        assert "\n" not in str(caught.value)


def test_text_and_binary_stl_hold_the_same_triangles() -> None:
    mesh = trimesh.creation.icosphere(2, 5.0)
    text = mesh.export(file_type="stl_ascii").encode()
    (vertices, triangles), (others, same) = parse_stl(text), parse_stl(mesh.export(file_type="stl"))
    assert vertices[triangles] == pytest.approx(others[same], abs=1e-6)
    assert len(vertices) == 162


def test_normals_that_a_file_states_are_not_believed() -> None:
    content = bytearray(binary(ball(3)))
    records = np.frombuffer(content, stl_bounds._RECORDS, offset=84)
    records["normal"][:] = (0.0, 0.0, 1.0)
    mesh = read_part_mesh(bytes(content)).mesh
    assert np.sum(mesh.face_normals * mesh.triangles_center, axis=1).min() > 4.5


def clamp() -> bytes:
    """A STEP file of a bored plate."""
    import cadquery as cq

    from lensforge.cad.solid import Solid
    from lensforge.cad.step import step_bytes

    plate = cq.Workplane("XY").rect(8.0, 8.0).extrude(-2.0).cut(cq.Workplane("XY").circle(1.5).extrude(-2.0)).val()
    return (
        step_bytes(Solid(plate.wrapped, {"SEAT": plate.Faces()[0].wrapped}), "clamp") + b"\n"
    )  # no longer this process's own bytes


def shuffled(content: bytes, seed: int) -> bytes:
    """``content`` with the references of its entities shuffled."""
    chance = random.Random(seed)
    numbers = re.findall(rb"(?<![\n])#(\d+)", content)
    chance.shuffle(numbers)
    following = iter(numbers)
    return re.sub(rb"(?<![\n])#\d+", lambda _: b"#" + next(following), content)


def test_a_step_file_from_outside_is_read_as_it_is() -> None:
    solid = parse_step(clamp())
    assert set(solid.faces) == {"SEAT"}
    assert solid.volume_mm3 == pytest.approx(2.0 * (64.0 - np.pi * 2.25), rel=1e-9)


@pytest.mark.parametrize("seed", first_by_day(1, [1, 2]))
def test_shuffled_references_are_one_line(tmp_path: Path, seed: int) -> None:
    content = shuffled(clamp(), seed)
    (tmp_path / "clamp.step").write_bytes(content)
    readers = (lambda: read_custom_base(tmp_path / "clamp.step"), lambda: parse_step(content))
    for read in readers if NIGHTLY else readers[:1]:  # in a child each
        with pytest.raises(InputError, match=r"^\S*(lens|clamp)\.step: ") as caught:
            read()
        assert "\n" not in str(caught.value)


def test_verification_judges_the_light_of_an_altered_file_and_names_it(small_run: lf.Run) -> None:
    stl = b"altered" + small_run.part.stl[7:]  # the header: the same triangles
    altered = small_run.part.model_copy(update={"stl": stl})
    proof = lf.verify(altered, small_run.light, rays=512)
    assert (small_run.proof.altered_files, proof.altered_files) == ((), ("lens.stl",))
    assert proof.deviation_mm.rms == pytest.approx(small_run.proof.deviation_mm.rms, rel=0.5)
    if not NIGHTLY:  # ten seconds more
        return
    unaltered = lf.verify(small_run.part, small_run.light, rays=512)
    assert (
        proof.deviation_mm == unaltered.deviation_mm
        and proof.first.brep is not None
        and unaltered.first.brep is not None
    )
    assert proof.first.brep.against_design == unaltered.first.brep.against_design
    np.testing.assert_array_equal(proof.irradiance, unaltered.irradiance)
