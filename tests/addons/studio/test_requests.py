"""The server answers its own page alone, and writes in its folder alone."""

import contextlib
import http.client
import io
import json
import math
import shutil
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.addons.studio.connections import MOST_STRANGERS
from lensforge.addons.studio.dropped_files import DroppedFile
from lensforge.addons.studio.page_json import json_text
from lensforge.results.folder_lock import locked

Asked = tuple[int, dict[str, str], bytes]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[lf.Studio]:
    folder = tmp_path_factory.mktemp("studio") / "lens"
    folder.mkdir()
    (folder / "studio.toml").write_text(small_spec().to_toml(), encoding="utf-8")
    opened = lf.studio(folder, browser=False)
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def new_studio(tmp_path_factory: pytest.TempPathFactory) -> Iterator[lf.Studio]:
    """A studio that has written nothing: its folder is not there."""
    opened = lf.studio(tmp_path_factory.mktemp("new") / "lens", browser=False)
    yield opened
    opened.close()


def ask(page: lf.Studio, path: str = "", body: Any = None, secret: str | None = None, **headers: str) -> Asked:
    place = urlsplit(page.address)
    connection = http.client.HTTPConnection("127.0.0.1", place.port or 0, timeout=20)
    given = {"Host": place.netloc} | {name.replace("_", "-"): value for name, value in headers.items()}
    content = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
    root = place.path if secret is None else f"/{secret}/"
    connection.request("GET" if body is None else "POST", root + path, content, given)
    answer = connection.getresponse()
    return answer.status, dict(answer.getheaders()), answer.read()


def test_the_page_is_served_with_a_policy_that_loads_nothing_from_elsewhere(page: lf.Studio) -> None:
    for path in ("", "page/studio.js", "page/studio.css", "schema", "spec"):
        status, headers, content = ask(page, path)
        assert status == 200 and content
        policy = headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'") and "http" not in policy and "*" not in policy
    names = {path.name for path in (Path(lf.__file__).parent / "addons" / "studio" / "page").iterdir()}
    texts = [ask(page, f"page/{name}")[2].decode() for name in names]
    assert not [text for text in texts if "//" in text.replace("// ", "") and "http" in text]


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1"},
        {"Host": "evil.example"},
        {"Host": "127.0.0.1"},
        {"Host": "127.0.0.1:1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "cors"},
    ],
)
@pytest.mark.parametrize(("path", "body"), [("spec", None), ("events", None), ("spec", {"text": "stolen"})])
def test_another_site_or_another_name_is_refused(
    headers: dict[str, str], path: str, body: object, page: lf.Studio
) -> None:
    status, _, content = ask(page, path, body, **headers)
    assert (status, content) == (403, b"refused: not from this page")


@pytest.mark.parametrize("secret", ["wslink-secret", "", "..", "x" * 32])
def test_without_the_secret_nothing_is_answered(secret: str, page: lf.Studio) -> None:
    assert ask(page, "spec", secret=secret)[0] in (403, 404)
    assert len(urlsplit(page.address).path.strip("/")) >= 32


def test_the_secret_is_another_one_each_time_and_the_door_is_this_machine(tmp_path: Path, page: lf.Studio) -> None:
    host = urlsplit(page.address).hostname
    assert host == "127.0.0.1"
    other = lf.studio(tmp_path / "other", browser=False)
    assert urlsplit(other.address).path != urlsplit(page.address).path
    other.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection((host, urlsplit(other.address).port), timeout=2)


def test_a_change_by_form_has_its_line_and_the_text_keeps_its_comments(page: lf.Studio) -> None:
    text = "# my lens\n" + small_spec().to_toml()
    ask(page, "spec", {"text": text})
    answer = json.loads(ask(page, "spec", {"place": ["constraints", "max_radius_mm"], "value": {"toml": "-1"}})[2])
    assert answer["lines"] == [
        ["constraints.max_radius_mm", "constraints.max_radius_mm = -1: must be at least 0.000001"]
    ]
    answer = json.loads(ask(page, "spec", {"place": ["constraints", "max_radius"], "value": {"toml": "7"}})[2])
    assert ["constraints.max_radius", "did you mean max_radius_mm?"] in [
        [name, line.rpartition("; ")[2]] for name, line in answer["lines"]
    ]
    assert answer["text"].startswith("# my lens\n")
    assert json.loads(ask(page, "spec", {"text": text})[2])["lines"] == []
    status, _, lines = ask(page, "spec", {"place": ["name", "x"], "value": 3})
    assert status == 422 and json.loads(lines)["lines"][0].startswith("name.x: cannot be changed")


