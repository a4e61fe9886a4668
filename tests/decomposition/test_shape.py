"""What one code looks like in correlators behind a receiver's own low-pass."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyproof.decomposition.shape import code_dictionary, filter_loss, quiet_lags
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.studies.decomposition_laws import delay_dictionary

BAND = 2.4  # cycles a chip
TAPS = np.arange(-10, 11) * 0.2


def low_pass(cycles):
    return np.clip(1.5 - cycles / BAND * 1.5, 0.0, 1.0)


def narrow(cycles):
    return np.exp(-(cycles**2))


def direct(code, lag, weight):
    """The sum over the code's lines, one by one."""
    line = np.arange(-int(BAND * code.size), int(BAND * code.size) + 1)
    power = np.abs(np.fft.fft(code))[line % code.size] ** 2 * np.sinc(line / code.size) ** 2
    curve = power * weight(np.abs(line) / code.size)
    return np.cos(2 * np.pi * np.multiply.outer(lag, line / code.size)) @ curve / curve.sum()


@pytest.mark.parametrize("front_end", [None, narrow], ids=["open", "filtered"])
def test_signals_look_as_the_sum_over_the_lines_of_the_code_says(front_end):
    code = GPS_L1_CA.code(7)
    dictionary = code_dictionary(code, TAPS, low_pass, front_end, band_cycles=BAND)

    def passed(cycles):
        return low_pass(cycles) * (1.0 if front_end is None else front_end(cycles))

    for delay in (-1.53, -0.4137, 0.0, 0.2619, 1.6):
        value, slope = dictionary.at(delay)
        seen = dictionary.whiten @ direct(code, TAPS - delay, passed)
        np.testing.assert_allclose(value, seen, atol=2e-4 * np.linalg.norm(seen))
        step = 1e-4
        change = direct(code, TAPS - delay - step, passed) - direct(code, TAPS - delay + step, passed)
        numeric = dictionary.whiten @ change / (2 * step)
        np.testing.assert_allclose(slope, numeric, atol=2e-3 * np.linalg.norm(numeric))


def test_the_noise_is_white_behind_the_whitening():
    code = GPS_L1_CA.code(7)
    dictionary = code_dictionary(code, TAPS, low_pass, narrow, band_cycles=BAND)
    noise = direct(code, TAPS[:, None] - TAPS, lambda cycles: (low_pass(cycles) * narrow(cycles)) ** 2)
    covariance = dictionary.whiten @ noise @ dictionary.whiten.T
    np.testing.assert_allclose(covariance, np.eye(len(covariance)), atol=1e-3)


@given(delay=st.floats(-1.3, 1.3))
def test_a_dictionary_is_read_between_its_points(delay):
    dictionary = delay_dictionary(10e6)
    value, slope = dictionary.at(delay)
    left, right = (dictionary.at(np.clip(delay + step, -1.3, 1.3)) for step in (-1e-5, 1e-5))
    width = np.clip(delay + 1e-5, -1.3, 1.3) - np.clip(delay - 1e-5, -1.3, 1.3)
    np.testing.assert_allclose(slope, (right[0] - left[0]) / width, atol=1e-3 * np.linalg.norm(slope) + 1e-6)
    assert np.linalg.norm(value) == pytest.approx(1.0, abs=0.05)


def test_nothing_is_lost_of_cn0_where_all_passes_and_more_behind_a_filter():
    wide = filter_loss(lambda cycles: np.ones_like(cycles), band_cycles=400.0)
    assert wide == pytest.approx(1.0, abs=1e-3)
    assert filter_loss(low_pass, band_cycles=BAND) < 0.96


def test_quiet_lags_are_those_without_side_lobes_nearby():
    code = GPS_L1_CA.code(19)
    lags = quiet_lags(code, 4, clear_chips=2)
    for lag in lags:
        for near in range(lag - 2, lag + 3):
            assert abs(int(code.astype(int) @ np.roll(code, near).astype(int))) <= 1


def test_more_quiet_lags_than_there_are_is_an_error_that_says_so():
    with pytest.raises(ValueError, match="500 are needed"):
        quiet_lags(GPS_L1_CA.code(7), 500)
