"""The drawings of what the verdict rests on, and the words for it."""

import math
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from tests.report.svg import list_texts, parse, select_class

from skyproof.report import methods
from skyproof.report.pictures import DelayProfile, DelayTag, RangeDifference
from skyproof.report.proof import draw_chance_scale, plot_differences, plot_profiles
from skyproof.report.words import distance_words, offset_words, place_words


def find_place(symbol: ElementTree.Element) -> tuple[float, float]:
    """Find where a symbol stands: a disc has a centre, the others begin there and move on."""
    if symbol.tag == "circle":
        return float(symbol.get("cx", "nan")), float(symbol.get("cy", "nan"))
    (x, y), *_ = re.findall(r"M(-?[\d.]+) (-?[\d.]+)", symbol.get("d", ""))
    return float(x), float(y)


# Correlation


def make_profile(sat: str, *tags: tuple[Any, float], height: float = 20.0) -> DelayProfile:
    delays = np.linspace(-3.0, 9.0, 121)
    power = 1.0 + height * sum(np.maximum(1.0 - np.abs(delays - delay), 0.0) ** 2 for _, delay in tags)
    return DelayProfile(
        receiver="rx1",
        sat=sat,
        at_s=10.0,
        delays_chips=delays,
        power=power,
        tags=tuple(DelayTag(label=label, delay_chips=delay) for label, delay in tags),
    )


def test_every_signal_is_marked_above_its_peak_with_its_label() -> None:
    root = parse(plot_profiles([make_profile("G05", ("authentic", 0.0), ("spoofed", 6.0))], title="correlation"))
    (curve,) = select_class(root, "curve")
    points = np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", curve.get("d", "")), float)
    for label, delay in (("authentic", 0.0), ("spoofed", 6.0)):
        (mark,) = select_class(root, "symbol", label)
        x, y = find_place(mark)
        assert x == pytest.approx(np.interp(delay, np.linspace(-3.0, 9.0, 121), points[:, 0]), abs=0.2)
        assert 0.0 < np.interp(x, points[:, 0], points[:, 1]) - y < 12.0
    assert {"G05", "delay, chips (1 chip = 293 m)", "power, noise = 1"} <= set(list_texts(root))


def test_all_panels_have_one_scale() -> None:
    strong, weak = (
        make_profile("G05", ("authentic", 0.0), height=40.0),
        make_profile("G07", ("authentic", 0.0), height=10.0),
    )
    curves = select_class(parse(plot_profiles([strong, weak], title="c")), "curve")
    tall = [np.ptp([float(y) for _, y in re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", c.get("d", ""))]) for c in curves]
    assert tall[0] / tall[1] == pytest.approx(4.0, rel=0.05)


# Range differences


def make_difference(sat: str, label: Any, metres: float) -> RangeDifference:
    return RangeDifference(receivers=("rx1", "rx2"), sat=sat, label=label, metres=metres)


def test_false_signals_stand_in_one_line_true_ones_do_not() -> None:
    metres = {"G01": -40.0, "G02": 10.0, "G03": 30.0}
    rows = [make_difference(sat, "authentic", m) for sat, m in metres.items()]
    rows += [make_difference(sat, "spoofed", 0.0) for sat in metres]
    root = parse(plot_differences(rows, title="differences"))
    false = [find_place(mark)[0] for mark in select_class(root, "symbol", "spoofed")]
    true = [find_place(mark)[0] for mark in select_class(root, "symbol", "authentic")]
    assert np.ptp(false) == 0.0
    np.testing.assert_allclose(np.diff(true) / np.sum(np.diff(true)), [50.0 / 70.0, 20.0 / 70.0], atol=0.01)
    assert any("rx2" in text and "rx1" in text and text.endswith(", m") for text in list_texts(root))
    assert {"G01", "G02", "G03"} <= set(list_texts(root))


# Chance


@pytest.mark.parametrize(("p_value", "side"), [(1e-3, -1), (1e-7, 0), (1e-9, 1), (0.0, 1), (1.0, -1)])
def test_a_p_value_stands_on_its_side_of_what_was_allowed(p_value: float, side: int) -> None:
    root = parse(draw_chance_scale(p_value, 1e-7, title="chance"))
    (mark,), (limit,) = select_class(root, "mark"), select_class(root, "limit")
    assert np.sign(round(float(mark.get("cx", "nan")) - float(limit.get("x1", "nan")), 3)) == side
    assert 0.0 < float(mark.get("cx", "nan")) < 360.0


def test_without_anything_to_draw_nothing_is_drawn() -> None:
    assert plot_profiles([], title="c") == plot_differences([], title="d") == ""


# Words


def test_places_and_ways_are_worded_as_people_say_them() -> None:
    assert place_words(-59.4121, -16.8837, 4) == "59.4121° S, 16.8837° W"
    assert [distance_words(m) for m in (3.26, 899.4, 12_400.0, 2.5e6)] == ["3.3 m", "899 m", "12.4 km", "2500 km"]
    north_deg = math.degrees(1000.0 / 6_367_382.0)  # WGS-84's radius of curvature along the meridian at 45 degrees
    assert re.fullmatch(r"1000 m .*north", offset_words((45.0, 10.0), (45.0 + north_deg, 10.0)))
    assert offset_words((0.0, 179.9999), (0.0, -179.9999)).endswith(" east")


def test_other_peoples_detectors_keep_their_names() -> None:
    assert methods.title("my_method") == "my method"
    assert methods.about("my_method") == ""
    assert methods.reason("my_method", "spoofed").endswith(" my method")
