"""p-values of every test under its null hypothesis: each function draws as many as asked, (n,).

The nulls are those that the tests are for: false signals of one antenna where "one antenna" is rejected, a true sky
where that is, noise as stated. A null that the test was not made for is in the name.
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from scipy import special
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from skyproof.arrays import Booleans, Reals
from skyproof.detectors.array.arm_phases import estimate_rate, fit_whole_series, subtract_mean
from skyproof.detectors.array.array_common import bound_chance_by_size
from skyproof.detectors.array.array_model import (
    array_design,
    conditional_statistics,
    joint_statistic,
    residual_covariance,
    sky_p_value,
    white_covariance,
)
from skyproof.detectors.correlators import correlator_laws as law
from skyproof.detectors.correlators import vector_parity as parity
from skyproof.detectors.dccaf.inverse_raim import parity_matrix
from skyproof.detectors.multi_receiver.along_baselines import span_test
from skyproof.detectors.multi_receiver.one_antenna import (
    WHITE,
    TrackNoise,
    average_contrasts,
    baseline_design,
    compute_contrasts,
    distance_p_value,
    estimate_baselines,
    one_antenna_test,
    ratio_test,
)
from skyproof.navigation.chance import bound_chance_p_value
from skyproof.navigation.least_squares import design_matrix
from skyproof.navigation.raim import check_residuals, fit_whitened
from skyproof.statistics.autoregression import ar1_line
from skyproof.statistics.clusters import divide_line
from skyproof.statistics.cusum import cusum_step
from skyproof.statistics.directions import (
    direction_cosines,
    equal_clusters,
    equal_statistic,
    equality_chance,
    pair_statistics,
)
from skyproof.statistics.distributions import chi_square_survival
from skyproof.statistics.many_small import many_small
from skyproof.studies import discriminator_laws as laws
from skyproof.studies import quality_metrics as sqm
from skyproof.studies import vector_parity_tests as parity_tests
from skyproof.studies import vector_rules as rules
from skyproof.studies.arm_angles import (
    arm_angles,
    compare_with_prediction,
    fit_pairs,
    full_information,
    pair_information,
)
from skyproof.studies.array_geometry import equilateral_triangle, phase_residuals, single_statistic
from skyproof.studies.decomposition_laws import (
    count_statistic,
    count_test,
    delay_dictionary,
    noise_variance,
    simulate_taps,
)
from skyproof.studies.direction_tests import equal_p_value, outsider_statistic
from skyproof.studies.double_difference import Tested, difference_test, estimate_pooled_correlation
from skyproof.studies.exclusion import choose_fix
from skyproof.studies.group_choice import check_known_baseline, check_known_sky, fraction_test
from skyproof.studies.ins_array_figures import ERRORS, SIGMA_CYC
from skyproof.studies.linear_tests import linear_model, linear_test
from skyproof.studies.run_lengths import cusum_threshold, page_threshold
from skyproof.studies.vector_loops import draw_discriminators
from skyproof.studies.vector_sky import SKY, attack_on

__all__ = [
    "ASKED",
    "Draw",
    "clusters_of_random_directions",
    "count_of_signals",
    "cured",
    "cusum_runs",
    "different",
    "distance",
    "divided",
    "equal_vectors",
    "exclusion",
    "fractions",
    "gaussian_model",
    "known_baseline",
    "known_sky",
    "lag_one",
    "line_parts",
    "many_of_ten",
    "one_antenna",
    "outsider",
    "page_runs",
    "pair_of_spinning",
    "parity_of",
    "predicted",
    "raim",
    "ratio",
    "satellites_in_place",
    "signals_of_one_antenna",
    "slow_and_fast",
    "span",
    "spinning",
    "suspect_left",
    "taps_metric",
    "too_many_parts",
    "true_set",
    "two_step_rule",
    "unrelated_sets",
    "variance_of_window",
]

Draw = Callable[[np.random.Generator, int], Reals]

ASKED: Final = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Values of p at which shares are reported."""

