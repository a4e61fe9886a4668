"""The pictures of a scene: what stands where, in which shape, with which name and unit."""

import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.report.svg import list_texts, parse, select_class

from skyproof.report.drawing import Tag, place_tags
from skyproof.report.pictures import SignalSeries, SkyPosition, SkySource
from skyproof.report.scene import (
    Element,
    GroundTrack,
    PlotLine,
    ScenePage,
    SceneSky,
    Setting,
    SettingGroup,
    Switching,
    draw_scene_map,
    plot_array,
    plot_lines,
    plot_switching,
    write_scene_html,
)
from skyproof.report.stability import AllanCurve, plot_allan


def list_corners(path: ElementTree.Element) -> np.ndarray[Any, Any]:
    return np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", path.get("d", "")), dtype=float)


def read_number(element: ElementTree.Element, name: str) -> float:
    return float(element.get(name, "nan"))


def find_way(name: str, role: Any, *points: tuple[float, float]) -> GroundTrack:
    return GroundTrack(
        name=name, role=role, east_m=np.array([e for e, _ in points]), north_m=np.array([n for _, n in points])
    )


def find_line(name: str, *values: float, kind: Any = "spoofed") -> PlotLine:
    return PlotLine(name=name, kind=kind, seconds=np.arange(float(len(values))), values=np.array(values))


# Labels


@given(st.lists(st.tuples(st.floats(20, 340), st.floats(20, 280)), min_size=1, max_size=12))
def test_labels_of_a_dozen_marks_keep_out_of_each_other(places: list[tuple[float, float]]) -> None:
    tags = [Tag(x, y, f"G{index:02}") for index, (x, y) in enumerate(places)]
    parts = [ElementTree.fromstring(part) for part in place_tags(tags, (), (2.0, 2.0, 358.0, 298.0))]
    words = [part for part in parts if part.tag == "text"]
    assert [part.text for part in words] == [tag.words for tag in tags]
    centres = np.array([(read_number(part, "x"), read_number(part, "y")) for part in words])
    for index, (x, y) in enumerate(centres):
        apart = np.abs(centres[index + 1 :] - (x, y))
        assert ((apart[:, 0] > 19.0) | (apart[:, 1] > 11.0)).all()


def test_a_label_that_finds_no_room_is_led_back_to_its_mark() -> None:
    crowd = [Tag(100.0, 100.0, f"receiver {index}", "name") for index in range(14)]
    parts = [ElementTree.fromstring(part) for part in place_tags(crowd, (), (2.0, 2.0, 358.0, 298.0))]
    leaders = [part for part in parts if part.get("class") == "leader"]
    assert leaders
    assert {(read_number(part, "x1"), read_number(part, "y1")) for part in leaders} == {(100.0, 100.0)}


# The map


def test_the_map_has_equal_scales_and_a_shape_for_each_role() -> None:
    root = parse(
        draw_scene_map(
            [
                find_way("rx", "receiver", (0, 0)),
                find_way("m", "transmits", (300, 400)),
                find_way("m", "receives", (-200, 100)),
                find_way("s", "shows", (0, -300)),
                find_way("jam", "disturbs", (-300, -300)),
            ],
            title="map",
        )
    )
    (receiver,) = select_class(root, "mark", "receiver")
    (transmits,) = select_class(root, "mark", "transmits")
    x, y = list_corners(transmits)[0]
    assert (x - read_number(receiver, "cx")) / (read_number(receiver, "cy") - y) == pytest.approx(300 / 400, rel=1e-2)
    shapes = {re.sub(r"[-\d. ]+", "", e.get("d", e.tag)) for e in select_class(root, "mark")}
    assert len(shapes - {"circle"}) >= 3
    assert {"rx", "m transmits", "m receives", "s shows", "jam", "east, m", "north, m"} <= set(list_texts(root))


def test_a_moving_bodys_way_is_drawn_from_ring_to_mark() -> None:
    root = parse(
        draw_scene_map(
            [find_way("car", "receiver", (0, 0), (100, 0), (100, 200)), find_way("x", "shows", (0, 200))], title="map"
        )
    )
    (start,) = select_class(root, "start", "receiver")
    (mark,) = select_class(root, "mark", "receiver")
    track = list_corners(select_class(root, "way", "receiver")[0])
    assert len(track) == 3
    np.testing.assert_allclose(track[0], (read_number(start, "cx"), read_number(start, "cy")), atol=0.1)
    np.testing.assert_allclose(track[-1], (read_number(mark, "cx"), read_number(mark, "cy")), atol=0.1)


