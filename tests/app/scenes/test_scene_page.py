"""The page of every ready-made scene: well-formed, complete, the same every time, and nothing is loaded."""

import json
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from skyproof.app.scenes.pages import plot, write_pages
from skyproof.app.scenes.scene_page import write_scene_page
from skyproof.cli import main
from skyproof.simulator import scenes
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.scenario import Scenario, ScenePlace, parse_scenario

NAMES = list(scenes.load_ready_made())


class Reader(HTMLParser):
    """Collects headings and text, and checks that every tag is closed where it should be."""

    EMPTY = frozenset({"meta", "br", "path", "line", "circle", "rect"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.labels: list[str] = []
        self.text = ""
        self.feed(page)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.labels += [value or "" for name, value in attrs if name == "aria-label"]
        if tag not in self.EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.EMPTY:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text += f"{data}\n"


def make_page(scenario: Scenario) -> str:
    return write_scene_page(scenario, make_navigation(scenario))


def make_simple(**changes: object) -> Scenario:
    return parse_scenario(
        {
            "start_gpst": "2024-05-14T10:00:00",
            "duration_s": 10.0,
            "receivers": [{"name": "rx", "lat_deg": 57.7, "lon_deg": 11.9, "height_m": 50.0}],
        }
        | changes
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_page_of_a_ready_made_scene_is_whole(name: str) -> None:
    scenario = scenes.read_ready_made(name)
    html = make_page(scenario)
    read = Reader(html)
    for receiver in scenario.receivers:
        assert any(receiver.name in label for label in read.labels)
        assert f"Signals of {receiver.name}" in read.text
        assert f"Receiver {receiver.name}" in read.text
    for attack in scenario.attack_names:
        assert f"Attack {attack}" in read.text
        assert re.search(rf"^{re.escape(attack)} (rebroadcasts|sends|lays)", read.text, re.MULTILINE)
    assert scenario.description in read.text
    assert not re.search(r' (?:d|x|y|x1|y1|x2|y2|cx|cy|r)="[^"]*(?:nan|inf)', html)
    assert str(Path.home()) not in html
    assert not re.search(r"https?:|url\(|@import|<script|<link|<img", html)
    assert len(html) < 600_000


def test_the_same_scene_gives_the_same_bytes() -> None:
    assert make_page(scenes.make_demo()) == make_page(scenes.make_demo())


def test_words_of_the_scenario_are_escaped() -> None:
    html = make_page(make_simple(description="<script>alert(1)</script> & more"))
    assert "<script>" not in html
    assert "&lt;script&gt;alert(1)&lt;/script&gt; &amp; more" in html


def test_a_clean_scene_says_that_nobody_else_transmits() -> None:
    page = make_page(
        scenes.make_clean(ScenePlace(lat_deg=57.7, lon_deg=11.9, height_m=50.0), np.datetime64("2024-05-14T10:00:00"))
    )
    assert "Only the satellites transmit" in page
    assert "False codes" not in page


def test_settings_show_their_units_and_unused_ones_do_not_show() -> None:
    text = Reader(make_page(scenes.make_demo())).text
    for name, value, unit in (
        ("rate_hz", "2600000", "Hz"),
        ("onset_s", "14", "s"),
        ("noise_db", "-5", "dB"),
        ("zenith_cn0_dbhz", "50", "dB-Hz"),
        ("delay_s", "4e-06", "s"),
    ):
        assert re.search(rf"^{name}\n{re.escape(value)} ?\n{re.escape(unit)}$", text, re.MULTILINE), name
    assert "roll_deg" not in text


def test_false_codes_of_a_clock_push_are_its_metres() -> None:
    # 1 microsecond is 299.8 m, whatever the geometry: the axis reaches there, and no farther than a little beyond.
    scenario = make_simple(
        attacks=[
            {
                "kind": "takeover",
                "target": "rx",
                "onset_s": 2.0,
                "clock_points_s": [[3.0, 0.0], [8.0, 1e-6]],
                "transmit": {"lat_deg": 57.701, "lon_deg": 11.9, "height_m": 60.0},
            }
        ]
    )
    html = make_page(scenario)
    picture = html[html.index("Code of false signals") :]
    picture = picture[: picture.index("</svg>")]
    ticks = [float(value) for value in re.findall(r'text-anchor="end">(\d+)<', picture)]
    assert max(ticks) == 300 or max(ticks) == 250
    assert "true code, m" in picture


def test_only_a_moving_takeovers_displacement_is_drawn() -> None:
    attack = {
        "kind": "takeover",
        "target": "rx",
        "onset_s": 2.0,
        "transmit": {"lat_deg": 57.701, "lon_deg": 11.9, "height_m": 60.0},
    }
    assert "shows to" not in make_page(make_simple(attacks=[attack]))
    moved = attack | {"away_points_enu_m": [[3.0, 0.0, 0.0, 0.0], [9.0, 50.0, 0.0, 0.0]]}
    assert "shows to" in make_page(make_simple(attacks=[moved]))


def test_reflections_are_drawn_with_their_longer_way() -> None:
    receiver = {
        "name": "rx",
        "lat_deg": 57.7,
        "lon_deg": 11.9,
        "height_m": 50.0,
        "multipath": [{"delay_m": 40.0, "power_db": -6.0}],
    }
    html = make_page(make_simple(receivers=[receiver]))
    assert "Reflections at" in html
    assert "way, m" in html
    assert ">40<" in html[html.index("Longer way") :]
    assert "Reflections at" not in make_page(make_simple())


def test_one_page_is_written_under_the_scenes_name(tmp_path: Path) -> None:
    path = plot("spin", folder=tmp_path, duration_s=5.0)
    assert path == tmp_path / "spin.html"
    assert "5 s, 1 receiver" in path.read_text(encoding="utf-8")


@pytest.mark.long
def test_all_pages_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    two = {name: scenes.load_ready_made()[name] for name in ("clean", "spin")}
    monkeypatch.setattr(scenes, "load_ready_made", lambda: two)
    written = write_pages(tmp_path / "pages")
    assert [path.name for path in written] == ["clean.html", "spin.html", "errors.html"]
    Reader((tmp_path / "pages" / "errors.html").read_text(encoding="utf-8"))


def test_the_command_draws_the_page_alone_or_beside_the_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "spin", "--plot", "--duration-s", "4"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["spin.html"]
    assert "spin.html" in capsys.readouterr().out
    options = ["--duration-s", "4", "--depth", "measurements", "--out", "data"]
    assert main(["simulate", "spin", "--plot", *options]) == 0
    assert (tmp_path / "data" / "scene.html").read_bytes() == (tmp_path / "spin.html").read_bytes()
    assert "scene.html" in json.loads((tmp_path / "data" / "truth.json").read_text(encoding="utf-8"))["files"]
    assert main(["simulate", "spin", *options, "--overwrite"]) == 0
    assert not (tmp_path / "data" / "scene.html").exists()  # of the run before


def test_every_ready_made_scene_states_its_source() -> None:
    for made in scenes.load_ready_made().values():
        assert tomllib.loads(made.path.read_text(encoding="utf-8"))["source"]