_SKY_DEG: Final = ((20, 15), (75, 40), (110, 65), (160, 25), (205, 50), (250, 20), (300, 35), (340, 75))
_UNITS: Final = direction_cosines(*np.radians(np.array(_SKY_DEG, float).T))  # of eight satellites
_BASELINE: Final = np.array([[14.0, 14.0, 0.5]])


def _tracks(rng: np.random.Generator, shape: tuple[int, ...], *, phi: float = 0.0) -> Reals:
    """Errors (n, epochs, ...) of tracks: AR(1) over the epochs, of variance 1."""
    noise = rng.standard_normal(shape)
    if phi:
        noise[:, 1:] *= np.sqrt(1.0 - phi**2)
        noise = lfilter([1.0], [1.0, -phi], noise, axis=1)
    return np.asarray(noise)


# Several receivers ----------------------------------------------------------------------------------------------------


def different(tested: Tested, sigma_m: float | None, *, receivers: int = 3, epochs: int = 12) -> Draw:
    """1a, 1b, 2a, 2b on double differences of false signals."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        errors = rng.standard_normal((n, 2, epochs, receivers))
        dd = errors[:, 0] - errors[:, 1]
        return difference_test(dd[..., 1:] - dd[..., :1], tested=tested, sigma_m=sigma_m).p_value

    return draw


def cured(phi: float, constant_m: float = 0.0) -> Draw:
    """1b with the coefficient pooled over 14 single differences of two receivers and 30 epochs."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        errors = np.stack([_tracks(rng, (n, 30, 2), phi=phi) for _ in range(14)], axis=1)
        errors = errors + constant_m * rng.standard_normal((n, 14, 1, 2))
        sd = errors[..., 1:] - errors[..., :1]
        estimate = estimate_pooled_correlation(sd)
        return difference_test(sd[:, 0] - sd[:, 1], phi=estimate, constant_sigma_m=constant_m).p_value

    return draw


def one_antenna(
    noise: TrackNoise, *, epochs: int = 10, sigma_m: float = 1.0, phi: float = 0.0, constant_m: float = 0.0
) -> Draw:
    """Seven satellites in two receivers."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        errors = sigma_m * _tracks(rng, (n, epochs, 7, 2), phi=phi) + constant_m * rng.standard_normal((n, 1, 7, 2))
        values, gain, _ = compute_contrasts(errors, np.ones((7, 2)))
        return one_antenna_test(average_contrasts(values, gain, noise)).p_value

    return draw


def ratio(rng: np.random.Generator, n: int) -> Reals:
    """Both tables from one antenna, means of 4 epochs of AR(1) 0.9."""
    table, other = (_tracks(rng, (n, 4, 7, 2), phi=0.9).mean(axis=1) for _ in range(2))
    sigma_m = np.ones((7, 2))
    return ratio_test(table, sigma_m, other, sigma_m).p_value


def distance(rng: np.random.Generator, n: int) -> Reals:
    """Antennas 5 m apart, tested for 5 m at most."""
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    baseline_m = 5.0 * np.column_stack([np.sin(angle), np.cos(angle), np.zeros(n)])
    ranges_m = _tracks(rng, (n, 10, 8, 2))
    ranges_m[..., 1] -= (baseline_m @ _UNITS.T)[:, None, :]
    values, gain, matrix = compute_contrasts(ranges_m, np.ones((8, 2)))
    levels = average_contrasts(values, gain, WHITE)
    return distance_p_value(levels, estimate_baselines(levels, baseline_design(matrix, _UNITS)), 5.0, "at most")


def _pairings(rng: np.random.Generator, n: int, receivers: int, baseline_enu_m: Reals) -> tuple[Reals, Reals]:
    """Means (n, 8, R) of a pairing of one antenna and of the sky beside it."""
    clocks_m = 1e5 * rng.standard_normal((2, n, 1, receivers))
    shown_m = rng.normal(0.0, 300.0, (2, n, 3)) @ _UNITS.T
    false, sky = shown_m[..., None] + clocks_m + rng.standard_normal((2, n, 8, receivers))
    sky[..., 1:] -= _UNITS @ np.broadcast_to(baseline_enu_m, (receivers - 1, 3)).T
    return false, sky


def span(part: str, *, receivers: int = 2, apart: bool = True) -> Draw:
    """The pairing of one antenna; the antennas 20 m apart, or at one place."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        test = span_test(*_pairings(rng, n, receivers, _BASELINE if apart else 0.0 * _BASELINE), _UNITS)
        return np.asarray(getattr(test, part))

    return draw


