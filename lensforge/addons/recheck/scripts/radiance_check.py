# Run by us: lensforge's nightly tests run this program, with the Radiance of pip install pyradiance numpy.
"""The light of the exported part by Radiance: rays of the source through its dielectric, counted on the detector.

Usage: python radiance_check.py [RAYS]. The programs obj2mesh, oconv and rcontrib are those of the package pyradiance,
or of the search path. A ray is followed through one reflection that takes most of its light, not through what faces
reflect beside: a lens that works by total reflection more than once is not for it.
"""

import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from kit_figures import AXES, DETECTOR, HERE, IS_FAR, KIT, judged, source_rays

SCENE = """void dielectric glass
0
0
5 {clear} {clear} {clear} {index} 0

glass mesh lens
1 lens.rtm
0
0

void light there
0
0
3 1 1 1

there {shape} screen
0
0
{numbers}
"""


def main() -> int:
    """Trace the rays, and compare."""
    rays = source_rays(int(sys.argv[1]) if len(sys.argv) > 1 else None)
    rows, columns = np.array(KIT["zone_shares"]).shape
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(folder, "obj2mesh", str(HERE / "lens.obj"), "lens.rtm")
        clear = np.exp(-KIT["absorption_per_mm"])
        scene = SCENE.format(clear=clear, index=KIT["refractive_index"], **screen())
        (folder / "scene.rad").write_text(scene)
        (folder / "scene.oct").write_bytes(run(folder, "oconv", "scene.rad"))
        (folder / "zones.cal").write_text(zones_of_directions() if IS_FAR else zones_of_points())
        options = ["-h", "-V-", "-lr", "1", "-lw", "0.3", "-ab", "0", "-fad", "-c", str(len(rays))]
        options += ["-f", "zones.cal", "-bn", str(2 * rows * columns), "-b", "zone", "-m", "there", "scene.oct"]
        text = "\n".join(" ".join(f"{value:.12g}" for value in ray) for ray in rays) + "\n"
        light = np.frombuffer(run(folder, "rcontrib", *options, given=text.encode()), dtype=np.float64)
    counted = light.reshape(2, rows, columns, 3)[..., 0]  # outside the window, in it
    return judged("Radiance", float(counted[1].sum()), counted.sum(axis=0), len(rays))


def run(folder: Path, *command: str, given: bytes = b"") -> bytes:
    """Run a program of Radiance, and return its output."""
    package = find_spec("pyradiance")
    there = dict(os.environ)
    if package and package.origin:
        home = Path(package.origin).parent
        there |= {"PATH": f"{home / 'bin'}{os.pathsep}{there['PATH']}", "RAYPATH": f".:{home / 'lib'}"}
    try:
        return subprocess.run(command, cwd=folder, input=given, stdout=subprocess.PIPE, env=there, check=True).stdout
    except FileNotFoundError:
        sys.exit(f"{command[0]}: not found; pip install pyradiance, or install Radiance")


def screen() -> dict[str, str]:
    """The detector: a rectangle, or all directions."""
    if IS_FAR:
        return {"shape": "source", "numbers": "4 0 0 1 360"}
    x = 0.5 * DETECTOR["width"] * AXES[0]
    y = 0.5 * DETECTOR["height"] * AXES[1]
    corners = np.array(DETECTOR["centre_mm"]) + np.array([-x - y, x - y, x + y, y - x])
    return {"shape": "polygon", "numbers": " ".join(f"{value:.12g}" for value in (12, *corners.ravel()))}


def zones_of_points() -> str:
    """Numbers of zones by the point that a ray hits."""
    x0, y0, z0 = DETECTOR["centre_mm"]
    places = (f"(Px-({x0}))*({x})+(Py-({y0}))*({y})+(Pz-({z0}))*({z})" for x, y, z in AXES[:2])
    return numbered(*places)


def zones_of_directions() -> str:
    """Numbers of zones by the direction of a ray, on the chart of equal areas."""
    x, y, z = (f"(Dx*({a})+Dy*({b})+Dz*({c}))" for a, b, c in AXES)
    return f"k = sqrt(2/(1+{z}));\n" + numbered(f"k*{x}", f"k*{y}")


def numbered(x: str, y: str) -> str:
    """Numbers of zones by their places on the detector; those in the window follow the others."""
    rows, columns = np.array(KIT["zone_shares"]).shape
    reach = [1e30 if side is None else side for side in DETECTOR["window"]]
    return (
        f"x = {x};\ny = {y};\n"
        f"column = floor({columns}*(x/{DETECTOR['width']}+.5));\nrow = floor({rows}*(y/{DETECTOR['height']}+.5));\n"
        f"apart = max(max(abs(x)-{0.5 * reach[0]}, abs(y)-{0.5 * reach[1]}), sqrt(x*x+y*y)-{reach[2]});\n"
        f"max(a,b) = if(a-b, a, b);\nabs(a) = if(a, a, -a);\n"
        f"limited(a,n) = if(a, if(a-n+1, n-1, a), 0);\n"
        f"zone = limited(column,{columns}) + {columns}*limited(row,{rows}) + {rows * columns}*if(apart, 0, 1);\n"
    )


if __name__ == "__main__":
    sys.exit(main())