def test_long_ways_are_drawn_in_kilometres() -> None:
    root = parse(draw_scene_map([find_way("a", "receiver", (0, 0), (30_000, 10_000))], title="map"))
    assert "east, km" in list_texts(root)
    assert "20" in list_texts(root)


def test_receivers_at_one_place_share_a_label() -> None:
    some = parse(
        draw_scene_map(
            [find_way(f"rx{i}", "receiver", (0.1 * i, 0)) for i in range(3)] + [find_way("far", "receiver", (900, 0))],
            title="map",
        )
    )
    assert "rx0, rx1, rx2" in list_texts(some)
    many = parse(
        draw_scene_map(
            [find_way(f"receiver{i}", "receiver", (0.1 * i, 0)) for i in range(8)]
            + [find_way("far", "receiver", (900, 0))],
            title="map",
        )
    )
    assert "8 receivers" in list_texts(many)


# Antennas


def test_antennas_stand_forward_up_and_right_to_the_right() -> None:
    elements = [
        Element(name="A", forward_m=0.0, right_m=0.0),
        Element(name="B", forward_m=0.2, right_m=0.0),
        Element(name="C", forward_m=0.0, right_m=0.2, down_m=-0.03),
    ]
    root = parse(plot_array(elements, title="array"))
    a, b, c = ((read_number(e, "cx"), read_number(e, "cy")) for e in select_class(root, "mark", "receiver"))
    assert b[0] == a[0]
    assert c[1] == a[1]
    assert a[1] - b[1] == pytest.approx(c[0] - a[0])
    assert {"forward, cm", "right, cm", "C (3 cm up)"} <= set(list_texts(root))


def test_an_arm_is_drawn_where_it_begins_on_its_circle() -> None:
    root = parse(
        plot_array([Element(name="tip", forward_m=0.0, right_m=0.0, radius_m=0.5, start_deg=90.0)], title="arm")
    )
    (mark,), (circle,) = select_class(root, "mark", "receiver"), select_class(root, "way", "receiver")
    assert read_number(mark, "cx") - read_number(circle, "cx") == pytest.approx(read_number(circle, "r"), abs=0.2)
    assert read_number(mark, "cy") == pytest.approx(read_number(circle, "cy"), abs=0.2)


# Over time


def test_a_line_breaks_at_missing_data_and_is_named_at_its_end() -> None:
    root = parse(
        plot_lines(
            [find_line("G05", 100.0, 110.0, np.nan, 130.0, 140.0)],
            title="t",
            zero="start",
            quantity="behind",
            metres=True,
        )
    )
    (drawn,) = select_class(root, "series", "spoofed")
    assert drawn.get("d", "").count("M") == 2
    assert {"G05", "behind, m", "time since start, s"} <= set(list_texts(root))


def test_names_at_the_ends_of_lines_do_not_overlap() -> None:
    lines = [find_line(f"G{i:02}", 0.0, 1.0 + 1e-3 * i) for i in range(15)]
    root = parse(plot_lines(lines, title="t", zero="z", quantity="q"))
    heights = sorted(read_number(e, "y") for e in select_class(root, "name"))
    assert len(heights) == 15
    assert min(np.diff(heights)) >= 11.5


def test_far_offsets_are_drawn_in_kilometres() -> None:
    root = parse(plot_lines([find_line("G05", 3e4, 5e4)], title="t", zero="z", quantity="q", metres=True))
    assert "q, km" in list_texts(root)
    assert "40" in list_texts(root)


def test_a_transmitter_is_filled_while_it_is_on_only() -> None:
    power_db = np.full(101, 3.0)
    power_db[:20] = power_db[60:] = np.nan
    root = parse(
        plot_switching(
            [Switching(name="spoofer", what="over", role="transmits", seconds=np.arange(101.0), power_db=power_db)],
            (0.0, 100.0),
            title="t",
            zero="z",
        )
    )
    (filled,) = select_class(root, "on", "transmits")
    x = list_corners(filled)[:, 0]
    span = 348.0 - 12.0
    assert (x.min() - 12.0) / span == pytest.approx(0.2, abs=0.01)
    assert (x.max() - 12.0) / span == pytest.approx(0.59, abs=0.01)
    assert {"spoofer", "over, +3 dB"} <= set(list_texts(root))


