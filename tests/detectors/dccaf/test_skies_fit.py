"""Two skies fitted to all satellites' correlations at once: found where each alone says little, and never by chance."""

from functools import cache

import numpy as np
from scipy import stats
from tests.detectors.dccaf.test_inverse_raim import UP_EAST, draw_sky

from skyproof.detectors.dccaf.bursts import Decomposed, autocorrelate_code, build_shapes, fit_components, whiten_taps
from skyproof.detectors.dccaf.skies_fit import fit_skies
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.navigation.least_squares import design_matrix
from skyproof.studies.decomposition_laws import noise_variance

CHIP_M, BAND_HZ, INTERVALS = GPS_L1_CA.chip_m, 2.6e6, 4  # of 4 million samples a second
POINTS = tuple(np.arange(-5, 6) * 0.3)
LAGS = np.arange(-3.2, 3.2, 0.002)
SYSTEMATIC_M, MOST = 1.5, 1e-3


@cache
def build_looks(prn):
    """Build a signal's shapes, the correlation of its code at `LAGS`, and the root of its taps' noise."""
    code_shapes, points = build_shapes(GPS_L1_CA, prn, POINTS, BAND_HZ, 1.3), np.array(POINTS)
    between = autocorrelate_code(GPS_L1_CA, prn, np.concatenate([LAGS, (points[:, None] - points).ravel()]), BAND_HZ)
    values, vectors = np.linalg.eigh(between[LAGS.size :].reshape(points.size, -1))
    return code_shapes, between[: LAGS.size], vectors * np.sqrt(np.maximum(values, 0.0))


def draw_burst(rng, prn, delays_chips, sizes, *, cn0_dbhz=46.0):
    # Phases stay but for a difference of half a hertz.
    code_shapes, curve, root = build_looks(prn)
    variance = float(noise_variance(cn0_dbhz, 0.02, BAND_HZ))
    cycles = rng.random(2) + np.arange(INTERVALS)[:, None] * 0.02 * rng.normal(0.0, 0.5, 2)
    clean = sizes * np.exp(2j * np.pi * cycles) @ np.interp(np.array(POINTS) - delays_chips[:, None], LAGS, curve)
    white = rng.standard_normal((2, INTERVALS, len(POINTS))) * np.sqrt(0.5 * variance)
    taps, noise = clean + (white[0] + 1j * white[1]) @ root.T, np.full(INTERVALS, variance)
    return Decomposed(
        whiten_taps(taps, code_shapes, noise), code_shapes, fit_components(taps[None], code_shapes, noise[None])
    )


def draw_open_sky(rng, n):
    """Draw unit vectors until their geometry is that of an open sky."""
    units = draw_sky(rng, n)
    while np.linalg.cond(design_matrix(units)) > 8.0:
        units = draw_sky(rng, n)
    return units


def fit_drawn(rng, units, late_m, sizes):
    """Fit skies of satellites with first signals at the reference but for multipath, second ones so much later."""
    off_m = SYSTEMATIC_M * rng.standard_normal(len(units))
    delays = np.stack([off_m, off_m + late_m], axis=1) / CHIP_M
    bursts = [draw_burst(rng, prn + 1, delays[prn], sizes[prn]) for prn in range(len(units))]
    n = len(units)
    chip_m, systematic_m = np.full(n, CHIP_M), np.full(n, SYSTEMATIC_M)
    return fit_skies(
        bursts,
        units,
        np.zeros(n),
        systematic_m,
        chip_m,
        window_chips=1.3,
        set_probability=1e-3,
        most_doubt=MOST,
    )


def test_skies_have_their_covariance_where_signals_are_near():
    # 90 m apart, 1 dB, phases that stay: the curvature at the top promises too much.
    rng, squares, n = np.random.default_rng(1), [], 10
    false = np.append(90.0 * UP_EAST, 0.0)
    for _ in range(60):
        units = draw_open_sky(rng, n)
        two = fit_drawn(rng, units, design_matrix(units) @ false, np.tile([1.0, 1.12], (n, 1)))
        if two is None:
            continue
        assert two.doubt <= MOST
        true = int(np.argmin(np.linalg.norm(two.state_m, axis=1)))
        off_m = two.state_m[[true, 1 - true]] - np.stack([np.zeros(4), false])
        squares.append(np.einsum("ki,kij,kj->k", off_m, np.linalg.inv(two.covariance_m2[[true, 1 - true]]), off_m))
    found = np.array(squares)
    assert len(found) >= 25
    assert np.sum(found > stats.chi2.isf(1e-3, 4)) <= stats.binom.ppf(0.999, found.size, 0.005)
    assert 2.0 * found.size < found.sum() < stats.chi2.ppf(0.999, 4 * found.size)


def test_one_sky_is_not_taken_for_two():
    rng, n = np.random.default_rng(2), 9
    for _ in range(40):
        assert fit_drawn(rng, draw_sky(rng, n), np.zeros(n), np.tile([1.0, 0.0], (n, 1))) is None


def test_reflections_of_each_satellite_make_no_sky():
    # Of any delay within a chip, 1 to 6 dB weaker.
    rng, n, count = np.random.default_rng(3), 9, 0
    for _ in range(60):
        sizes = np.stack([np.ones(n), 10.0 ** (-0.05 * rng.uniform(1.0, 6.0, n))], axis=1)
        count += fit_drawn(rng, draw_sky(rng, n), rng.uniform(0.0, CHIP_M, n), sizes) is not None
    assert count == 0


def test_fewer_than_five_satellites_show_no_skies():
    rng, n = np.random.default_rng(4), 4
    assert fit_drawn(rng, draw_sky(rng, n), np.full(n, 100.0), np.ones((n, 2))) is None