def known_baseline(rng: np.random.Generator, n: int) -> Reals:
    """The pairing of one antenna, the sky over a known baseline of 20 m."""
    return check_known_baseline(*_pairings(rng, n, 2, _BASELINE), _UNITS, _BASELINE)


def known_sky(rng: np.random.Generator, n: int) -> Reals:
    """The pairing of the sky."""
    return check_known_sky(_pairings(rng, n, 2, _BASELINE)[1], _UNITS, _BASELINE, 1.0)


def fractions(sigma_cyc: float) -> Draw:
    """Carrier differences of seven satellites, any whole cycles."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        cycles = rng.random((n, 1)) + rng.integers(-9, 9, (n, 7)) + sigma_cyc * rng.standard_normal((n, 7))
        return fraction_test(cycles, sigma_cyc).p_value

    return draw


# One receiver's positions ---------------------------------------------------------------------------------------------


def raim(rng: np.random.Generator, n: int) -> Reals:
    """Eight satellites, noise as stated."""
    sigma_m = np.linspace(1.0, 4.0, 8)
    misfit_m = sigma_m * rng.standard_normal((n, 8)) + rng.normal(0.0, 100.0, (n, 4)) @ design_matrix(_UNITS).T
    residual, _, _ = fit_whitened(design_matrix(_UNITS), misfit_m, np.broadcast_to(sigma_m, (n, 8)))
    return check_residuals(residual, np.ones((n, 8)), false_alarm_probability=0.01).p_value


def unrelated_sets(rng: np.random.Generator, n: int) -> Reals:
    """Six signals at independent delays over 100 m: that they fit one position."""
    some = parity_matrix(_UNITS[:6])
    statistic = np.sum((rng.uniform(-50.0, 50.0, (n, 6)) @ some.T) ** 2, axis=-1)
    return bound_chance_p_value(np.ones((n, 6)), window_m=100.0, largest_statistic=statistic)


def many_of_ten(rng: np.random.Generator, n: int) -> Reals:
    """Ten uniform p-values."""
    return np.array([many_small(p_values).p_value for p_values in rng.random((n, 10))])


def true_set(rng: np.random.Generator, n: int) -> Reals:
    """The set of the true signals of eight satellites."""
    sigma_m = np.linspace(1.0, 4.0, 8)
    misfit_m = sigma_m * rng.standard_normal((n, 8)) + rng.normal(0.0, 100.0, (n, 4)) @ design_matrix(_UNITS).T
    return chi_square_survival(np.sum((misfit_m @ parity_matrix(_UNITS, sigma_m).T) ** 2, axis=-1), 4)


def exclusion(rng: np.random.Generator, n: int) -> Reals:
    """The true one of two fixes, beside an inertial navigator that has drifted."""
    both_fixes, fix = (root @ root.T for root in (rng.normal(0.0, 20.0, (3, 3)), rng.normal(0.0, 3.0, (3, 3))))
    place = rng.standard_normal((n, 3)) @ np.linalg.cholesky(both_fixes).T
    true = rng.standard_normal((n, 3)) @ np.linalg.cholesky(fix).T
    fixes = np.stack([true, true + 100.0], axis=1)
    return np.asarray(choose_fix(place, both_fixes, fixes, np.stack([fix, fix])).p_value[:, 0])


def count_of_signals(rng: np.random.Generator, n: int) -> Reals:
    """Grids of one signal at 5 Msps, by a law from as many simulated ones as are tested, or 3000."""
    delays, variance = delay_dictionary(5e6), noise_variance(42.0, 0.02, 5e6)
    test = count_test(delays, rng, runs=max(n, 3000))
    delay, turn = rng.uniform(-0.5, 0.5, (n, 1)), np.exp(2j * np.pi * rng.random((n, 1)))
    return test.p_value(count_statistic(simulate_taps(delay, turn, variance, delays, rng), delays, variance)[0])


# Correlators ----------------------------------------------------------------------------------------------------------


def taps_metric(metric: str, amplitude: float) -> Draw:
    """A signal in lock, taps half a chip apart."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        offsets = np.array([-0.5, 0.0, 0.5])
        root = np.linalg.cholesky(sqm.tap_covariance(offsets) + 1e-12 * np.eye(3))
        i, q = rng.standard_normal((2, n, 3)) @ root.T
        early, prompt, late = (i + amplitude * law.triangle(offsets) + 1j * q).T
        if metric == "ratio":
            return sqm.ratio_p_value(sqm.ratio_metric(early, prompt, late), sqm.ratio_law(0.5), amplitude)
        of = sqm.delta_metric if metric == "delta" else sqm.magnitude_difference
        return sqm.ratio_p_value(of(early, prompt, late), sqm.delta_law(0.5), amplitude)

    return draw