def test_the_stronger_the_higher() -> None:
    power_db = np.linspace(-5.0, 0.8, 11)
    row = Switching(name="jam", what="n", role="disturbs", seconds=np.arange(11.0), power_db=power_db)
    root = parse(plot_switching([row], (0.0, 10.0), title="t", zero="z"))
    y = list_corners(select_class(root, "on")[0])[1:12, 1]
    assert (np.diff(y) < 0.0).all()
    assert "n, \N{MINUS SIGN}5 to +0.8 dB" in list_texts(root)


def test_allan_deviations_stand_on_their_theory() -> None:
    tau_s = np.array([0.1, 1.0, 10.0])
    theory = 1e-3 / np.sqrt(tau_s)
    root = parse(
        plot_allan(
            [
                AllanCurve(
                    name="grade", tau_s=tau_s, deviation=theory, lower=0.9 * theory, upper=1.1 * theory, theory=theory
                )
            ],
            title="t",
            unit="m/s²",
        )
    )
    points = np.array([(read_number(e, "cx"), read_number(e, "cy")) for e in select_class(root, "point")])
    np.testing.assert_allclose(list_corners(select_class(root, "theory")[0]), points, atol=0.11)
    assert len(select_class(root, "limits")) == 3
    assert {"averaging time, s", "Allan deviation, m/s²", "grade", "10⁻³"} <= set(list_texts(root))


# The page


def make_page(**changes: Any) -> ScenePage:
    seconds = np.arange(10.0)
    filled: dict[str, Any] = {
        "name": "<scene>",
        "description": "A & B <i>",
        "facts": ("<fact>",),
        "events": ("<event>",),
        "zero": "z",
        "origin": "<origin>",
        "ways": (find_way("<rx>", "receiver", (0, 0)), find_way("<bad>", "transmits", (50, 9))),
        "arrays": (("<rx>", (Element(name="<A>", forward_m=0.1, right_m=0.0),)),),
        "displacements": (("<shown>", (find_line("<east>", *range(10)),)),),
        "skies": (
            SceneSky(
                receiver="<rx>",
                positions=(
                    SkyPosition(
                        receiver="<rx>", signal="G05 L1 CA a", label="authentic", azimuth_deg=10, elevation_deg=50
                    ),
                ),
                sources=(SkySource(name="<bad>", azimuth_deg=90, elevation_deg=-2),),
                axes=(SkySource(name="<forward>", azimuth_deg=0, elevation_deg=0),),
            ),
        ),
        "levels": (
            SignalSeries(
                receiver="<rx>", signal="G05 L1 CA a", label="authentic", seconds=seconds, cn0_dbhz=np.full(10, 45.0)
            ),
        ),
        "offsets": (("<rx>", (find_line("<G05>", *range(10)),)),),
        "disturbance": (("<rx>", (find_line("<noise>", *range(10)),)),),
        "switching": (Switching(name="<bad>", what="<what>", role="transmits", seconds=seconds, power_db=seconds),),
        "span_s": (0.0, 9.0),
        "settings": (SettingGroup("<group>", (Setting("<key>", "<value>", "<unit>"),)),),
        "made_by": "<made>",
    }
    return ScenePage(**filled | changes)


def test_everything_on_the_page_is_escaped() -> None:
    html = write_scene_html(make_page())
    for words in (
        "scene",
        "fact",
        "event",
        "origin",
        "rx",
        "bad",
        "A",
        "shown",
        "east",
        "forward",
        "G05",
        "noise",
        "what",
        "group",
        "key",
        "value",
        "unit",
        "made",
    ):
        assert f"<{words}>" not in html
        assert f"&lt;{words}&gt;" in html, words
    assert "A &amp; B &lt;i&gt;" in html


def test_a_scene_without_attacks_has_a_page() -> None:
    nothing = dict.fromkeys(("skies", "offsets", "disturbance", "switching", "displacements", "arrays", "settings"), ())
    html = write_scene_html(make_page(**nothing))
    assert "on when" not in html
    assert "Signals of" in html


def test_what_is_small_on_the_map_is_drawn_closer() -> None:
    far = (find_way("a", "receiver", (0, 0)), find_way("b", "receiver", (20, 0)), find_way("m", "transmits", (900, 0)))
    assert "Close up" in write_scene_html(make_page(ways=far))
    near = (find_way("a", "receiver", (0, 0)), find_way("b", "receiver", (20, 0)), find_way("m", "transmits", (30, 0)))
    assert "Close up" not in write_scene_html(make_page(ways=near))
