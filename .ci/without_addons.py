"""Delete each add-on in a copy of the checkout, with its tests, and run tests of the rest there.

python .ci/without_addons.py              each add-on in turn: make quick
python .ci/without_addons.py studio       this one
python .ci/without_addons.py studio tests/runs tests/report     this one, and these tests

Pages tell of all that is shipped, so that tests/pages is no part of it. Exit code 1 where a test fails.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
QUICK = ("definitions", "light", "optics", "kernels", "spec", "runs", "test_architecture.py", "test_addon.py")


def main() -> int:
    """Try the add-ons that are named, or all."""
    known = sorted(path.parent.name for path in (ROOT / "lensforge" / "addons").glob("*/__init__.py"))
    names = [name for name in sys.argv[1:] if name in known]
    tests = [name for name in sys.argv[1:] if name not in known] or [f"tests/{name}" for name in QUICK]
    failed = [name for name in names or known if not passes_without(name, tests)]
    print("failed without:", ", ".join(failed) or "none")
    return min(len(failed), 1)


def passes_without(name: str, tests: list[str]) -> bool:
    """True where the tests pass in a copy without the add-on."""
    copy = ROOT / "build" / "without" / name
    shutil.rmtree(copy, ignore_errors=True)
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True).stdout
    for file in map(Path, files.splitlines()):
        if not file.is_relative_to(f"lensforge/addons/{name}") and not file.is_relative_to(f"tests/addons/{name}"):
            (copy / file).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / file, copy / file)
    print(f"without {name}:", flush=True)
    command = [str(ROOT / ".venv/bin/python"), "-m", "pytest", "-n", "2", "--dist", "loadfile", *tests]
    return subprocess.run(command, cwd=copy, env=os.environ | {"PYTHONPATH": str(copy)}).returncode == 0


if __name__ == "__main__":
    sys.exit(main())