@pytest.mark.parametrize("name", ["../outside.csv", "..%2Foutside.csv", "/etc/passwd.png", ".hidden.png", "a/../b.csv"])
def test_a_file_that_is_dropped_in_stays_in_its_folder(name: str, page: lf.Studio, tmp_path: Path) -> None:
    before = sorted(path for path in page.folder.parent.rglob("*") if page.folder not in path.parents)
    ask(page, f"dropped/{name}", b"x_mm,y_mm\n")
    assert sorted(path for path in page.folder.parent.rglob("*") if page.folder not in path.parents) == before
    kept = {path.parent for path in page.folder.rglob("*") if path.suffix in (".csv", ".png")}
    assert kept <= {page.folder.resolve() / "dropped"}


def test_a_ray_file_is_drawn_and_becomes_the_source(page: lf.Studio) -> None:
    rays = "x_mm,y_mm,z_mm,kx,ky,kz,flux_w\n" + "".join(
        f"0,0,0,0,{k / 100},{(1 - k * k / 1e4) ** 0.5},1\n" for k in range(90)
    )
    answer = json.loads(ask(page, "dropped/led.csv", rays.encode())[2])
    assert answer["fits"] == ["source"] and "90" in answer["words"]
    assert ask(page, f"dropped/{answer['plot']}")[2].startswith(b"\x89PNG")
    made = json.loads(ask(page, "spec", {"use": answer["name"], "as": "source"})[2])
    assert made["tables"]["source"]["kind"] == "rayfile" and "sources" not in made["tables"]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("led.csv", b"x_mm,y_mm\n"),
        ("led.png", b"\x89PNG no"),
        ("led.ies", b"IESNA"),
        ("led.xyz", b"?"),
        ("led.ldt", b""),
    ],
)
def test_a_refused_file_leaves_nothing_and_the_one_before_stays(
    name: str, content: bytes, new_studio: lf.Studio
) -> None:
    folder = new_studio.folder
    status, _, lines = ask(new_studio, f"dropped/{name}", content)
    assert status == 422 and len(json.loads(lines)["lines"]) == 1
    assert not folder.exists(), "nor the folders that were made for it"
    kept = folder / "dropped" / name
    kept.parent.mkdir(parents=True)
    try:
        kept.write_bytes(b"before")
        assert ask(new_studio, f"dropped/{name}", content)[0] == 422
        assert [(path.name, path.read_bytes()) for path in kept.parent.iterdir()] == [(name, b"before")]
        status, _, lines = ask(new_studio, "spec", {"use": name, "as": "source"})
        assert (status, json.loads(lines)["lines"]) == (422, [f"{name}: no such file has been dropped in"])
    finally:
        shutil.rmtree(folder)


def test_a_file_is_used_as_what_it_is(page: lf.Studio) -> None:
    from PIL import Image

    picture = io.BytesIO()
    Image.new("L", (8, 4), 200).save(picture, "PNG")
    answer = json.loads(ask(page, "dropped/logo.png", picture.getvalue())[2])
    assert (answer["words"], answer["fits"]) == ("logo.png: 8 × 4 pixels", ["target"])
    status, _, lines = ask(page, "spec", {"use": "logo.png", "as": "source"})
    assert (status, json.loads(lines)["lines"]) == (422, ["logo.png: no source; use it as target"])
    made = json.loads(ask(page, "spec", {"use": "logo.png", "as": "target"})[2])
    assert made["tables"]["target"]["kind"] == "image"