def slow_and_fast(*, magnitudes: bool) -> Draw:
    """Correlators 25 Hz off the carrier over 10 ms at 40 dB-Hz."""
    offset_hz, coherent_s = 25.0, 0.01
    amplitude = float(laws.prompt_amplitude(40.0, coherent_s=coherent_s))

    def draw(rng: np.random.Generator, n: int) -> Reals:
        x = np.array([-1.0, 0.0, 1.0]) * offset_hz * coherent_s
        root = np.linalg.cholesky(np.sinc(x[:, None] - x))
        i, q = rng.standard_normal((2, n, 3)) @ root.T
        slow, prompt, fast = (i + amplitude * np.sinc(x) + 1j * q).T
        found = sqm.doppler_metric(slow, prompt, fast, magnitudes=magnitudes)
        return sqm.ratio_p_value(found, sqm.doppler_law(offset_hz, coherent_s), amplitude)

    return draw


def variance_of_window(rng: np.random.Generator, n: int) -> Reals:
    """Windows of 50 values apart from each other."""
    variance = sqm.moving_variance(0.3 * rng.standard_normal((n, 50)), 50)[:, 0]
    return sqm.moving_variance_p_value(variance, 0.3, 50)


def _discriminators(rng: np.random.Generator, n: int, sums: int) -> tuple[Reals, Reals, float]:
    amplitude = float(laws.prompt_amplitude(40.0, sums))
    return *draw_discriminators(rng, n, amplitude, np.zeros(6), np.zeros(6)), amplitude


def parity_of(sums: int, *, scores: bool = True) -> Draw:
    """Six satellites at 40 dB-Hz, sums of so many milliseconds."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        u, q, amplitude = _discriminators(rng, n, sums)
        y = parity.parity_vector(u, q, parity_tests.whitener(SKY.parity, amplitude), scores=scores)
        return parity.parity_test(y).p_value

    return draw


def suspect_left(rng: np.random.Generator, n: int) -> Reals:
    """What the attacked satellite leaves, sums of 1 s."""
    settled = rules.equilibrium(SKY, attack_on(2, size=0.1), attack_on(2, size=50.0), 40.0)
    amplitude = float(laws.prompt_amplitude(40.0, 1000))
    white = parity_tests.whitener(SKY.parity, amplitude)
    u, q = draw_discriminators(rng, n, amplitude, *settled)
    return parity_tests.suspects(parity.parity_vector(u, q, white, scores=False), white).p_value


def two_step_rule(sums: int) -> Draw:
    """The paper's P_FA at the limits that the chosen satellite just reaches: what its rule takes for the p-value."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        u, q, amplitude = _discriminators(rng, n, sums)
        chosen = rules.two_step(u, q).chosen[:, None]
        code, phase = (np.abs(np.take_along_axis(x, chosen, axis=1))[:, 0] for x in (u, q))
        reached = np.maximum(code / rules.CODE_LIMIT_CHIPS, phase / rules.PHASE_LIMIT_RAD)
        scale = np.geomspace(1e-3, 20.0, 400)
        each = rules.detection_probability(
            np.full(scale.shape, amplitude),
            code_limit_chips=scale * rules.CODE_LIMIT_CHIPS,
            phase_limit_rad=scale * rules.PHASE_LIMIT_RAD,
        )
        return np.interp(reached, scale, each)

    return draw


