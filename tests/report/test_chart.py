"""Charts of rows: what stands where, on which scale, under which name."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from skyproof.report.chart import draw_chart_svg, group_curves, write_value

SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True)
class Axes:
    title: str = "A chart"
    x: str = "window_s"
    y: str = "kept"
    x_label: str = "window, s"
    y_label: str = "kept of 7"
    by: tuple[str, ...] = ("method",)
    where: Mapping[str, Any] = field(default_factory=dict)
    x_log: bool = False
    y_log: bool = False
    scattered: bool = False
    diagonal: bool = False


ROWS = [
    {"method": method, "window_s": float(x), "kept": y, "noise": noise}
    for noise in ("white", "ar1")
    for method, ys in {"paper": (1.0, 2.0, 4.0), "skyproof": (7.0, 7.0, 7.0)}.items()
    for x, y in zip((10, 100, 1000), ys, strict=True)
]


def draw(rows: Any = ROWS, **changes: Any) -> ElementTree.Element:
    svg = draw_chart_svg(rows, [Axes(**changes)])
    assert svg
    return ElementTree.fromstring(svg)


def list_texts(root: ElementTree.Element) -> list[str]:
    return [e.text or "" for e in root.iter(f"{SVG}text")]


def list_lines(root: ElementTree.Element) -> list[Any]:
    """List corners of every curve but the keys of the legend, which lie below the frame."""
    (frame,) = (e for e in root.iter(f"{SVG}rect"))
    bottom = float(frame.get("y", "nan")) + float(frame.get("height", "nan"))
    found = [
        np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", e.get("d", "")), dtype=float)
        for e in root.iter(f"{SVG}path")
        if "curve" in e.get("class", "").split()
    ]
    return [corners for corners in found if corners[:, 1].max() <= bottom]


def find_tick(root: ElementTree.Element, reported: str) -> float:
    return next(float(e.get("x", "nan")) for e in root.iter(f"{SVG}text") if e.text == reported)


def test_a_line_for_each_combination_and_its_name_in_the_legend() -> None:
    root = draw(by=("method", "noise"))
    assert len(list_lines(root)) == 4
    assert {"paper, white", "paper, ar1", "skyproof, white", "skyproof, ar1"} <= set(list_texts(root))
    assert len(list_lines(draw(where={"noise": "white"}))) == 2


def test_title_and_axes_are_named() -> None:
    assert {"A chart", "window, s", "kept of 7"} <= set(list_texts(draw()))


def test_points_stand_at_their_ticks_and_larger_is_higher() -> None:
    root = draw(where={"noise": "white", "method": "paper"})
    (line,) = list_lines(root)
    assert line[0, 1] > line[1, 1] > line[2, 1]
    assert line[2, 0] == pytest.approx(find_tick(root, "1000"), abs=15.0)  # the last tick is moved off the edge
    np.testing.assert_allclose(line[:2, 0], [find_tick(root, "10"), find_tick(root, "100")], atol=0.2)
    assert (line[1, 0] - line[0, 0]) / (line[2, 0] - line[0, 0]) == pytest.approx(90.0 / 990.0, abs=0.002)


def test_few_values_far_apart_are_the_ticks() -> None:
    rows = [{"method": "m", "window_s": x, "kept": 1.0 + x} for x in (2.0, 3.0, 5.0)]
    root = draw(rows)
    (line,) = list_lines(root)
    for reported, corner in zip("235", line, strict=True):
        assert find_tick(root, reported) == pytest.approx(corner[0], abs=0.1)
    assert {"2", "3", "5"} <= set(list_texts(root))
    assert "4" not in {e.text for e in root.iter(f"{SVG}text") if e.get("text-anchor") == "middle"}


def test_a_long_title_is_broken_and_the_chart_moved_down() -> None:
    words = " ".join(["word"] * 16)
    root = draw(title=words)
    reported = [e for e in root.iter(f"{SVG}text") if e.get("class") == "title"]
    assert " ".join(e.text or "" for e in reported) == words
    assert all(len(e.text or "") <= 50 for e in reported)
    short, long = (float(item.get("viewBox", "").split()[3]) for item in (draw(), root))
    assert long - short == pytest.approx(14.0)


def test_long_numbers_keep_clear_of_the_name_of_their_axis() -> None:
    rows = [{"method": "m", "window_s": x, "kept": 0.99991 + 1e-5 * x} for x in (0.0, 1.0, 2.0)]
    root = draw(rows)
    ends = [(float(e.get("x", "nan")), e.text or "") for e in root.iter(f"{SVG}text") if e.get("text-anchor") == "end"]
    assert max(len(reported) for _, reported in ends) >= 7
    assert all(x - 5.6 * len(reported) >= 18.0 for x, reported in ends)


def test_a_logarithmic_axis_puts_decades_at_equal_steps() -> None:
    root = draw(where={"noise": "white", "method": "paper"}, x_log=True)
    (line,) = list_lines(root)
    np.testing.assert_allclose(np.diff(line[:, 0], 2), 0.0, atol=0.2)
    assert find_tick(root, "100") == pytest.approx(line[1, 0], abs=0.1)


def test_what_has_no_logarithm_breaks_the_line() -> None:
    rows = [{"method": "m", "window_s": x, "kept": y} for x, y in enumerate((1e-3, 0.0, 1e-1, 1.0))]
    (curve,), _ = group_curves(rows, Axes(y_log=True))
    np.testing.assert_allclose(curve.y, [-3.0, np.nan, -1.0, 0.0])
    path = next(e.get("d", "") for e in draw(rows, y_log=True).iter(f"{SVG}path"))
    assert path.count("M") == 2


def test_small_powers_are_written_as_powers() -> None:
    rows = [{"method": "m", "window_s": 1.0 + k, "kept": 10.0**-k} for k in range(0, 9)]
    assert "10⁻⁶" in list_texts(draw(rows, y_log=True))


def test_words_on_the_x_axis_are_names_in_order() -> None:
    rows = [{"method": "m", "pair": p, "kept": k} for p, k in (("5 m", 1.0), ("1 m", 3.0), ("2 m", 2.0))]
    root = draw(rows, x="pair")
    places = [find_tick(root, name) for name in ("5 m", "1 m", "2 m")]
    assert places == sorted(places)
    np.testing.assert_allclose(list_lines(root)[0][:2, 0], places[:2], atol=0.1)


def test_none_and_missing_columns_are_left_out() -> None:
    rows = [*ROWS[:3], {"method": "paper", "window_s": 5.0, "kept": None}, {"method": "paper"}]
    (curve,), _ = group_curves(rows, Axes())
    assert curve.x.size == 3


def test_lines_differ_without_colour() -> None:
    rows = [{"method": f"m{k}", "window_s": float(x), "kept": float(k)} for k in range(20) for x in (0, 1)]
    root = draw(rows)
    looks = {
        (e.get("class"), "".join(re.findall(r"[\d.]+(m.*?)(?=M|$)", mark.get("d", ""))[:1]))
        for e, mark in pairwise(root.iter(f"{SVG}path"))
        if "curve" in e.get("class", "") and "point" in mark.get("class", "")
    }
    assert len(looks) == 20


def test_the_legend_stays_clear_of_the_frame_in_the_picture() -> None:
    rows = [{"method": f"a rather long name number {k}", "window_s": 1.0, "kept": float(k)} for k in range(7)]
    root = draw(rows)
    height = float(root.get("viewBox", "").split()[3])
    heights = [float(e.get("y", "nan")) for e in root.iter(f"{SVG}text") if "rather" in (e.text or "")]
    assert len(heights) == 7
    assert max(heights) < height
    assert min(heights) > 280.0


def test_a_scatter_has_marks_only_and_an_even_diagonal() -> None:
    rows = [{"method": "one", "window_s": 10.0 ** (k / 50), "kept": 10.0 ** (1 - k / 50)} for k in range(100)]
    root = draw(rows, x_log=True, y_log=True, scattered=True, diagonal=True)
    assert not [path for path in root.iter(f"{SVG}path") if "curve" in path.get("class", "")]
    marks = [path.get("d", "").count("M") for path in root.iter(f"{SVG}path") if "point" in path.get("class", "")]
    assert marks[0] == 100
    (line,) = (item for item in root.iter(f"{SVG}line") if item.get("class") == "frame")
    x1, y1, x2, y2 = (float(line.get(name, "nan")) for name in ("x1", "y1", "x2", "y2"))
    assert x1 < x2
    assert y1 > y2
    plain = draw(rows, x_log=True, y_log=True)
    assert not [item for item in plain.iter(f"{SVG}line") if item.get("class") == "frame"]


def test_a_diagonal_is_drawn_however_far_the_points_lie() -> None:
    rows = [{"method": "one", "window_s": 100.0 + k, "kept": 0.1 + 0.01 * k} for k in range(9)]
    root = draw(rows, x_log=True, y_log=True, scattered=True, diagonal=True)
    (line,) = (item for item in root.iter(f"{SVG}line") if item.get("class") == "frame")
    (frame,) = (item for item in root.iter(f"{SVG}rect") if item.get("class") == "frame")
    left_px, width = float(frame.get("x", "nan")), float(frame.get("width", "nan"))
    ends = [float(line.get(name, "nan")) for name in ("x1", "x2")]
    assert ends == pytest.approx([left_px, left_px + width], abs=0.2)
    marks = [path.get("d", "").count("M") for path in root.iter(f"{SVG}path") if "point" in path.get("class", "")]
    assert marks == [9, 1]


def test_several_charts_stand_below_each_other() -> None:
    single = draw_chart_svg(ROWS, [Axes()])
    two = ElementTree.fromstring(draw_chart_svg(ROWS, [Axes(), Axes(title="Another")]))
    height = float(ElementTree.fromstring(single).get("viewBox", "").split()[3])
    assert float(two.get("viewBox", "").split()[3]) == pytest.approx(2 * height, abs=1.0)
    assert {"A chart", "Another"} <= set(list_texts(two))


def test_values_are_named_with_their_unit() -> None:
    assert write_value("method", "paper") == "paper"
    assert write_value("distance_m", 20.0) == "distance 20 m"
    assert write_value("rate_m_s", 2) == "rate 2 m/s"
    assert write_value("cn0_dbhz", np.float64(45.0)) == "C/N0 45 dB-Hz"
    assert write_value("rate_hz", 5e6) == "rate 5 MHz"
    assert write_value("prn", 7) == "PRN 7"
    assert write_value("n", 30) == "n 30"
    assert write_value("half_cycles", False).startswith("no ")


def test_names_from_outside_are_escaped() -> None:
    rows = [{"method": "<b>&", "window_s": 1.0, "kept": 1.0}]
    assert "<b>&" in list_texts(draw(rows, title="<i>"))


def test_without_anything_to_draw_nothing_is_drawn() -> None:
    assert draw_chart_svg([], [Axes()]) == ""
    assert draw_chart_svg(ROWS, []) == ""
    assert draw_chart_svg(ROWS, [Axes(where={"noise": "none"})]) == ""


def test_the_same_rows_give_the_same_characters() -> None:
    assert draw_chart_svg(ROWS, [Axes()]) == draw_chart_svg(ROWS, [Axes()])
