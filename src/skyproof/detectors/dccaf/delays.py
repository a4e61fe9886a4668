"""Estimate one delay or two of each satellite, from the correlation grids of a window.

What is decided about a window rests on one burst, in which delays hardly move. Whether a satellite has a second signal
at all is also asked of all bursts together: a false signal within a tenth of a chip of the true one is rarely seen in
one burst, and by turning phases in several.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special

from skyproof.arrays import Booleans, Integers, Reals
from skyproof.decomposition.fit import combine_bins, taps_dictionary
from skyproof.detectors.dccaf.bursts import Decomposed, build_shapes, fit_components, joint_p_value, whiten_taps
from skyproof.errors import require_probability
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import prn_of
from skyproof.records import Ccaf

__all__ = ["DccafSettings", "Delays", "estimate_delays", "last_burst", "select_second_signals", "split_bursts"]


@dataclass(frozen=True)
class DccafSettings:
    """Settings of `Dccaf`.

    false_alarm_probability : of a receiver's window.
    second_signal_probability : that a satellite alone is said to have two signals, divided by the number of satellites.
    no_reflection_probability : that a satellite seems to have a second signal that is earlier, or not weaker by 3 dB,
        without an attack. Of satellites with two reflections each, 3 to 20 dB weaker, it is one in thirteen at most,
        with three one in six: street canyons.
    set_probability : that a true set fails its chi-square test.
    wrong_choice_probability : that two skies which are handed on for a choice are not those that are there.
    multipath_sigma_m, ionosphere_share : as for `residual`.
    window_chips : delays are searched this far to both sides of the reference.
    """

    false_alarm_probability: float = 1e-3
    second_signal_probability: float = 0.01
    no_reflection_probability: float = 0.15
    set_probability: float = 1e-3
    wrong_choice_probability: float = 1e-3
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25
    window_chips: float = 1.3

    def __post_init__(self) -> None:
        for name in (
            "false_alarm_probability",
            "second_signal_probability",
            "no_reflection_probability",
            "set_probability",
            "wrong_choice_probability",
        ):
            require_probability("dccaf", name, getattr(self, name))


class Delays(NamedTuple):
    """delay_chips, sigma_chips (channels, 2): NaN for a second signal that is not there. Strongest first. p_value
    (channels,) of "one signal"; unlike_p_value (channels,) of "one signal, or a signal and its reflection".
    decomposed : the channels, from the mean of the burst's zeros, which lies `moved_chips` (channels,) after that of
    the last epoch."""

    delay_chips: Reals
    sigma_chips: Reals
    p_value: Reals
    unlike_p_value: Reals
    decomposed: Mapping[int, Decomposed]
    moved_chips: Reals


def last_burst(ccaf: Ccaf) -> Integers:
    """Return the epochs of the last burst, of those with most channels; none without any."""
    whole = _is_complete(ccaf)
    if not whole.any():
        return np.empty(0, np.int64)
    runs = split_bursts(ccaf)
    counts = np.array([int(whole[run].all(axis=0).sum()) for run in runs])
    return runs[int(np.flatnonzero(counts == counts.max())[-1])]


def split_bursts(ccaf: Ccaf) -> list[Integers]:
    """Divide the epochs into bursts."""
    first = np.flatnonzero(np.diff(ccaf.elapsed_s, prepend=-np.inf) > 1.5 * ccaf.coherent_s)
    return np.split(np.arange(ccaf.elapsed_s.size), first[1:])


def _is_complete(ccaf: Ccaf) -> Booleans:
    """Find complete grids (n_epochs, n_channels), with all values that belong to them."""
    finite = np.isfinite(ccaf.value).all(axis=(2, 3)) & np.isfinite(ccaf.noise_variance)
    return np.asarray(finite & np.isfinite(ccaf.reference_m))


def estimate_delays(ccaf: Ccaf, epochs: Integers, settings: DccafSettings) -> Delays:
    """Estimate one or two delays of each known code over a burst, from the reference of its last epoch."""
    n, whole = len(ccaf.signals), _is_complete(ccaf)[epochs].all(axis=0)
    whole = whole & np.array([signal.plan.has_code for signal in ccaf.signals], np.bool_)
    delay, sigma = np.full((n, 2), np.nan), np.full((n, 2), np.nan)
    p_value, unlike = np.full((2, n), np.nan)
    decomposed: dict[int, Decomposed] = {}
    moved = _zero_motion_chips(ccaf, epochs)
    for row in np.flatnonzero(whole).tolist():
        decomposed[row] = _decompose(ccaf, epochs, row, settings)
        found, law = decomposed[row].found, (len(epochs), decomposed[row].shapes.path, ccaf.noise_samples)
        p_value[row] = joint_p_value(found.second, *law)[0]
        unlike[row] = joint_p_value(found.unlike, *law)[0]
        delay[row, 0], sigma[row, 0] = found.one_chips[0], found.one_sigma[0]
        if p_value[row] < settings.second_signal_probability / whole.sum():
            delay[row], sigma[row] = found.two_chips[0], np.sqrt(found.two_variance[0])
    return Delays(delay + moved[:, None], sigma, p_value, unlike, decomposed, moved)


def select_second_signals(found: Delays, others: Sequence[Delays], settings: DccafSettings) -> Booleans:
    """Select the channels in `found` (n_channels,) that show a second signal, in that burst or together with `others`.

    Half of `second_signal_probability` goes to either. The noise of bursts is independent. So minus twice the sum of
    the logarithms of n p-values is chi-square of 2 n at most (Fisher).
    """
    estimated = np.isfinite(found.p_value)
    p_values = np.stack([found.p_value, *(other.p_value for other in others)])
    count = np.isfinite(p_values).sum(axis=0)
    logs = np.nansum(np.log(np.maximum(p_values, 1e-300)), axis=0)
    together = special.chdtrc(2.0 * np.maximum(count, 1), -2.0 * logs)
    level = 0.5 * settings.second_signal_probability / max(int(estimated.sum()), 1)
    return np.asarray(estimated & ((found.p_value < level) | (together < level)))


def _decompose(ccaf: Ccaf, epochs: Integers, row: int, settings: DccafSettings) -> Decomposed:
    """Decompose one channel over a burst."""
    points, signal = tuple(float(x) for x in ccaf.delays_chips), ccaf.signals[row]
    grid = np.asarray(ccaf.value[epochs, row], np.complex128)
    noise = np.asarray(ccaf.noise_variance[epochs, row], np.float64)
    taps = grid[:, 0]
    if ccaf.dopplers_hz.size > 1:
        table = taps_dictionary(points, ccaf.band_hz, signal.plan, window_chips=settings.window_chips)
        taps, factor, _ = combine_bins(grid, table, ccaf.dopplers_hz, ccaf.coherent_s)
        noise = factor * noise
    code_shapes = build_shapes(signal.plan, prn_of(signal.sat), points, ccaf.band_hz, settings.window_chips)
    return Decomposed(
        whiten_taps(taps, code_shapes, noise), code_shapes, fit_components(taps[None], code_shapes, noise[None])
    )


def _zero_motion_chips(ccaf: Ccaf, epochs: Integers) -> Reals:
    """Compute how far the mean of the grids' zeros over a burst lies after that of its last epoch (n_channels,).

    The carrier's motion is removed: the loop may move the zero from interval to interval.
    """
    after_s = (ccaf.elapsed_s[epochs] - ccaf.elapsed_s[epochs[-1]])[:, None]
    plans = [signal.plan for signal in ccaf.signals]
    chip_m = np.array([plan.chip_m for plan in plans])
    wavelength_m = SPEED_OF_LIGHT_M_S / np.array([plan.carrier_hz for plan in plans])
    way_m = -ccaf.reference_hz[epochs] * wavelength_m * after_s
    return np.asarray(np.mean(ccaf.reference_m[epochs] - way_m - ccaf.reference_m[epochs[-1]], axis=0) / chip_m)
