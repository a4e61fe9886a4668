"""The swing that a satellite's second signal gives the first: as large as it is stated, and only where there is one."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA
from skyproof.receiver.crosstalk import crosstalk_sigma_m
from skyproof.records import Observations, SignalId

CHIP_M = 299_792_458.0 / 1.023e6
N = 5


def observed(*signals: tuple[str, str, float, float, float]) -> Observations:
    """Signals of (satellite, letter, delay in chips, C/N0, Doppler), constant over `N` epochs."""

    def cells(values):
        return np.tile(np.array(values, float), (N, 1))

    shape = (N, len(signals))
    return Observations(
        receiver="rx", signals=tuple(SignalId(sat, "L1", "CA", copy) for sat, copy, *_ in signals),
        gpst=np.datetime64("2024-05-14T10:00:00", "ns") + np.arange(N) * np.timedelta64(200, "ms"),
        elapsed_s=0.2 * np.arange(1.0, N + 1), status=np.zeros(shape, np.uint8),
        found_elapsed_s=np.zeros(len(signals)), missed_elapsed_s=np.full(len(signals), np.nan),
        carrier_hz=np.full(len(signals), GPS_L1_CA.carrier_hz), averaged_s=0.2,
        pseudorange_m=cells([2.2e7 + CHIP_M * s[2] for s in signals]), carrier_cyc=np.zeros(shape),
        doppler_hz=cells([s[4] for s in signals]), cn0_dbhz=cells([s[3] for s in signals]),
        pseudorange_sigma_m=np.ones(shape), carrier_sigma_cyc=np.full(shape, 0.01), doppler_sigma_hz=np.ones(shape),
    )  # fmt: skip


def sigma_m(o: Observations, rate_hz: float = 2.6e6, early_late_chips: float = 0.79):
    return crosstalk_sigma_m(o, GPS_L1_CA, rate_hz=rate_hz, early_late_chips=early_late_chips)


def step_of(prn: int) -> int:
    """A lag from which the code's autocorrelation steps from -1/1023 to another value at the next chip."""
    code = GPS_L1_CA.code(prn).astype(float)
    auto = np.rint(np.fft.ifft(np.abs(np.fft.fft(code)) ** 2).real)
    return int(next(k for k in range(20, 900) if auto[k] == -1 and auto[k + 1] == 63))


def test_one_signal_a_satellite_does_not_swing():
    assert not sigma_m(observed(("G05", "a", 0.0, 45.0, 0.0), ("G07", "a", 3.3, 55.0, 0.0))).any()


def test_sharp_chips_give_the_slope_between_two_chips():
    """Many samples a chip, early and late inside the slope: R'(lag) / R'(0) = 64/1023 / 2 of (E - L)/P per chip."""
    lag = step_of(5) + 0.5
    swing_m = sigma_m(observed(("G05", "a", 0.0, 45.0, 0.0), ("G05", "b", lag, 45.0, 0.0)), 16e6, 0.5)[0, 0]
    assert swing_m == pytest.approx(CHIP_M * 0.5 * (64.0 / 1023.0) / 2.0 / np.sqrt(2.0), rel=0.05)


def test_it_grows_with_the_amplitude_of_the_other_and_fades_with_the_turns_between_the_carriers():
    lag = step_of(5) + 0.5
    own = ("G05", "a", 0.0, 45.0, 0.0)
    equal = sigma_m(observed(own, ("G05", "b", lag, 45.0, 0.1)))
    strong = sigma_m(observed(own, ("G05", "b", lag, 65.0, 0.1)))
    turning = sigma_m(observed(own, ("G05", "b", lag, 45.0, 500.0)))
    assert strong[:, 0] == pytest.approx(10.0 * equal[:, 0])
    assert strong[:, 1] == pytest.approx(0.1 * equal[:, 1])
    assert (turning[:, 0] < 0.01 * equal[:, 0]).all()


def test_where_the_other_is_not_measured_nothing_is_added():
    o = observed(("G05", "a", 0.0, 45.0, 0.0), ("G05", "b", step_of(5) + 0.5, 45.0, 0.0))
    gone = o.pseudorange_m.copy()
    gone[2:, 1] = np.nan
    swing_m = sigma_m(replace(o, pseudorange_m=gone))
    assert (swing_m[:2, 0] > 1.0).all()
    assert not swing_m[2:].any()
