"""The drawings: what stands where, with which unit, in whose colour."""

import math
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.report.svg import list_texts, parse, select_class

from skyproof.report.drawing import nice_ticks, spread, thin
from skyproof.report.pictures import (
    FixTrack,
    SignalSeries,
    SkyPosition,
    SkySource,
    TruePlace,
    draw_local_map,
    draw_time_line,
    plot_sky,
)


def list_corners(path: ElementTree.Element) -> np.ndarray[Any, Any]:
    return np.array(re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", path.get("d", "")), dtype=float)


def read_number(element: ElementTree.Element, name: str) -> float:
    return float(element.get(name, "nan"))


# Ticks and thinning


@given(st.floats(-1e9, 1e9), st.floats(1e-3, 1e9))
def test_ticks_are_few_even_and_inside(low: float, span: float) -> None:
    high = low + span
    ticks = np.array(nice_ticks(low, high))
    assert 2 <= len(ticks) <= 6
    step = np.diff(ticks)
    np.testing.assert_allclose(step, step[0], rtol=1e-3)
    assert ticks[0] >= low - 1e-6 * step[0]
    assert ticks[-1] <= high + 1e-6 * step[0]
    assert min(abs(step[0] / 10 ** math.floor(math.log10(step[0]) + 0.01) - nice) for nice in (1, 2, 5)) < 1e-2


def test_ticks_stand_at_round_numbers() -> None:
    assert nice_ticks(0.0, 60.0) == [0.0, 20.0, 40.0, 60.0]
    assert nice_ticks(-7.0, 9.0) == [-5.0, 0.0, 5.0]


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0), (0.0, math.inf), (math.nan, 1.0)])
def test_an_empty_axis_has_no_ticks(low: float, high: float) -> None:
    with pytest.raises(ValueError, match="no ticks"):
        nice_ticks(low, high)


def test_thinning_averages_and_keeps_gaps() -> None:
    seconds = np.arange(1000.0)
    values = np.full(1000, 45.0)
    values[::2] += 2.0
    values[500:700] = np.nan
    s, v = thin(seconds, values, 100)
    assert s.shape == v.shape == (100,)
    np.testing.assert_allclose(v[:50], 46.0)
    assert np.isnan(v[50:70]).all()
    assert np.isfinite(v[70:]).all()
    np.testing.assert_allclose(s[:2], [4.5, 14.5])


@given(st.integers(1, 500), st.integers(1, 50))
def test_thinning_never_leaves_more_than_asked(size: int, limit: int) -> None:
    seconds, values = thin(np.arange(float(size)), np.ones(size), limit)
    assert seconds.size == values.size <= max(limit, 1)
    assert np.isfinite(values).all()


# The map


def track(kind: Any, east_m: float, north_m: float, receiver: str = "rx1", **more: Any) -> FixTrack:
    return FixTrack(receiver=receiver, kind=kind, east_m=np.array([east_m]), north_m=np.array([north_m]), **more)


def test_the_map_has_equal_scales_and_north_up() -> None:
    root = parse(draw_local_map([track("trusted", 0.0, 0.0), track("false", 300.0, 400.0)], title="map"))
    (disc,), (diamond,) = select_class(root, "mark", "trusted"), select_class(root, "mark", "false")
    x, y = list_corners(diamond)[0] + (0.0, 6.0)
    right, up = x - read_number(disc, "cx"), read_number(disc, "cy") - y
    assert right > 0
    assert up > 0
    assert right / up == pytest.approx(300.0 / 400.0, rel=1e-2)


def test_the_map_names_its_axes_with_units() -> None:
    found = list_texts(parse(draw_local_map([track("trusted", 0.0, 0.0)], title="map")))
    assert "east, m" in found
    assert "north, m" in found
    assert "0" in found


def test_the_ellipse_holds_95_percent() -> None:
    rng = np.random.default_rng(4)
    covariance_m2 = np.array([[4.0, 1.5], [1.5, 1.0]])
    root = parse(draw_local_map([track("trusted", 10.0, -5.0, covariance_m2=covariance_m2)], title="map"))
    (ellipse,), (disc,) = select_class(root, "ellipse"), select_class(root, "mark", "trusted")
    # metres per pixel, from two labelled ticks of the east axis
    ticks = [
        (float(e.text.replace("\N{MINUS SIGN}", "-")), read_number(e, "x"))
        for e in root.iter("text")
        if e.get("text-anchor") == "middle" and re.fullmatch("\N{MINUS SIGN}?[0-9.]+", e.text or "")
    ]
    (m0, x0), (m1, x1) = ticks[0], ticks[-1]
    ring_m = (
        (list_corners(ellipse) - (read_number(disc, "cx"), read_number(disc, "cy")))
        * (m1 - m0)
        / (x1 - x0)
        * (1.0, -1.0)
    )
    draws_m = rng.multivariate_normal(np.zeros(2), covariance_m2, 20000)
    ring_angle, draw_angle = (np.arctan2(p[:, 1], p[:, 0]) for p in (ring_m[:-1], draws_m))
    order = np.argsort(ring_angle)
    reach_m = np.interp(draw_angle, ring_angle[order], np.linalg.norm(ring_m[:-1], axis=1)[order], period=2 * np.pi)
    inside = np.mean(np.linalg.norm(draws_m, axis=1) < reach_m)
    assert inside == pytest.approx(0.95, abs=0.01)


