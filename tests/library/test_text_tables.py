"""The reader of text tables: every dress of the same numbers, and a place in each refusal."""

import warnings

import numpy as np
import pytest

from lensforge.errors import FileWarning, InputError
from lensforge.results.table_names import Column
from lensforge.results.text_table import TextTable, read_list

WAVELENGTH = Column(("wavelength", "lambda"), {"nm": 1.0, "um": 1e3, "": 1.0})
COLUMNS = (WAVELENGTH, Column(("index", "n")), Column(("transmittance", "t"), {"": 1.0, "%": 0.01}, needed=False))
CELLS = (("400.25", "0.5"), ("1000", "-2.5e-3"), ("7", "0.125"))
NUMBERS = np.array(CELLS, dtype=float)


def table(content, **options):
    raw = content if isinstance(content, bytes) else content.encode()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return TextTable.of(raw, "t.csv", **options)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize(
    ("mark", "sign"), [(",", "."), (", ", "."), *[(m, s) for m in ";\t " for s in ".,"], ("  ", ",")]
)
def test_the_same_numbers_in_every_dress(mark, sign, encoding, end):
    head = "# größe 1,2;3.4\nµ-metre, a title; no names\n\n"
    rows = [mark.join(row).replace(".", sign) if mark.strip() != "," else mark.join(row) for row in CELLS]
    text = head + end.join([rows[0], "", *rows[1:], mark.strip(" ") * 3]) + end
    np.testing.assert_array_equal(table(text.replace("\n", end).encode(encoding)).numbers(), NUMBERS)


@pytest.mark.parametrize(
    ("content", "rows"),
    [
        ("1.200,5;3\n4.300;0,25", [[1200.5, 3.0], [4300.0, 0.25]]),
        ("1,200.5;3\n4,300;2", [[1200.5, 3.0], [4300.0, 2.0]]),
        ("1 234,5;3\n1\u202f000\u202f234;4", [[1234.5, 3.0], [1000234.0, 4.0]]),
        ("1'234.5\t3\n1’000\t4", [[1234.5, 3.0], [1000.0, 4.0]]),
        ('"1,5","2,5"\n"3,125","4"', [[1.5, 2.5], [3.125, 4.0]]),
        ('"1,200.5", 2\n"1,300",3', [[1200.5, 2.0], [1300.0, 3.0]]),
        ("400,000;0,123\n", [[400.0, 0.123]]),
        ("sep=;\n1,5;2\n", [[1.5, 2.0]]),
        ("−1;2D2 # a remark\n.5;1E3", [[-1.0, 200.0], [0.5, 1000.0]]),
        ("1,2,\n3,4,\n,,\n", [[1.0, 2.0], [3.0, 4.0]]),
        ("0,1,0\n1,0,1", [[0.0, 1.0, 0.0], [1.0, 0.0, 1.0]]),
        ("1.5,2, 3\n4,5,6", [[1.5, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        ("5,\t6\n7, 8", [[5.0, 6.0], [7.0, 8.0]]),
    ],
)
def test_marks_in_numbers_and_between_them(content, rows):
    np.testing.assert_array_equal(table(content).numbers(), rows)


@pytest.mark.parametrize(
    ("content", "rows", "message"),
    [
        ("1,200;1,300", [[1.2, 1.3]], "every comma stands before three digits: taken as a decimal sign"),
        ("0,5\n1,0\n", [[0.0, 5.0], [1.0, 0.0]], "no number has a decimal point: its commas are taken to separate"),
    ],
)
def test_what_can_be_read_in_two_ways_is_said(content, rows, message):
    with pytest.warns(FileWarning, match=message):
        text_table = TextTable.of(content, "t.csv")
    np.testing.assert_array_equal(text_table.numbers(), rows)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "t.csv: has no row of numbers"),
        ("a;b\n", "t.csv: has no row of numbers; line 1 begins with 'a;b'"),
        ("0.5;2\n1;2\n3;1,200", "line 3, column 2: '1,200' beside numbers with decimal points"),
        ("0,5;2\n1.234;3", "line 2, column 1: '1.234' beside numbers with decimal commas"),
        ("1.5;2,5", "line 1, column 2: '2,5' beside numbers with decimal points: use one sign"),
        ("1;2\n0,05,0,1", "line 2: 1 cells, line 1 has 2"),
        ("1,1,2,1\n0,05,0,1", "line 2: '0,05': commas between numbers and in them cannot be told apart"),
        ("1,5, 2,5", "line 1: commas with blanks beside them and without"),
        ("# a\n\n1,2\n3\n", "line 4: 1 cells, line 3 has 2; commas separate its cells"),
        ("1,2\n3,4,5\n", "line 2: 3 cells, line 1 has 2"),
        ("1 2\n3 x4\n", "line 2, column 2: 'x4' is no number; blanks separate"),
        ("1;2\n3;\n", "line 2, column 2: no number"),
        ("1;2\nnan;4\n", "line 2, column 1: 'nan' is not a finite number"),
        ("inf;2\n3;4\n", "line 1, column 1: 'inf' is not a finite number"),
        ("1;1e999", "column 2: '1e999' is not a finite number"),
        ("1;1_000", "column 2: '1_000' is no number"),
        ("1;0x10", "column 2: '0x10' is no number"),
        ("1;٣", "column 2: '٣' is no number"),
        ("1.234.56;1,5", "column 1: '1.234.56' beside numbers with decimal commas"),
        ('1;"2\n3";4', "line 1: a quotation mark that is not closed"),
        (b"1;2\n3\0;4", "line 2: not a text file: it has the character 00 hex"),
        ("1;2\r\n3\x1c;4\r\n", "line 2: not a text file: it has the character 1c hex"),
        ("1;2\u2028;3", "line 1: not a text file: it has the character 2028 hex"),
    ],
)
def test_a_refusal_has_a_place(content, message):
    with pytest.raises(InputError, match=message) as caught:
        table(content).numbers()
    assert str(caught.value).isprintable() and str(caught.value).startswith("t.csv")


