"""``lensforge photometry`` as a user meets it."""

from click.testing import CliRunner
from scenes import random_surface, small_spec

from lensforge.cli.cli import cli
from lensforge.light.photometry_result import Photometry
from lensforge.scene.lens import Lens


def test_the_command_writes_and_says_so(tmp_path):
    lens = Lens(random_surface(1, 3.0, 0.01), random_surface(2, 6.0, 0.01), small_spec(), seed=0, accuracy="draft")
    lens.save(tmp_path / "lens.json")
    result = CliRunner().invoke(cli, ["photometry", str(tmp_path), "--rays", "4096", "--lumens", "90"])
    assert result.exit_code == 0
    assert "of 90 lm of the source\n" in result.stdout
    assert "luminous flux" not in result.stderr
    assert (tmp_path / "lens_4096rays.ldt").read_text(encoding="utf-8").splitlines()[28] == "90"
    assert Photometry.read(tmp_path, "photometry_4096rays").ldt == (tmp_path / "lens_4096rays.ldt").read_bytes()


def test_relative_candela_are_said_on_the_terminal(tmp_path):
    lens = Lens(random_surface(1, 3.0, 0.01), random_surface(2, 6.0, 0.01), small_spec(), seed=0, accuracy="draft")
    lens.save(tmp_path / "lens.json")
    result = CliRunner().invoke(cli, ["photometry", str(tmp_path), "--rays", "4096"])
    assert result.exit_code == 0
    assert "warning: luminous flux of the source not known: 1000 lm taken" in result.stderr
    assert "of 1000 lm of the source, which states no flux" in result.stdout
