"""Files of materials: glass catalogues, files of refractiveindex.info, and tables; each becomes the glass of a lens."""

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np

import lensforge as lf
from fuzzing.chance import Chance
from fuzzing.kind import Files, Kind
from fuzzing.lines import changed_text
from fuzzing.ray_files import require_finite
from fuzzing.spec_texts import small
from lensforge.spec import parse_spec

_AGF = b"""CC all lines that are read
NM GLASS-A 2 517642.251 1.5168 64.17 0 1
ED 7.1 8.3 2.51 -0.0009 0
CD 1.03961212 0.00600069867 0.231792344 0.0200179144 1.01046945 103.560653 0 0 0 0
TD 1.86E-6 1.31E-8 -1.37E-11 4.34E-7 6.27E-10 0.17 20
LD 0.3 2.5
IT 0.40 0.998 10
IT 0.55 0.9 5
NM GLASS-B 1 0 1.52308 58.57 0 3
CD 2.286575 -8.7334582e-3 1.1742884e-2 2.9041756e-4 -1.2506695e-5 9.2646253e-7
TD - - - - - - -
LD 0.33 2.1
"""
_FORMULA = b"""# licence
REFERENCES: |
    somebody, "a journal" 3, 5 (2001)
SPECS:
  n_is_absolute: false
  temperature: 20.0 C
DATA:
  - type: formula 2
    wavelength_range: 0.4368 1.052
    coefficients: 0 1.2969 0.011721
  - type: tabulated k
    data: |
        0.400 2.0E-7
        0.600 1.0E-7
"""
_COEFFICIENTS = {
    1: "0 1.2969 0.1", 3: "2.25 0.01 -2", 4: "2.25 0.01 2 0.1 2 0 0 0 1", 5: "1.5 0.01 -2", 6: "0.5 0.01 60",
    7: "1.5 0.01 0 0 0 0", 8: "0.3 0.01 0.01 0", 9: "2.25 0.01 0.01 0.01 0.3 0.5",
}  # fmt: skip
_TABLE = b"""DATA:
  - {type: tabulated nk, data: "0.4 1.52 1e-7\\n0.6 1.51 2e-7\\n0.7 1.50 0"}
"""
_ROWS = [
    b"wavelength,index,transmittance of 1 mm\n400, 1.52, 0.99\n500, 1.51, 0.995\n700, 1.50, 1.0\n",
    b"# nm n\n700\t1.50\n600 1.51\n400\t1.52\n",
]
# What a reader of YAML makes of a few bytes: copies of copies, types, sexagesimal numbers, deep or endless lists.
_YAML = (
    b"&a ", b"*a", b"<<: *a\n", b"!!python/object/apply:os.system [true]", b"!!binary aGk=", b"!!set {a, b}",
    b":".join([b"1"] * 5000), b"2001-01-01 00:00:00", b"[" * 2000, b"{a: " * 500, b"- " * 3000, b"? " * 3000,
    b"x: &x [y, y, y, y, y]\nz: &z [*x, *x, *x, *x, *x]\n", b"---\n" * 100, b"...\n", b"%YAML 1.1\n---\n", b"~",
    b"| \n",
    b"[" + b"1," * 20_000 + b"]", b"".join(b"k%d: 1\n" % k for k in range(4000)), b"0x1F",
    b"1_000", b"\t", b"\\x00",
)  # fmt: skip


def _formulas() -> list[bytes]:
    """A file for each formula of the database."""
    other = [
        _FORMULA.replace(b"formula 2", b"formula %d" % number).replace(b"0 1.2969 0.011721", words.encode())
        for number, words in _COEFFICIENTS.items()
    ]
    return [_FORMULA, _TABLE, *other]


def _changed_yaml(chance: Chance) -> bytes:
    content = changed_text(chance, _formulas())
    if chance.share(0.4):
        at, word = chance.below(len(content) + 1), chance.pick(_YAML)
        content = content[:at] + word + content[at + chance.below(3) :]
    return content


def _lens_of(path: Path, name: str) -> lf.Spec:
    content = small()
    content["lens"] |= {"material": name, "material_file": str(path)}
    content["lens"].pop("refractive_index", None)
    return parse_spec(content, "sample")


def _reader(file: str, names: tuple[str, ...]) -> Callable[[Path], object]:
    """Take each of the glasses; one at least must be there. Where it is known, its index is that of a material."""

    def read(folder: Path) -> object:
        accepted, refused = [], None
        for name in names:
            try:
                spec = _lens_of(folder / file, name)
            except lf.InputError as error:
                refused = error
                continue
            material = spec.lens.dispersion
            waves = np.linspace(*material.trusted_nm, 50)
            require_finite(material.index(waves), np.array(spec.lens.media.absorption_per_mm))
            if parse_spec(tomllib.loads(spec.to_toml()), "again") != spec:
                raise ValueError("accepted, but written as TOML it is another spec")
            accepted.append(spec)
        if refused is not None and not accepted:
            raise refused
        return accepted

    return read


def _kind(
    name: str, file: str, make: Callable[[Chance], bytes], originals: list[bytes], names: tuple[str, ...]
) -> Kind:
    return Kind(
        name, lambda chance: {file: make(chance)}, _reader(file, names),
        lambda: [Files({file: content}) for content in originals], 1.0,
    )  # fmt: skip


KINDS = [
    _kind("agf", "c.agf", lambda chance: changed_text(chance, [_AGF]), [_AGF], ("GLASS-A", "glass-b")),
    _kind("yaml", "x.yml", _changed_yaml, _formulas(), ("x",)),
    _kind("index", "x.csv", lambda chance: changed_text(chance, _ROWS), _ROWS, ("x",)),
]