@pytest.mark.parametrize(
    ("before", "width_mm", "distance_mm"),
    [
        ({}, 200.0, 300.0),
        ({"kind": "rectangle", "width_mm": 80.0, "distance_mm": 150.0, "height_mm": 40.0}, 80.0, 150.0),
    ],
)
def test_a_picture_is_as_wide_and_as_far_as_the_target_in_whose_place_it_comes(
    before: dict[str, object], width_mm: float, distance_mm: float, tmp_path: Path
) -> None:
    file = tmp_path / "logo.png"
    table = DroppedFile(file, file, "", ("target",)).table("target", before)
    assert table == {"kind": "image", "file": str(file), "width_mm": width_mm, "distance_mm": distance_mm}


def test_numbers_that_a_browser_does_not_read_are_text_in_lists_and_tuples_and_tables_alike() -> None:
    inner = (math.nan, [math.inf, {"deep": (-math.inf, 2**53)}], 2**53 - 1, True, None)
    wanted = ["nan", ["inf", {"deep": ["-inf", str(2**53)]}], 2**53 - 1, True, None]
    assert json.loads(json_text({"all": inner, 3: [inner]})) == {"all": wanted, "3": [wanted]}


NUMBERS = {"nan": "nan", "inf": "inf", "-inf": "-inf", "1e999": "inf", "0x" + "f" * 5000: "0x" + "f" * 5000}


@pytest.mark.parametrize("number", [*NUMBERS, "9007199254740993"])
@pytest.mark.parametrize("path", ["spec", "events"])
def test_every_answer_is_json_of_a_browser(number: str, path: str, page: lf.Studio) -> None:
    def refused(constant: str) -> None:
        raise AssertionError(constant)

    text = small_spec().to_toml().replace("side_mm = 1.0", f"side_mm = {number}")
    status, _, content = ask(page, "spec", {"text": text})
    shown = json.loads(content, parse_constant=refused)
    assert status == 200 and shown["tables"]["source"]["side_mm"] == NUMBERS.get(number, number)
    [[field, line]] = shown["lines"]
    assert field == "source.side_mm" and line.isprintable()
    again = json.loads(ask(page, "spec")[2], parse_constant=refused)
    assert again["lines"] == shown["lines"], "after a reload, too"
    assert json.loads(ask(page, "spec", {"text": small_spec().to_toml()})[2])["lines"] == []


@pytest.mark.parametrize(
    "body",
    [
        b"", b"{", b"[]", b"null", b"3", b'"text"', b"\xff\xfe", b'{"text": NaN}', b"[" * 100_000, b'{"text": 3}',
        b'{"text": "\\ud800"}', b"{}", b'{"place": "source", "value": 1}', b'{"place": [], "value": 1}',
        b'{"place": ["source"]}', b'{"place": [1.5], "value": 1}', b'{"place": [true], "value": 1}', b'{"example": []}',
        b'{"use": "led.csv", "as": "lens"}', b'{"use": "led.csv"}', b'{"text": "", "more": 1}', b'{"a": 1, "a": ' ,
    ],
)  # fmt: skip
def test_what_is_no_request_is_one_line(body: bytes, page: lf.Studio) -> None:
    before = ask(page, "spec")[2]
    status, _, content = ask(page, "spec", body)
    [line] = json.loads(content)["lines"]
    assert status == 400 and line.startswith("request") and line.isprintable() and len(line) < 400
    assert ask(page, "spec")[2] == before


def test_what_there_is_not_to_do_is_not_done(page: lf.Studio) -> None:
    for what, body, status in (
        ("dance", {}, 404), ("finer", {}, 400), ("finer", {"rings": 0}, 400), ("finer", {"rings": True}, 400),
        ("finer", {"rings": 80}, 422), ("part", {}, 422), ("pause", {}, 422), ("figure", {"name": "weight"}, 422),
        ("figure", {}, 400), ("beside", {"name": "../.."}, 422), ("search", {"accuracy": "best"}, 422),
        ("search", {"seed": 2**40}, 422), ("search", {"anew": 1}, 400), ("search", {"speed": 1}, 400),
    ):  # fmt: skip
        code, _, content = ask(page, f"do/{what}", body)
        assert code == status, (what, body, content)
        assert status == 404 or len(json.loads(content)["lines"]) == 1