@pytest.mark.parametrize(
    ("content", "rows"),
    [
        ("n;Wavelength [µm]\n1,5;0,4\n", [[400.0, 1.5, np.nan]]),
        ("Wavelength / nm\tN\tT (%)\n400\t1.5\t99\n", [[400.0, 1.5, 0.99]]),
        ("t,lambda in um,n\n0.5,.4,1.5", [[400.0, 1.5, 0.5]]),
        ("index wavelength_um\n1.5 0.4", [[400.0, 1.5, np.nan]]),
        ("WAVELENGTH (NM),INDEX\n400,1.5", [[400.0, 1.5, np.nan]]),
        ("a title of the table\n400,1.5,0.5", [[400.0, 1.5, 0.5]]),
    ],
)
def test_names_and_units_decide_over_the_order(content, rows):
    np.testing.assert_allclose(table(content).columns(COLUMNS), rows)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("lambda,n,N\n400,1,2", "line 1, column 3: 'N' is there twice"),
        ("lambda,n,index\n400,1,2", "line 1, column 3: 'index': a second column index"),
        ("lambda [eV];n\n2;1.5", r"line 1, column 1: 'lambda \[eV\]': its unit must be one of nm, um"),
        ("foo,n,bar\n400,1.5,2", "line 1: no column wavelength_nm; found 'foo', 'n', 'bar'; name it so"),
        ("lambda,n\n400,1,5", "line 1: 2 names for 3 columns: 'lambda', 'n'"),
        ("400,1,1,1", "line 1: 4 cells, must be wavelength_nm, index, transmittance"),
        ("400\n500", "line 1: 1 cells, must be"),
        ("4OO;1.5\n500;1.6", "line 1, column 1: '4OO' is no number"),
        ("x400;1.5\n500;1.6", "line 1, column 1: 'x400' is no number"),
        ("lambda;n\n500;1.6\nn/a;2", "line 3, column 1: 'n/a' is no number"),
    ],
)
def test_names_and_rows_that_do_not_fit_are_refused(content, message):
    with pytest.raises(InputError, match=message):
        table(content).columns(COLUMNS)


def test_a_number_alone_before_the_rows_is_their_count():
    assert table("2\n1 2 3\n4 5 6\n", counted=True).count == 2
    with pytest.raises(InputError, match="line 1: 3 rows announced, 2 found"):
        table("3\n1 2 3\n4 5 6\n", counted=True)
    assert table("x_mm y_mm z_mm\n2\n1 2 3\n4 5 6\n", counted=True).count == 2, "below the names"
    assert table("3\n4\n", counted=True).numbers().tolist() == [[3.0], [4.0]]