def estimate_box(element: ElementTree.Element) -> tuple[float, float, float, float]:
    """Estimate the room that words take in a wide typeface."""
    half = 3.7 * len(element.text or "")
    x, y = read_number(element, "x"), read_number(element, "y")
    return x - half, y - 9.0, x + half, y + 2.5


def is_overlapping(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return min(a[2], b[2]) > max(a[0], b[0]) and min(a[3], b[3]) > max(a[1], b[1])


def test_places_that_coincide_share_a_label() -> None:
    tracks = [
        track(kind, e, n, receiver)
        for receiver, e, n in (("rx1", 0.0, 0.0), ("rx2", 50.0, -30.0))
        for kind in ("trusted", "unprotected")
    ]
    tracks += [track("false", 600.0, -600.0, receiver) for receiver in ("rx1", "rx2")]
    names = select_class(parse(draw_local_map(tracks, title="map")), "name")
    assert {e.text for e in names} == {"trusted, unprotected: rx1", "trusted, unprotected: rx2", "false: rx1, rx2"}
    boxes = [estimate_box(e) for e in names]
    assert not any(is_overlapping(a, b) for i, a in enumerate(boxes) for b in boxes[:i])


@given(st.lists(st.tuples(st.floats(-400.0, 400.0), st.floats(-400.0, 400.0)), min_size=2, max_size=5))
def test_names_on_the_map_stay_inside_it_and_apart(places: list[tuple[float, float]]) -> None:
    tracks = [track("false", east_m, north_m, f"rx{i}") for i, (east_m, north_m) in enumerate(places)]
    boxes = [estimate_box(e) for e in select_class(parse(draw_local_map(tracks, title="map")), "name")]
    assert all(a[0] >= 50.0 and a[2] <= 350.0 for a in boxes)
    assert not any(is_overlapping(a, b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_many_receivers_in_one_place_are_counted() -> None:
    tracks = [track("false", 0.0, 0.0, f"rx{i}") for i in range(10)] + [track("trusted", 500.0, 0.0)]
    assert "false: 10 receivers" in list_texts(parse(draw_local_map(tracks, title="map")))


def test_on_a_crowded_map_the_weightiest_kind_is_labelled() -> None:
    tracks = [track(kind, 100.0 * i, 0.0, f"rx{i}") for i in range(8) for kind in ("trusted", "unprotected")]
    names = [e.text for e in select_class(parse(draw_local_map(tracks, title="map")), "name")]
    assert names == [f"trusted: rx{i}" for i in range(8)]


def test_the_truth_is_a_cross_that_is_named() -> None:
    truth = TruePlace(receiver="rx1", east_m=80.0, north_m=0.0)
    root = parse(draw_local_map([track("trusted", 0.0, 0.0)], [truth], title="map"))
    (cross,), (disc,) = select_class(root, "true-place"), select_class(root, "mark", "trusted")
    assert list_corners(cross)[0, 0] + 7.0 > read_number(disc, "cx") + 50.0
    assert {"truth: rx1", "trusted: rx1"} <= set(list_texts(root))


@pytest.mark.parametrize("reach_m", [3.0, 40.0, 110.0, 300.0, 970.0, 7500.0])
def test_the_scale_bar_is_as_long_as_it_says(reach_m: float) -> None:
    root = parse(draw_local_map([track("trusted", 0.0, 0.0), track("false", reach_m, 0.3 * reach_m)], title="map"))
    (bar,) = select_class(root, "bar")
    start, end = (float(v) for v in re.findall(r"M([\d.]+) .*H([\d.]+)", bar.get("d", ""))[0])
    (disc,), (diamond,) = select_class(root, "mark", "trusted"), select_class(root, "mark", "false")
    metres = (end - start) / ((list_corners(diamond)[0, 0] - read_number(disc, "cx")) / reach_m)
    (reported,) = [t for t in list_texts(root) if re.fullmatch(r"[\d.]+ k?m", t)]
    assert float(reported.split()[0]) * (1000.0 if "km" in reported else 1.0) == pytest.approx(metres, rel=0.02)
    assert 30.0 <= end - start <= 100.0


@given(st.lists(st.floats(0.0, 300.0), max_size=15))
def test_labels_are_spread_in_order_within_bounds(wanted: list[float]) -> None:
    placed = np.array(spread(wanted, 14.0, 10.0, 290.0))
    order = np.argsort(wanted, kind="stable")
    assert (np.diff(placed[order]) >= 14.0 - 1e-9).all()
    assert all(10.0 <= p <= 290.0 for p in placed)


def test_labels_that_are_far_apart_stay_where_they_are() -> None:
    assert spread([200.0, 20.0, 100.0], 14.0, 10.0, 290.0) == [200.0, 20.0, 100.0]


def test_a_possible_position_is_drawn_as_such() -> None:
    tracks = [track("possible", 0.0, 0.0, "rx1 A"), track("possible", 500.0, 0.0, "rx1 B")]
    root = parse(draw_local_map(tracks, title="map"))
    assert len(select_class(root, "mark", "possible")) == 2
    assert {"possible: rx1 A", "possible: rx1 B"} <= set(list_texts(root))


def test_a_track_without_a_fix_draws_nothing() -> None:
    nothing = FixTrack(receiver="rx1", kind="trusted", east_m=np.array([np.nan]), north_m=np.array([np.nan]))
    assert draw_local_map([nothing], title="map") == ""
    assert len(select_class(parse(draw_local_map([nothing, track("false", 1.0, 2.0)], title="map")), "mark")) == 1


# The time line


def make_series(sat: str, label: Any, start_s: float, stop_s: float, cn0_dbhz: float, copy: str = "a") -> SignalSeries:
    seconds = np.arange(float(start_s), float(stop_s))
    return SignalSeries(
        receiver="rx1",
        signal=f"{sat} L1 CA {copy}",
        label=label,
        seconds=seconds,
        cn0_dbhz=np.full(seconds.size, float(cn0_dbhz)),
    )


def test_the_time_line_shows_labels_rows_units_and_onset() -> None:
    lines = [
        make_series("G05", "authentic", 0, 61, 44),
        make_series("G05", "spoofed", 30, 61, 46, "b"),
        make_series("G07", "unknown", 0, 61, 42),
    ]
    root = parse(draw_time_line(lines, title="time", zero="noon", onset_s=30.0))
    found = list_texts(root)
    assert {"G05", "G07", "onset", "time since noon, s", "C/N₀, each row 40 to 50 dB-Hz"} <= set(found)
    (onset,) = select_class(root, "onset")
    (authentic,), (spoofed,), _ = (select_class(root, "series", label) for label in ("authentic", "spoofed", "unknown"))
    x = list_corners(authentic)[:, 0]
    assert read_number(onset, "x1") == pytest.approx((x[0] + x[-1]) / 2.0, abs=0.2)
    assert list_corners(spoofed)[0, 0] == pytest.approx(read_number(onset, "x1"), abs=0.2)
    assert list_corners(spoofed)[0, 1] < list_corners(authentic)[0, 1]  # stronger is higher


def test_a_gap_in_a_signal_is_a_gap_in_its_line() -> None:
    line = make_series("G05", "authentic", 0, 10, 44)
    cn0_dbhz = line.cn0_dbhz.copy()
    cn0_dbhz[4:6] = np.nan
    broken = SignalSeries(
        receiver="rx1", signal=line.signal, label="authentic", seconds=line.seconds, cn0_dbhz=cn0_dbhz
    )
    (path,) = select_class(parse(draw_time_line([broken], title="t", zero="z")), "series")
    assert path.get("d", "").count("M") == 2


def test_long_recordings_are_drawn_in_minutes_and_stay_small() -> None:
    svg = draw_time_line([make_series("G05", "authentic", 0, 3601, 44)], title="t", zero="z", points=100)
    assert "time since z, min" in list_texts(parse(svg))
    assert len(svg) < 6000


def test_the_onset_has_a_band_of_two_sigma_to_either_side() -> None:
    lines = [make_series("G05", "authentic", 0, 101, 44)]
    root = parse(draw_time_line(lines, title="t", zero="z", onset_s=50.0, onset_sigma_s=5.0))
    (band,), (onset,), (line,) = (
        select_class(root, "onset-band"),
        select_class(root, "onset"),
        select_class(root, "series"),
    )
    x = list_corners(line)[:, 0]
    assert read_number(band, "width") == pytest.approx(0.2 * (x[-1] - x[0]), abs=0.3)
    assert read_number(band, "x") + 0.5 * read_number(band, "width") == pytest.approx(read_number(onset, "x1"), abs=0.2)


def test_the_end_of_an_attack_is_marked() -> None:
    lines = [make_series("G05", "authentic", 0, 101, 44)]
    root = parse(draw_time_line(lines, title="t", zero="z", onset_s=20.0, until_s=70.0))
    onset, end = (read_number(mark, "x1") for mark in select_class(root, "onset"))
    (line,) = select_class(root, "series")
    x = list_corners(line)[:, 0]
    assert (end - onset) / (x[-1] - x[0]) == pytest.approx(0.5, abs=0.01)
    assert {"onset", "end"} <= set(list_texts(root))


def test_a_ribbon_shows_how_long_a_signal_is_there() -> None:
    line = make_series("G05", "spoofed", 0, 101, 44)
    cn0_dbhz = line.cn0_dbhz.copy()
    cn0_dbhz[40:60] = np.nan
    broken = SignalSeries(receiver="rx1", signal=line.signal, label="spoofed", seconds=line.seconds, cn0_dbhz=cn0_dbhz)
    root = parse(draw_time_line([make_series("G05", "authentic", 0, 101, 44), broken], title="t", zero="z"))
    (whole,), (parts,) = select_class(root, "ribbon", "authentic"), select_class(root, "ribbon", "spoofed")
    runs = [(float(a), float(b)) for a, b in re.findall(r"M([\d.]+) [\d.]+H([\d.]+)", parts.get("d", ""))]
    ((start, end),) = [(float(a), float(b)) for a, b in re.findall(r"M([\d.]+) [\d.]+H([\d.]+)", whole.get("d", ""))]
    assert len(runs) == 2
    assert (runs[0][1] - start) / (end - start) == pytest.approx(0.39, abs=0.01)
    assert (runs[1][0] - start) / (end - start) == pytest.approx(0.60, abs=0.01)


def test_an_onset_before_the_recording_is_not_drawn() -> None:
    svg = draw_time_line([make_series("G05", "spoofed", 0, 10, 44)], title="t", zero="z", onset_s=-5.0)
    assert not select_class(parse(svg), "onset")


# The sky


def make_satellite(sat: str, azimuth_deg: float, elevation_deg: float, label: Any = "authentic") -> SkyPosition:
    return SkyPosition(
        receiver="rx1", signal=f"{sat} L1 CA a", label=label, azimuth_deg=azimuth_deg, elevation_deg=elevation_deg
    )


def test_the_sky_has_north_up_east_right_zenith_in_the_middle() -> None:
    root = parse(
        plot_sky(
            [make_satellite("G01", 0, 0), make_satellite("G02", 90, 0), make_satellite("G03", 45, 90)], title="sky"
        )
    )
    north, east, zenith = ((read_number(d, "cx"), read_number(d, "cy")) for d in select_class(root, "symbol"))
    assert north[0] == zenith[0]
    assert north[1] < zenith[1]
    assert east[1] == zenith[1]
    assert east[0] - zenith[0] == pytest.approx(zenith[1] - north[1])
    assert {"N 0°", "E 90°", "S 180°", "W 270°", "30°", "60°"} <= set(list_texts(root))


def test_a_satellite_of_two_labels_has_both_symbols() -> None:
    root = parse(
        plot_sky(
            [make_satellite("G05", 30, 40), make_satellite("G05", 31, 40, "spoofed"), make_satellite("G07", 200, 20)],
            title="sky",
        )
    )
    assert [len(select_class(root, "symbol", label)) for label in ("authentic", "spoofed")] == [2, 1]
    assert list_texts(root).count("G05") == 1


def test_a_source_that_was_seen_is_marked() -> None:
    root = parse(
        plot_sky([make_satellite("G05", 30, 40)], [SkySource(name="S1", azimuth_deg=120, elevation_deg=5)], title="sky")
    )
    assert len(select_class(root, "cross")) == 1
    assert "S1" in list_texts(root)


# All of them


def test_names_from_outside_are_escaped() -> None:
    svg = draw_local_map([track("trusted", 0.0, 0.0, "<b>&")], title='"<i>')
    assert "&lt;b&gt;&amp;" in svg
    assert "<i>" not in svg
    parse(svg)


def test_records_of_pictures_are_checked_and_frozen() -> None:
    with pytest.raises(ValueError, match=r"\bepoch is 2\b"):
        SignalSeries(receiver="r", signal="G01 L1 CA a", label="unknown", seconds=np.zeros(2), cn0_dbhz=np.zeros(3))
    with pytest.raises(ValueError, match="covariance_m2"):
        track("trusted", 0.0, 0.0, covariance_m2=np.eye(3))
    with pytest.raises(ValueError, match="read-only"):
        make_series("G05", "authentic", 0, 10, 44).seconds[0] = 1.0


def test_without_anything_to_draw_nothing_is_drawn() -> None:
    assert draw_local_map([], title="t") == draw_time_line([], title="t", zero="z") == plot_sky([], title="t") == ""
