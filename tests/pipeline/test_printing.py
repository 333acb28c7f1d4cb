"""Digits of the printed table: as many as the figures' errors carry."""

import pytest

from lensforge.commands.printing import print_table


@pytest.mark.parametrize(
    ("content", "line"),
    [
        ({"form_error_nm": {"max": 0.137654321}}, "form_error_nm.max\t0.14"),
        ({"normal_error_mrad": {"max": 0.00196543}}, "normal_error_mrad.max\t0.002"),
        ({"triangulation": {"chord_error_um": 0.9396505750732}}, "triangulation.chord_error_um\t0.94"),
        ({"wall": {"radial": {"thickness_mm": 2.217123456789}}}, "wall.radial.thickness_mm\t2.217123"),
        ({"draft_deg": {"area_fraction_below_half": 0.00012987654}}, "draft_deg.area_fraction_below_half\t0.00013"),
        ({"cutter": {"reachable_fraction": 0.94312345}}, "cutter.reachable_fraction\t0.943"),
        ({"volume_mm3": 75696.56795739077}, "volume_mm3\t75696.56795739077"),
        ({"triangles": 694176}, "triangles\t694176"),
        ({"largest_radius_mm": None}, "largest_radius_mm\tNone"),
    ],
)
def test_a_figure_is_printed_with_the_digits_that_its_error_carries(
    content: dict[str, object], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    print_table(content)
    assert capsys.readouterr().out == line + "\n"
    print_table(content, "export.")
    assert capsys.readouterr().out == f"export.{line}\n"
