"""The server answers its own page alone, and writes in its folder alone."""

import http.client
import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from scenes import small_spec

import lensforge as lf
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
    names = {path.name for path in (Path(lf.__file__).parent / "live" / "page").iterdir()}
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
    found = json.loads(ask(page, "spec", {"place": ["constraints", "max_radius_mm"], "value": {"toml": "-1"}})[2])
    assert found["lines"] == [
        ["constraints.max_radius_mm", "constraints.max_radius_mm = -1: must be at least 0.000001"]
    ]
    found = json.loads(ask(page, "spec", {"place": ["constraints", "max_radius"], "value": {"toml": "7"}})[2])
    assert ["constraints.max_radius", "did you mean max_radius_mm?"] in [
        [name, words.rpartition("; ")[2]] for name, words in found["lines"]
    ]
    assert found["text"].startswith("# my lens\n")
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
    found = json.loads(ask(page, "dropped/led.csv", rays.encode())[2])
    assert found["fits"] == ["source"] and "90" in found["words"]
    assert ask(page, f"dropped/{found['plot']}")[2].startswith(b"\x89PNG")
    made = json.loads(ask(page, "spec", {"use": found["name"], "as": "source"})[2])
    assert made["tables"]["source"]["kind"] == "rayfile" and "sources" not in made["tables"]


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
