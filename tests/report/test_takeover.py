"""The drawings of signals on top of a receiver's own."""

import re

import numpy as np
import pytest
from tests.report.svg import list_texts, parse, select_class

from skyproof.report.pictures import FixTrack
from skyproof.report.takeover import (
    ComparedSkies,
    CorrelationParts,
    FixOrigins,
    OriginSpan,
    TimeOffset,
    map_skies,
    plot_clocks,
    plot_correlations,
    plot_origins,
)


def list_parts(value, **more):
    delays = np.linspace(-1.0, 1.0, len(value))
    parts = np.stack((np.abs(value), 0.5 * np.abs(value)))
    numbers = {"second_chips": -0.4, "second_db": -6.0, "second_deg": 120.0} | more
    return CorrelationParts(
        receiver="rx1", sat="G07", at_s=3.0, delays_chips=delays, value=np.asarray(value), parts=parts, **numbers
    )


@pytest.mark.parametrize(("degrees", "colour"), [(0.0, 0), (14.0, 0), (16.0, 1), (-16.0, 11), (179.0, 6), (-179.0, 6)])
def test_colour_is_the_phase(degrees, colour):
    value = 20.0 * np.exp(1j * np.radians(np.full(9, degrees)))
    root = parse(plot_correlations([list_parts(value)], title="x"))
    shapes = [e.get("class") for e in select_class(root, "phase") if e.tag == "path"]
    assert shapes == [f"phase p{colour}"]


def test_a_second_phase_gives_a_second_colour():
    value = np.concatenate([np.full(5, 10.0j), np.full(5, 20.0 + 0.0j)])
    root = parse(plot_correlations([list_parts(value)], title="x"))
    first, second = [e for e in select_class(root, "phase") if e.tag == "path"]
    assert (first.get("class"), second.get("class")) == ("phase p3", "phase p0")
    base, *line = [float(y) for _, y in re.findall(r"(-?[\d.]+) (-?[\d.]+)", second.get("d"))]
    low = [float(y) for _, y in re.findall(r"(-?[\d.]+) (-?[\d.]+)", first.get("d"))]
    assert base - min(line) == pytest.approx(2.0 * (low[0] - low[1]), abs=0.2)
    assert "\N{MINUS SIGN}0.40 chip, \N{MINUS SIGN}6 dB, +120°" in list_texts(root)
    assert "delay, chips (1 chip = 293 m)" in list_texts(root)


def make_skies(**more):
    def fix(name, kind, east_m):
        return FixTrack(
            receiver=name, kind=kind, east_m=np.array([east_m]), north_m=np.zeros(1), covariance_m2=np.eye(2)
        )

    values = {
        "receiver": "rx1",
        "at_s": 50.0,
        "by": "the stated place",
        "tracks": (fix("here", "expected", 0.0), fix("sky 1", "trusted", 1.0), fix("sky 2", "false", 90.0)),
        "offsets": (
            TimeOffset(name="expected", kind="expected", ns=0.0, sigma_ns=5.0),
            TimeOffset(name="sky 1", kind="trusted", ns=4.0, sigma_ns=5.0),
            TimeOffset(name="sky 2", kind="false", ns=200.0, sigma_ns=5.0),
        ),
        "wrong": 1e-5,
        "chosen": True,
    } | more
    return ComparedSkies(**values)


def test_both_skies_stand_beside_what_was_expected():
    root = parse(map_skies(make_skies(), title="x"))
    (square,), (disc,), (diamond,) = (
        select_class(root, *names) for names in (("ring", "expected"), ("mark", "trusted"), ("mark", "false"))
    )
    at = float(square.get("x")) + 0.5 * float(square.get("width"))
    chosen, refused = float(disc.get("cx")), float(re.match(r"M([\d.]+)", diamond.get("d"))[1])
    assert (refused - at) / (chosen - at) == pytest.approx(90.0, rel=0.15)
    root = parse(plot_clocks(make_skies(), title="x"))
    expected, true, false = (float(e.get("cx")) for e in root.iter("circle"))
    assert (false - expected) / (true - expected) == pytest.approx(50.0, rel=0.05)
    assert any(text.endswith(", ns") for text in list_texts(root))
    assert not plot_clocks(make_skies(offsets=()), title="x")
    assert not map_skies(make_skies(tracks=()), title="x")


def test_bars_are_as_long_as_positions_came_from_there():
    stretches = (OriginSpan("trusted", 0.0, 40.0), OriginSpan("held", 40.0, 100.0))
    seconds = np.arange(0.0, 101.0)
    origins = FixOrigins(receiver="rx1", usable=stretches, seconds=seconds, away_m=np.maximum(seconds - 50.0, 0.0))
    root = parse(plot_origins(origins, title="x", zero="then", onset_s=30.0))
    (sky,), (held,) = select_class(root, "from", "trusted"), select_class(root, "from", "held")
    assert float(held.get("width")) == pytest.approx(1.5 * float(sky.get("width")), rel=0.01)
    assert "onset" in list_texts(root)
    assert "time since then, s" in list_texts(root)
    nothing = FixOrigins(receiver="rx1", usable=(), seconds=np.empty(0), away_m=np.empty(0))
    assert not plot_origins(nothing, title="x", zero="then")
