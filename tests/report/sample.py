"""A verdict and pictures that make a whole page."""

import json
from pathlib import Path

import numpy as np

from skyproof.report.figures import Pictures
from skyproof.report.pictures import (
    DelayProfile,
    DelayTag,
    FixTrack,
    MethodWords,
    RangeDifference,
    SignalSeries,
    SkyPosition,
    TruePlace,
)
from skyproof.report.takeover import ComparedSkies, CorrelationParts, FixOrigins, OriginSpan, TimeOffset
from skyproof.verdict import Place, Verdict

SAMPLE = json.loads((Path(__file__).parents[1] / "formats" / "verdict-sample.json").read_text(encoding="utf-8"))
VERDICT = Verdict.model_validate(SAMPLE)
EMPTY = Pictures(zero_gpst="2022-01-01T10:00:00")


def make_pictures(receivers: int = 2, sats: int = 3, epochs: int = 50) -> Pictures:
    rng = np.random.default_rng(7)
    names = [f"rx{i + 1}" for i in range(receivers)]
    signals = [
        (f"G{sat + 1:02} L1 CA {copy}", label)
        for sat in range(sats)
        for copy, label in (("a", "authentic"), ("b", "spoofed"))
    ]
    return Pictures(
        zero_gpst="2022-01-01T10:00:00",
        onset_s=24.0,
        onset_sigma_s=0.5,
        origin=Place(lat_deg=59.4121, lon_deg=16.8837, height_m=31.0),
        series=tuple(
            SignalSeries(
                receiver=name,
                signal=signal,
                label=label,
                seconds=np.arange(epochs) * 1.0,
                cn0_dbhz=rng.normal(45.0, 0.5, epochs),
            )
            for name in names
            for signal, label in signals
        ),
        tracks=tuple(
            FixTrack(
                receiver=name,
                kind=kind,
                east_m=east_m + rng.normal(0.0, 0.5, epochs),
                north_m=rng.normal(0.0, 0.5, epochs),
                covariance_m2=np.eye(2),
            )
            for name in names
            for kind, east_m in (("trusted", 0.0), ("false", 700.0), ("unprotected", 700.0))
        ),
        sky=tuple(
            SkyPosition(receiver=name, signal=signal, label=label, azimuth_deg=40.0 * i, elevation_deg=30.0)
            for name in names
            for i, (signal, label) in enumerate(signals)
        ),
        truth=(TruePlace(receiver="rx1", east_m=1.0, north_m=-0.5),),
        profiles=tuple(
            DelayProfile(
                receiver="rx1",
                sat=f"G{sat + 1:02}",
                at_s=48.0,
                delays_chips=np.linspace(-3.0, 8.0, 111),
                power=1.0 + 20.0 * np.exp(-(np.linspace(-3.0, 8.0, 111) ** 2)),
                tags=(DelayTag(label="authentic", delay_chips=0.0), DelayTag(label="spoofed", delay_chips=4.0)),
            )
            for sat in range(min(sats, 6))
        ),
        differences=tuple(
            RangeDifference(receivers=(names[0], names[-1]), sat=f"G{sat + 1:02}", label=label, metres=float(metres))
            for sat in range(sats)
            for label, metres in (("authentic", 20.0 * sat - 20.0), ("spoofed", 0.0))
        ),
        correlations=tuple(_make_correlation(f"G{sat + 1:02}") for sat in range(min(sats, 6))),
        compared=(_make_compared(),),
        origins=(
            FixOrigins(
                receiver="rx1",
                usable=(
                    OriginSpan("trusted", 0.0, 20.0),
                    OriginSpan("inertial", 20.0, 30.0),
                    OriginSpan("held", 30.0, 49.0),
                ),
                seconds=np.arange(50.0),
                away_m=np.maximum(np.arange(50.0) - 24.0, 0.0),
            ),
        ),
        findings=(
            MethodWords(
                detector="multi_receiver",
                words="2 satellites come from one antenna",
                from_gpst="2022-01-01T10:00:30",
                to_gpst="2022-01-01T10:00:40",
            ),
        ),
    )


def _make_correlation(sat: str) -> CorrelationParts:
    delays = np.linspace(-1.5, 1.5, 151)
    parts = np.stack([size * np.maximum(1.0 - np.abs(delays - at), 0.0) for size, at in ((20.0, 0.0), (12.0, -0.5))])
    return CorrelationParts(
        receiver="rx1",
        sat=sat,
        at_s=48.0,
        delays_chips=delays,
        value=parts[0] + parts[1] * np.exp(2j),
        parts=parts,
        second_chips=-0.5,
        second_db=-4.4,
        second_deg=114.6,
    )


def _make_compared() -> ComparedSkies:
    kinds = (("expected", "expected", 0.0), ("sky 1", "trusted", 1.0), ("sky 2", "false", 80.0))
    return ComparedSkies(
        receiver="rx1",
        at_s=45.0,
        by="a receiver that stands",
        tracks=tuple(
            FixTrack(
                receiver=name,
                kind=kind,
                east_m=np.array([east_m]),
                north_m=np.zeros(1),
                covariance_m2=np.eye(2),
            )
            for name, kind, east_m in kinds
        ),
        offsets=tuple(TimeOffset(name=name, kind=kind, ns=3.0 * ns, sigma_ns=4.0) for name, kind, ns in kinds),
        wrong=1e-6,
        chosen=True,
    )