# One after the other --------------------------------------------------------------------------------------------------

_MEAN_STEPS: Final = 300.0


_Step = Callable[[Reals, Reals], tuple[Reals, Booleans]]


def _runs(rng: np.random.Generator, n: int, degrees: int, step: _Step) -> Reals:
    """1 - (1 - 1/L)^T of the steps T to a false alarm, L their mean, with T made continuous at random."""
    state, waiting, steps = np.zeros((n, degrees)), np.arange(n), np.zeros(n)
    while waiting.size:
        steps[waiting] += 1.0
        state, over = step(state, rng.standard_normal(state.shape))
        state, waiting = state[~over], waiting[~over]
    return np.asarray(-np.expm1((steps - rng.random(n)) * np.log1p(-1.0 / _MEAN_STEPS)))


def cusum_runs(rng: np.random.Generator, n: int) -> Reals:
    """Crosier's sum in 4 dimensions, from zero."""
    limit = cusum_threshold(_MEAN_STEPS, 1.0, 4)

    def step(state: Reals, y: Reals) -> tuple[Reals, Booleans]:
        after = cusum_step(state, y, 1.0)
        return after, np.linalg.norm(after, axis=-1) > limit

    return _runs(rng, n, 4, step)


def page_runs(rng: np.random.Generator, n: int) -> Reals:
    """Page's one-sided sum, from zero."""
    limit = page_threshold(_MEAN_STEPS, 0.5)

    def step(state: Reals, y: Reals) -> tuple[Reals, Booleans]:
        after = np.maximum(0.0, state + y - 0.5)
        return after, after[:, 0] > limit

    return _runs(rng, n, 1, step)


# Arrays ---------------------------------------------------------------------------------------------------------------

_ELEMENTS: Final = equilateral_triangle(1.0)
_OWN: Final = white_covariance([SIGMA_CYC] * 3)


def satellites_in_place(test: str, *, errors: bool = True) -> Draw:
    """A triangle of one wavelength under eight true signals, any cycles; exact rotations by the attitude's error."""
    stated = residual_covariance(_ELEMENTS, _UNITS, sigma_cyc=SIGMA_CYC, **(ERRORS if errors else {}))

    def draw(rng: np.random.Generator, n: int) -> Reals:
        wrong, seen = np.broadcast_to(_ELEMENTS, (n, 3, 3)), np.broadcast_to(_UNITS, (n, 8, 3))
        if errors:
            wrong = wrong + ERRORS["position_sigma_cyc"] * rng.standard_normal((n, 3, 3))
            tilt = np.sqrt(ERRORS["attitude_covariance_rad2"]) * rng.standard_normal((n, 3))
            seen = _UNITS @ np.swapaxes(Rotation.from_rotvec(tilt).as_matrix(), -1, -2)
        phase = seen @ np.swapaxes(wrong, -1, -2) + SIGMA_CYC * rng.standard_normal((n, 8, 3)) + rng.random((n, 8, 1))
        z = phase_residuals(phase, _ELEMENTS, _UNITS)
        if test == "paper":
            return chi_square_survival(single_statistic(z[:, 3], _OWN), 2)
        z = z + rng.integers(-3, 4, z.shape)
        if test == "single":
            return chi_square_survival(single_statistic(z[:, 3], stated[6:8, 6:8], wrapped=True), 2)
        if test == "conditional":
            return chi_square_survival(conditional_statistics(z, stated, wrapped=True)[:, 3], 2)
        if test == "joint":
            return chi_square_survival(joint_statistic(z, stated, wrapped=True), 16)
        return sky_p_value(z, stated)

    return draw