def test_chosen_columns_leave_words_and_rows_of_any_length_behind():
    text_table = table("1;2,5;P1\n3;4;\n5;6;a;b\n")
    np.testing.assert_array_equal(text_table.numbers(used=[1, 0], further=True), [[2.5, 1.0], [4.0, 3.0], [6.0, 5.0]])
    with pytest.raises(InputError, match="line 3: 4 cells, line 1 has 3"):
        text_table.numbers(used=[1, 0])
    for further in (True, False):
        with pytest.raises(InputError, match="line 2: 1 cells, must be 2 at least"):
            table("1;2;P1\n3\n").numbers(used=[0, 1], further=further)
        with pytest.raises(InputError, match="line 1: 2 cells, must be 3 at least"):
            table("1;2\n3;4\n").numbers(used=[2], further=further)


def test_columns_by_names_have_rows_of_one_length():
    """A row that stands twice in a line would otherwise give a number of the first and a number of the second."""
    for text in ("lambda;n\n400;1.5\n500;1.5500;1.5\n", "400 1.5 0.9\n500 1.5 0.9500 1.5 0.9\n"):
        with pytest.raises(InputError, match=r"line [23]: [35] cells, line [12] has [23]"):
            table(text).columns(COLUMNS)


def test_blank_cells_count_as_what_the_caller_says():
    np.testing.assert_array_equal(table("1;2;3\n4;;\n5\n;6").numbers(blank=0.0)[1:], [[4, 0, 0], [5, 0, 0], [0, 6, 0]])


LEDS = (
    Column(("name",), is_text=True, needed=False), Column(("file",), is_text=True),
    Column(("flux",), {"lm": 1.0}, needed=False),
    Column(("flux",), {"w": 1.0, "mw": 1e-3}, needed=False),
)  # fmt: skip


@pytest.mark.parametrize(
    "content",
    [
        "file,flux_lm,name\na.ray,100.5,one #1\nb.ray,,\n",
        "sep=;\r\nName;File;Flux [lm]\r\none #1;a.ray;100,5\r\n;b.ray;\r\n;;\r\n",
        'name\tfile\tflux_lm\r"one #1"\t"a.ray"\t100.5\r\tb.ray\t\r',
    ],
)
def test_a_list_has_words_and_numbers_by_their_titles(content, tmp_path):
    (tmp_path / "t.csv").write_bytes(content.encode("utf-16"))
    one, two = read_list(tmp_path / "t.csv", LEDS, missing="give it", most_bytes=1000)
    assert dict(one.cells) | {"flux_lm": 0} == {"name": "one #1", "file": "a.ray", "flux_lm": 0}
    assert (one.number("flux_lm"), one.number("flux_w"), two.number("flux_lm")) == (100.5, None, None)
    assert dict(two.cells) == {"file": "b.ray"} and one.where.startswith(str(tmp_path / "t.csv"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("file\n", "must have a line of names"),
        ("name,flux_lm\na,1\n", "line 1: no column file; the columns are name, file, flux_lm, flux_w"),
        ("file,colour\na,1\n", "line 1: 'colour'; the columns are"),
        ("file,flux_lm,FLUX [lm]\na,1,2\n", "column 3: .* twice|second column"),
        ("file,name\na,b\n\nc\n", "line 4: 1 cells, line 1 has 2"),
        ("file,name\na,b,c\n", "line 2: 3 cells"),
        ("file;flux_lm\na;1,200\nb;0.5\n", "line 2, flux_lm: '1,200' beside numbers with decimal points"),
        ("file;flux_lm\na;many\n", "line 2, flux_lm: 'many' is no number"),
        ("file;flux_lm\na;1e999\n", "line 2, flux_lm: '1e999' is not"),
    ],
)
def test_a_list_that_cannot_be_read_has_a_line(content, message, tmp_path):
    (tmp_path / "t.csv").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        [entry.number("flux_lm") for entry in read_list(tmp_path / "t.csv", LEDS, missing="give it", most_bytes=1000)]
