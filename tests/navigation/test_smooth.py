from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from skyproof.navigation.smooth import smooth
from skyproof.records import Observations, SignalId

WAVELENGTH = 299792458.0 / 1575.42e6


def track(n, channels=1, *, sigma_m=1.0, rng=None, rate_m_s=300.0, ionosphere_m_s=0.0, step_s=1.0):
    """Make range with a constant rate, code with white noise and carrier without, as writable arrays."""
    elapsed = np.arange(n) * step_s
    motion = rate_m_s * elapsed + 0.05 * elapsed**2
    ionosphere = ionosphere_m_s * elapsed
    noise = 0.0 if rng is None else sigma_m * rng.standard_normal((n, channels))
    ones = np.ones((n, channels))
    return {
        "receiver": "rx",
        "signals": tuple(SignalId(f"G{k + 1:02d}") for k in range(channels)),
        "gpst": np.datetime64("2022-01-01T00:00:00", "ns") + (elapsed * 1e9).astype("timedelta64[ns]"),
        "elapsed_s": elapsed,
        "pseudorange_m": 2.2e7 + (motion + ionosphere)[:, None] + noise * ones,
        "carrier_cyc": (motion - ionosphere)[:, None] * ones / WAVELENGTH + np.arange(channels) * 1e8,
        "doppler_hz": -rate_m_s / WAVELENGTH * ones,
        "cn0_dbhz": 45.0 * ones,
        "pseudorange_sigma_m": sigma_m * ones,
        "carrier_sigma_cyc": 1e-4 * ones,
        "doppler_sigma_hz": 0.1 * ones,
        "status": np.zeros((n, channels), np.uint8),
        "found_elapsed_s": np.zeros(channels),
        "missed_elapsed_s": np.full(channels, np.nan),
        "averaged_s": step_s,
    }


def smooth_plainly(o, window_s, max_gap_epochs=3):
    """Smooth by the definition, cell by cell: the twin that the running sums must equal."""
    carrier = o.carrier_cyc * WAVELENGTH
    present = np.isfinite(o.pseudorange_m) & np.isfinite(carrier)
    value, sigma = o.pseudorange_m.copy(), o.pseudorange_sigma_m.copy()
    for c in range(present.shape[1]):
        arc, latest, number, slipped = np.full(len(present), -1), None, 0, False
        for i in range(len(present)):
            slipped |= o.status[i, c] == 3
            if present[i, c]:
                number += latest is not None and (slipped or i - latest > max_gap_epochs + 1)
                arc[i], latest, slipped = number, i, False
        for i in np.flatnonzero(present[:, c]):
            near = np.abs(o.elapsed_s - o.elapsed_s[i]) <= 0.5 * window_s * (1 + 1e-9)
            js = np.flatnonzero(near & (arc == arc[i]))
            w = 1.0 / o.pseudorange_sigma_m[js, c] ** 2
            value[i, c] = carrier[i, c] + np.sum(w * (o.pseudorange_m[js, c] - carrier[js, c])) / w.sum()
            sigma[i, c] = np.sqrt(1.0 / w.sum() + (o.carrier_sigma_cyc[i, c] * WAVELENGTH) ** 2)
    return value, sigma


@pytest.mark.parametrize("window_s", [0.0, 7.0, 20.0, 1e6])
def test_running_sums_equal_the_definition_in_all_cases(window_s):
    rng = np.random.default_rng(3)
    data = track(120, 5, rng=rng)
    data["pseudorange_sigma_m"] = rng.uniform(0.5, 5.0, (120, 5))
    data["status"][rng.random((120, 5)) < 0.03] = 3
    for name in ("pseudorange_m", "carrier_cyc"):
        data[name][rng.random((120, 5)) < 0.15] = np.nan
    data["pseudorange_m"][40:44, 0] = np.nan  # four missing: a new arc
    data["carrier_cyc"][60:63, 1] = np.nan  # three: the same arc
    data["pseudorange_m"][:, 4] = np.nan
    o = Observations(**data)
    smoothed = smooth(o, window_s=window_s)
    value, sigma = smooth_plainly(o, window_s)
    np.testing.assert_allclose(smoothed.pseudorange_m, value, atol=1e-6)
    np.testing.assert_allclose(smoothed.pseudorange_sigma_m, sigma, rtol=1e-9)
    np.testing.assert_array_equal(np.isnan(smoothed.pseudorange_m), np.isnan(o.pseudorange_m))


def test_the_noise_is_as_small_as_the_sigma_says():
    rng = np.random.default_rng(4)
    o = Observations(**track(61, 4000, rng=rng, sigma_m=2.0))
    smoothed = smooth(o, window_s=20.0)
    truth = Observations(**track(61, 4000)).pseudorange_m
    for row, cells in ((0, 11), (30, 21), (60, 11), (5, 16)):
        predicted = 2.0 / np.sqrt(cells)
        np.testing.assert_allclose(smoothed.pseudorange_sigma_m[row], predicted, rtol=1e-3)
        sum_of_squares = np.sum(((smoothed.pseudorange_m - truth)[row] / predicted) ** 2)
        assert 1e-4 < stats.chi2(4000).cdf(sum_of_squares) < 1 - 1e-4
    assert smoothed.averaged_s == 0.0


def test_a_slip_does_not_leak_into_the_other_arc():
    data = track(100)
    data["carrier_cyc"][50:] += 1e6
    data["status"][50] = 3
    smoothed = smooth(Observations(**data))
    np.testing.assert_allclose(smoothed.pseudorange_m, data["pseudorange_m"], atol=1e-6)
    data["status"][50] = 0  # an undeclared slip shows: the test above is not empty
    assert np.abs(smooth(Observations(**data)).pseudorange_m - data["pseudorange_m"]).max() > 1e4


def test_a_code_without_carrier_stays_as_it_is():
    data = track(10, rng=np.random.default_rng(5))
    data["carrier_cyc"][4] = np.nan
    smoothed = smooth(Observations(**data))
    assert smoothed.pseudorange_m[4] == data["pseudorange_m"][4]
    assert smoothed.pseudorange_sigma_m[4] == 1.0
    assert smoothed.pseudorange_m[5] != data["pseudorange_m"][5]


def test_the_ionosphere_diverges_at_the_ends_as_stated():
    data = track(400, ionosphere_m_s=1e-3)
    error = smooth(Observations(**data), window_s=100.0).pseudorange_m - data["pseudorange_m"]
    assert np.abs(error[50:-50]).max() < 1e-6
    assert 0.045 < np.abs(error[[0, -1]]).max() <= 0.050001


def test_nothing_in_nothing_out():
    empty = smooth(Observations(**track(0, 2)))
    assert empty.pseudorange_m.shape == (0, 2)
    no_channel = smooth(replace(Observations(**track(3, 0))))
    assert no_channel.pseudorange_m.shape == (3, 0)
