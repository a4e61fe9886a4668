"""Results show themselves: what was received, what was made, which places are possible."""

import numpy as np

from skyproof.app.protect.outcome import ReceiverOutcome
from skyproof.app.protect.pictures import list_kinds
from skyproof.app.protect.positions import Track
from skyproof.app.receive import ReceiveResult
from skyproof.app.receive.reception import Reception
from skyproof.app.receive.run import list_signals
from skyproof.app.scenes.simulate import SimulateResult
from skyproof.records import Fix, NavigationData, Observations, Samples, SignalId
from skyproof.simulator.scenes import read_ready_made

NOBODY = NavigationData(ephemerides=(), ionosphere=None, utc=None, source="nothing")


def describe_samples(name: str) -> Samples:
    return Samples(name=name, rate_hz=1e6, n_samples=0, read=lambda start, count: np.zeros((2, 0), np.float32))


def make_observations(receiver: str) -> Observations:
    """Make two signals over three epochs; the second never gave a time."""
    cells = np.full((3, 2), np.nan)
    cells[:, 0] = 1.0
    return Observations(
        receiver=receiver,
        signals=(SignalId("G05"), SignalId("G05", copy="b")),
        gpst=np.datetime64("2024-05-14T10:00:00", "ns") + np.arange(3) * np.timedelta64(1, "s"),
        elapsed_s=np.arange(3.0),
        pseudorange_m=2e7 * cells,
        carrier_cyc=cells,
        doppler_hz=-1234.0 * cells,
        cn0_dbhz=44.4 * cells,
        pseudorange_sigma_m=cells,
        carrier_sigma_cyc=cells,
        doppler_sigma_hz=cells,
        status=np.where(np.isfinite(cells), 0, 2).astype(np.uint8),
        found_elapsed_s=np.array([0.1, 2.6]),
        missed_elapsed_s=np.full(2, np.nan),
    )


def test_received_signals_and_silent_receivers_are_shown() -> None:
    o = make_observations("bow")
    heard = Reception(source=describe_samples("bow"), observations=o, decoded=NOBODY, n_signals=2, examined_s=3.0)
    deaf = Reception(
        source=describe_samples("<stern>"),
        observations=None,
        decoded=NOBODY,
        n_signals=0,
        examined_s=3.0,
        left_out="deaf",
    )
    result = ReceiveResult(receptions=(heard, deaf), signals=(list_signals(heard.observations), ()))._repr_html_()
    for reported in (
        "bow: 2 signals in 3.0 s",
        "&lt;stern&gt;: 0 signals in 3.0 s; left out: deaf",
        "G05 L1 CA a",
        "G05 L1 CA b",
        "44.4",
        "-1234",
        "2.6",
    ):
        assert reported in result, reported
    assert result.count("<tr>") == 3


def test_a_scene_is_shown_with_the_files_that_there_are(tmp_path) -> None:
    (tmp_path / "rx1.obs").write_bytes(bytes(2500))
    made = SimulateResult(
        scenario=read_ready_made("two-antennas"),
        folder=tmp_path,
        files=("rx1.obs", "rx2.obs"),
        recordings=(),
        observations=(),
    )
    result = made._repr_html_()
    for reported in ("Scene two-antennas", "receivers: rx1, rx2; attacks: spoofer.", "rx1.obs", "2.5 kB"):
        assert reported in result, reported
    assert "rx2.obs" not in result


def track_at(receiver: str, x_m: float) -> Track:
    """Make a track of two epochs at one place."""
    zero = np.zeros(1)
    last = Fix(
        receiver=receiver,
        signals=(SignalId("G05"),),
        gpst=make_observations(receiver).gpst[1:2],
        position_ecef_m=np.array([[x_m, 0.0, 0.0]]),
        velocity_ecef_m_s=np.zeros((1, 3)),
        clock_bias_s=zero,
        clock_drift=zero,
        covariance_m2=np.eye(4)[None],
        residual_m=np.zeros((1, 1)),
        status=np.zeros(1, np.uint8),
    )
    place_m = np.tile([x_m, 0.0, 0.0], (2, 1))
    return Track(
        gpst=make_observations(receiver).gpst[:2], position_ecef_m=place_m, clock_bias_s=np.zeros(2), last=last
    )


def test_while_two_skies_are_open_both_fixes_are_given() -> None:
    heard = Reception(source=describe_samples("bow"), observations=None, decoded=NOBODY, n_signals=8, examined_s=3.0)
    skies = {"S1": track_at("bow", 6.378137e6), "S2": track_at("bow", 6.378237e6)}
    outcome = ReceiverOutcome(reception=heard, tracks=skies | {"unprotected": skies["S2"]})
    assert list_kinds(outcome) == ["unprotected", "S1", "S2"]
    decided = ReceiverOutcome(reception=heard, tracks={"false": skies["S2"], "S2": skies["S2"]})
    assert list_kinds(decided) == ["false"]