def equal_vectors(*, wrapped: bool) -> Draw:
    """Six phase differences of a triangle under one source."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        values = rng.random((n, 1, 2)) + rng.standard_normal((n, 6, 2)) @ np.linalg.cholesky(_OWN).T
        values = values + rng.integers(-3, 4, values.shape) if wrapped else values
        return equal_p_value(values, _OWN, wrapped=wrapped)

    return draw


def outsider(rng: np.random.Generator, n: int) -> Reals:
    """One more of the same source against the mean of five."""
    values = rng.standard_normal((n, 6, 2)) @ np.linalg.cholesky(_OWN).T
    _, mean, of_mean = equal_statistic(values[:, :5], _OWN)
    return chi_square_survival(outsider_statistic(values[:, 5], _OWN, mean, of_mean), 2)


def divided(rng: np.random.Generator, n: int) -> Reals:
    """Six of one source: the union bound over their pairs."""
    values = rng.standard_normal((n, 6, 2)) @ np.linalg.cholesky(_OWN).T
    largest = pair_statistics(values, _OWN).max(axis=(-1, -2))
    return np.asarray(np.minimum(1.0, 15.0 * chi_square_survival(largest, 2)))


def clusters_of_random_directions(rng: np.random.Generator, n: int) -> Reals:
    """Six signals from anywhere: the chance that the largest cluster is reported to have."""
    design = array_design(_ELEMENTS)
    sky = direction_cosines(2.0 * np.pi * rng.random((n, 6)), np.arcsin(rng.random((n, 6))))
    values = sky @ design.T + rng.standard_normal((n, 6, 2)) @ np.linalg.cholesky(_OWN).T
    found = equal_clusters(values, _OWN, false_alarm_probability=0.01, wrapped=True)
    chance = equality_chance(design, _OWN, found.limit, wrapped=True)
    size = np.max(np.sum(found.labels[:, :, None] == found.labels[:, None, :], axis=-1), axis=-1)
    return np.asarray(np.array([bound_chance_by_size(6, k, chance) for k in range(7)])[size])


# A spinning antenna ---------------------------------------------------------------------------------------------------

_TURN_RAD: Final = 0.05 * np.pi
_PAIR: Final[dict[str, Any]] = {"radius_cyc": 0.5, "sigma_cyc": 0.01 * np.sqrt(2.0)}
_ONE: Final[dict[str, Any]] = {"radius_cyc": 0.5, "sigma_cyc": 0.01}
_SAMPLES: Final = 60


def pair_of_spinning(test: str) -> Draw:
    """The difference of two signals of one antenna; `full` with a drift and a curvature besides."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        angle, t = arm_angles(_SAMPLES, _TURN_RAD), np.arange(_SAMPLES) / 10.0
        phase = _PAIR["sigma_cyc"] * rng.standard_normal((n, _SAMPLES))
        if test == "paper":
            return chi_square_survival(fit_pairs(phase, angle, **_PAIR).statistic, 2)
        phase = phase + 0.7 * rng.standard_normal((n, 1)) * t + 0.05 * rng.standard_normal((n, 1)) * t**2
        return chi_square_survival(fit_whole_series(phase, angle, **_PAIR).statistic, 2)

    return draw