def half_open(page: lf.Studio, sent: bytes) -> socket.socket:
    opened = socket.create_connection(("127.0.0.1", urlsplit(page.address).port or 0), timeout=20)
    opened.sendall(sent)
    return opened


def test_connections_without_the_secret_make_room_for_the_page(page: lf.Studio) -> None:
    kept = [half_open(page, b"GET / HTTP/1.1\r\nHost:") for _ in range(MOST_STRANGERS + 20)]
    assert ask(page, "spec")[0] == 200
    ended = 0
    for connection in kept:
        connection.settimeout(0.05)
        with contextlib.suppress(TimeoutError):
            ended += not connection.recv(1)
    assert 20 <= ended <= 22, "the oldest of them, and no other"
    for connection in kept:
        connection.close()


def test_half_of_a_request_has_a_time(page: lf.Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lensforge.addons.studio.connections.STRANGER_S", 0.5)
    monkeypatch.setattr("lensforge.addons.studio.server._BODY_S", 0.5)
    for sent in (b"", b"GET /", b"POST /x/spec HTTP/1.1\r\nContent-Length: 9\r\n"):
        assert half_open(page, sent).recv(1) == b"", "closed without a word"
    place = urlsplit(page.address)
    head = f"POST {place.path}spec HTTP/1.1\r\nHost: {place.netloc}\r\nContent-Length: 9\r\n\r\n".encode()
    assert half_open(page, head + b'{"te').recv(4096).startswith(b"HTTP/1.1 408 ")
    with half_open(page, head.replace(b"/spec", b"/dropped/a.csv") + b"x_mm,") as slow:
        assert slow.recv(4096).startswith(b"HTTP/1.1 408 ")
    assert not list((page.folder / "dropped").glob(".*")), "nothing is left of it"


def test_a_page_that_is_open_stays_longer_than_a_stranger(page: lf.Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lensforge.addons.studio.connections.STRANGER_S", 0.3)
    place = urlsplit(page.address)
    with half_open(page, f"GET {place.path}events HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode()) as stream:
        assert b"200 OK" in stream.recv(2**20)
        time.sleep(0.6)
        ask(page, "spec", {"text": small_spec().to_toml()})
        assert b"data: " in stream.recv(2**20)


def test_the_secret_stands_in_no_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = list[str]()
    monkeypatch.setattr("webbrowser.open", lambda address: bool(given.append(address)) or True)
    opened = lf.studio(tmp_path / "lens")
    secret = urlsplit(opened.address).path.strip("/")
    door = Path(urlsplit(given[0]).path)
    try:
        assert opened.shown and secret not in given[0] and len(secret) >= 32
        assert (door.stat().st_mode & 0o777, door.parent.stat().st_mode & 0o777) == (0o600, 0o700)
        assert f'content="0; url={opened.address}"' in door.read_text()
    finally:
        opened.close()
    assert not door.parent.exists()


@pytest.mark.parametrize("name", ["../studio.toml", "..%2Fsecret", "studio.toml", ".lensforge-lock", "nothing.step"])
def test_only_files_of_the_folder_are_given(name: str, page: lf.Studio) -> None:
    (page.folder.parent / "secret").write_text("x")
    assert ask(page, f"file/{name}")[0] in (403, 404)


def test_a_port_and_a_folder_in_use_are_one_line(page: lf.Studio, tmp_path: Path) -> None:
    port = urlsplit(page.address).port
    with pytest.raises(lf.InputError, match=rf"^port {port}: in use by another program; give another"):
        lf.studio(tmp_path / "a", port=port or 0, browser=False)
    with locked(tmp_path / "b", create=True), pytest.raises(lf.InputError, match="in use by another thread"):
        lf.studio(tmp_path / "b", browser=False)
    with pytest.raises(lf.InputError, match=r"none\.toml: no such file"):
        lf.studio(tmp_path / "none.toml", browser=False)
    with pytest.raises(lf.InputError, match=r"^port = 'x': a whole number"):
        lf.studio(tmp_path / "a", port="x", browser=False)  # type: ignore[arg-type]
