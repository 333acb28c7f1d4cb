"""The shipped specs as a script in Python: a class for every table of their TOML.

``python tests/library/specs_in_python.py SCRIPT`` writes it; ``make lint`` checks its types, strictly, as a user would.
"""

import sys
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from lensforge.results.registered_kinds import kind_of, models_in
from lensforge.spec import Spec

EXAMPLES = Path(__file__).parents[2] / "examples"
HEAD = ("import datetime", "from pathlib import Path", "", "import lensforge as lf")
WITH_FILES = {"osram_pi"}  # whose ray file comes from the vendor, and may be absent


def shipped() -> dict[str, Path]:
    """The shipped specs by their names."""
    return {path.stem: path for path in sorted(EXAMPLES.rglob("*.toml"))}


def expression(path: Path) -> str:
    """The spec of a file as an expression in Python."""
    return _text(tomllib.loads(path.read_text(encoding="utf-8")), Spec)


def _text(value: object, annotation: Any) -> str:
    if isinstance(value, dict):
        models = models_in(annotation)
        if not models:
            return "{" + ", ".join(f"{key!r}: {_text(item, None)}" for key, item in value.items()) + "}"
        model = _class_of(value, models)
        fields = {name: item for name, item in value.items() if not (name == "kind" and kind_of(model))}
        given = (f"{name}={_text(item, model.model_fields[name].annotation)}" for name, item in fields.items())
        return f"lf.{model.__name__}({', '.join(given)})"
    if isinstance(value, list):
        return "(" + "".join(f"{_text(item, annotation)}, " for item in value) + ")"
    return f"Path({value!r})" if isinstance(value, str) and "Path" in str(annotation) else repr(value)


def _class_of(table: dict[str, object], models: tuple[type[BaseModel], ...]) -> type[BaseModel]:
    """The class of a table: by its kind, the usual one of its kinds, or the one that has its fields."""
    kind = table.get("kind", getattr(models[0], "usual_kind", None))
    named = [model for model in models if kind is not None and kind_of(model) == kind]
    return (named or [model for model in models if set(table) <= set(model.model_fields)])[0]


def script() -> str:
    """A module with a function for every shipped spec."""
    functions = (
        f"\n\ndef spec_{name}() -> lf.Spec:\n    return {expression(path)}" for name, path in shipped().items()
    )
    return "\n".join((*HEAD, *functions)) + "\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(script(), encoding="utf-8")