def spinning(*, direction_known: bool) -> Draw:
    """The paper's rule for "from one antenna" on an authentic pair 7 degrees apart; its noncentrality known, or the
    estimate put in its place."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        angle = arm_angles(150, _TURN_RAD)
        information = pair_information(angle, **_PAIR)
        apart = direction_cosines(*np.radians([155.0, 50.0]))[:2] - direction_cosines(*np.radians([160.0, 55.0]))[:2]
        level = apart + rng.standard_normal((n, 2)) @ np.linalg.inv(np.linalg.cholesky(information))
        statistic = np.sum((level @ information) * level, axis=-1)
        known = float(apart @ information @ apart)
        return np.asarray(special.chndtr(statistic, 2, known if direction_known else statistic))

    return draw


def signals_of_one_antenna(*, rate_known: bool = True) -> Draw:
    """Five signals under any receiver clock; the rate of the arm known, or estimated from the same phases."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        noise = 0.01 * rng.standard_normal((n, 5, _SAMPLES)) + 10.0 * rng.standard_normal((n, 1, _SAMPLES))
        angle = arm_angles(_SAMPLES, _TURN_RAD)
        covariance = np.linalg.inv(full_information(angle, **_ONE))
        if rate_known:
            return equal_p_value(fit_whole_series(subtract_mean(noise), angle, **_ONE).level, covariance)
        series = noise + 0.25 * np.cos(angle + 0.4)  # of the direction they have in common
        found = estimate_rate(series, _TURN_RAD, **_ONE, rate_sigma_rad=0.01 * _TURN_RAD)
        levels = [
            fit_whole_series(subtract_mean(one), arm_angles(_SAMPLES, rate), **_ONE).level
            for one, rate in zip(series, found.rate_rad, strict=True)
        ]
        return equal_p_value(np.array(levels), covariance)

    return draw


def predicted(*, start_known: bool) -> Draw:
    """Eight signals from where they should come."""
    level = _UNITS[:, :2]

    def draw(rng: np.random.Generator, n: int) -> Reals:
        information = full_information(arm_angles(_SAMPLES, _TURN_RAD), **_ONE)
        root = np.linalg.inv(np.linalg.cholesky(information))
        seen = level + rng.standard_normal((n, 8, 2)) @ root
        test = compare_with_prediction(seen, level, information, start_known=start_known)
        return chi_square_survival(test.statistic, test.dof)

    return draw


# Generic tests --------------------------------------------------------------------------------------------------------


def gaussian_model(sigma: float | None) -> Draw:
    """Two columns tested beside a line, correlated noise of 20 values: chi-square, or F."""
    t = np.linspace(-1.0, 1.0, 20)
    steps = np.abs(np.subtract.outer(np.arange(20), np.arange(20)))
    covariance = 0.6**steps
    model = linear_model(np.column_stack([np.sin(3.0 * t), t**2]), np.column_stack([np.ones(20), t]), covariance)

    def draw(rng: np.random.Generator, n: int) -> Reals:
        nuisance = rng.normal(0.0, 50.0, (n, 2)) @ np.column_stack([np.ones(20), t]).T
        noise = 2.0 * rng.standard_normal((n, 20)) @ np.linalg.cholesky(covariance).T
        return linear_test(nuisance + noise, model, sigma).p_value

    return draw


def line_parts(apart: float) -> Draw:
    """Nine values of three means far apart: p-value of the number found, asked to be above 1e-9."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        values = np.resize(apart * np.arange(3.0), 9) + rng.standard_normal((n, 9))
        return divide_line(values, 1.0, 1e-9).p_value

    return draw


def too_many_parts(apart: float) -> Draw:
    """Nine values of three means: the smallest of some probabilities asked for at which more than three are found."""

    def draw(rng: np.random.Generator, n: int) -> Reals:
        values, p = np.resize(apart * np.arange(3.0), 9) + rng.standard_normal((n, 9)), np.ones(n)
        for asked in ASKED[::-1]:
            p[divide_line(values, 1.0, asked).number > 3] = asked
        return p

    return draw


def lag_one(rng: np.random.Generator, n: int) -> Reals:
    """Support of the right coefficient, 0.5, two series of 30."""
    return ar1_line(_tracks(rng, (n, 30, 2), phi=0.5), 0.5).support
