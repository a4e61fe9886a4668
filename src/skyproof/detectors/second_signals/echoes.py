"""Model how reflections make second signals of a satellite, and how rarely one is like a given second signal.

The model is that of dense urban canyons, the worst that is measured:

- an echo is late by a gamma law whose scale falls with the satellite's elevation. It is weaker by 12.35 dB and 0.0016
dB
  per metre in the mean. Source: X. Chen, D. He, L. Pei, Satellite Navigation 1:26, 2020, doi
  10.1186/s43020-020-00027-7, table 1;
- its Doppler is that of reflectors at up to 50 m/s, or of an antenna that moves so.

Assumed here, on the careful side, without a source. Such channels were measured by A. Jahn, H. Bischl, G. Heiss, ISSSTA
1996, and E. Lutz and others, IEEE Trans. Veh. Technol. 40(2), 1991, doi 10.1109/25.289418. Their tables are not quoted:

- about the mean an echo's power is exponential, a Rayleigh amplitude, and one in a hundred comes from far, up to 15 us
  late;
- the direct signal is blocked 60 % of the time, by about 12 dB with a sigma of 4 dB. It is blocked by no more than it
  lies below the receiver's strongest direct signal, and some dB for antenna gains;
- a tenth of the echoes come from faces of metal or glass. Their levels are equally likely down to 12 dB below the
  unblocked direct signal;
- one satellite in a thousand has a second signal that no echo explains.

A false signal may be earlier or later, weaker or stronger, each as likely over wide ranges. Second signals are ordered
by their likelihood ratio of "false" over "an echo"; a satellite's p-value is the probability that it has one of a ratio
at least as large, by the model.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy import special

from skyproof.arrays import Reals
from skyproof.detectors.second_signals.policy import POLICY

__all__ = ["EchoModel", "Second", "echo_p_value", "false_over_echo"]

_BLOCKED_DB = np.arange(0.0, 30.5, 0.5)
_OVER_DB = np.arange(-11.75, 30.0, 0.5)
_NEVER_LOG = 50.0  # exp(-exp(50)) is 0


@dataclass(frozen=True)
class EchoModel:
    """Parameters of the model that no source gives for every place.

    echoes_per_satellite : of those that the delays' law describes, at any time, in the mean.
    blocked_share : of the time, of the direct signal; blocked_db, blocked_sigma_db : by how much.
    gain_db : by which an antenna may receive the echo's direction better than the satellite's.
    smooth_share : of echoes from metal or glass.
    far_share : of echoes as likely late by anything up to 15 us.
    unexplained_probability : that a satellite has a second signal that is none of these.
    early_share : of echoes that were taken for the direct signal, which is then the second one, and early.
    least_delay_chips, most_weaker_db : of second signals that are looked at.
    """

    echoes_per_satellite: float = 1.0
    blocked_share: float = 0.6
    blocked_db: float = 12.0
    blocked_sigma_db: float = 4.0
    gain_db: float = 3.0
    smooth_share: float = 0.1
    far_share: float = 0.01
    unexplained_probability: float = 1e-3
    early_share: float = 0.0
    least_delay_chips: float = 1.5
    most_weaker_db: float = 12.0


class Second(NamedTuple):
    """A satellite's second signal beside the direct one.

    late_m : after it; negative if before. over_db : over its C/N0. apart_hz : of their Dopplers. below_db : of the
    direct one under the receiver's strongest direct signal. chip_m : of their code. elevation_rad : of the satellite;
    NaN if not known.
    """

    late_m: float
    over_db: float
    apart_hz: float
    below_db: float
    chip_m: float
    elevation_rad: float = float("nan")


def false_over_echo(model: EchoModel, second: Second) -> float:
    """Compute the likelihood ratio of "false" over "an echo, or what no echo explains".

    The latter has its stated probability.

    It is at most the inverse of `EchoModel.unexplained_probability`. Without a delay the Doppler alone counts.
    """
    kind = int(np.searchsorted(POLICY.doppler_edges_hz, abs(second.apart_hz))) if np.isfinite(second.apart_hz) else 0
    over = np.array([second.over_db])
    if not np.isfinite(second.late_m):
        ratio = POLICY.false_doppler_shares[kind] / (
            model.echoes_per_satellite * POLICY.echo_doppler_shares[kind]
            + model.unexplained_probability * POLICY.false_doppler_shares[kind]
        )
        return float(ratio)
    late = np.array([second.late_m])
    false = _false_delay(late)[:, None] * _false_level(over)[None]
    echo = _echo_density(model, late, over, second.below_db, _elevation_class(second.elevation_rad))
    return float(_ratio(model, echo, false, kind)[0, 0])


def echo_p_value(model: EchoModel, ratio: float, second: Second) -> float:
    """Compute the probability that a satellite of this direct signal and elevation has so false a second signal.

    That is one with this ratio of `false_over_echo` or more.
    """
    below_db = int(np.ceil(np.clip(second.below_db, 0.0, POLICY.headroom_db)))
    ratios, survival = _tabulate_law(model, second.chip_m, below_db, _elevation_class(second.elevation_rad))
    place = int(np.searchsorted(ratios, ratio * (1.0 - 1e-9)))
    return float(survival[max(place - 1, 0)])  # of the cell that it lies in


# ----------------------------------------------------------------------------------------------------------- densities


def _ratio(model: EchoModel, echo: Reals, false: Reals, doppler: int) -> Reals:
    """Compute the ratio of densities (n, m) over delay and level, with the Doppler of this class."""
    of_false = false * POLICY.false_doppler_shares[doppler]
    of_echo = (
        model.echoes_per_satellite * echo * POLICY.echo_doppler_shares[doppler]
        + model.unexplained_probability * of_false
    )
    return np.asarray(of_false / of_echo)


def _elevation_class(elevation_rad: float) -> int:
    if not np.isfinite(elevation_rad):
        return 0
    return int(np.clip(np.degrees(elevation_rad) // POLICY.elevation_class_deg, 0, len(POLICY.delay_shapes) - 1))


def _delay_density(model: EchoModel, late_m: Reals, elevation: int) -> Reals:
    """Compute the density of an echo's delay, per metre; 0 of early ones."""
    shape, scale_m = POLICY.delay_shapes[elevation], POLICY.delay_scales_m[elevation]
    x = np.maximum(late_m, 1e-9) / scale_m
    near = np.exp((shape - 1.0) * np.log(x) - x - special.gammaln(shape)) / scale_m
    far = (late_m <= POLICY.far_echo_m) / POLICY.far_echo_m
    return np.where(late_m > 0.0, (1.0 - model.far_share) * near + model.far_share * far, 0.0)


def _level_density(model: EchoModel, over_db: Reals, late_m: Reals, below_db: float) -> Reals:
    """Compute the density (n, m) of an echo's level over the direct signal, per dB, at each delay."""
    blocked = np.exp(-0.5 * ((_BLOCKED_DB - model.blocked_db) / model.blocked_sigma_db) ** 2)
    blocked *= model.blocked_share / blocked.sum()
    reach_db = np.inf if below_db >= POLICY.headroom_db else max(below_db, 0.0) + model.gain_db
    weight = np.where(reach_db >= _BLOCKED_DB, blocked, 0.0)
    weight[0] += 1.0 - model.blocked_share
    weight /= weight.sum()
    over = over_db[None, :, None] - _BLOCKED_DB
    mean_db = POLICY.echo_level_db + POLICY.echo_fall_db_m * late_m
    # An echo from 100 km has no power left, and any level is beyond it: above `_NEVER_LOG` the density is 0.
    power_log = np.minimum((np.log(10.0) / 10.0) * (over - mean_db[:, None, None]), _NEVER_LOG)
    rough = np.exp(power_log - np.exp(power_log)) * (np.log(10.0) / 10.0)
    smooth = ((over >= -model.most_weaker_db) & (over <= model.gain_db)) / (model.most_weaker_db + model.gain_db)
    return np.asarray(((1.0 - model.smooth_share) * rough + model.smooth_share * smooth) @ weight)


def _echo_density(model: EchoModel, late_m: Reals, over_db: Reals, below_db: float, elevation: int) -> Reals:
    """Compute the density (n, m) of an echo over delay and level."""
    late = _delay_density(model, late_m, elevation)[:, None] * _level_density(model, over_db, np.abs(late_m), below_db)
    if model.early_share == 0.0:
        return late
    turned = _delay_density(model, -late_m, elevation)[:, None] * _level_density(
        model, -over_db, np.abs(late_m), POLICY.headroom_db
    )
    return np.asarray((1.0 - model.early_share) * late + model.early_share * turned)


def _false_delay(late_m: Reals) -> Reals:
    far = np.abs(late_m)
    near = (far <= POLICY.false_near_m) * (POLICY.false_near_share / (2.0 * POLICY.false_near_m))
    return np.asarray(near + (1.0 - POLICY.false_near_share) / (2.0 * POLICY.false_anywhere_m), float)


def _false_level(over_db: Reals) -> Reals:
    low, high = POLICY.false_levels_db
    return np.full(over_db.shape, 1.0 / (high - low))


# ----------------------------------------------------------------------------------------------------------------- law


@lru_cache(maxsize=512)
def _tabulate_law(model: EchoModel, chip_m: float, below_db: int, elevation: int) -> tuple[Reals, Reals]:
    """Compute likelihood ratios of cells of delay, level and Doppler, ascending.

    Also returned is the chance of each ratio or a larger one.
    """
    edges_m = np.geomspace(model.least_delay_chips * chip_m, POLICY.false_anywhere_m, 121)
    late_m, width_m = np.sqrt(edges_m[1:] * edges_m[:-1]), np.diff(edges_m)
    if model.early_share > 0.0:
        late_m, width_m = np.concatenate([-late_m[::-1], late_m]), np.concatenate([width_m[::-1], width_m])
    echo = _echo_density(model, late_m, _OVER_DB, float(below_db), elevation)
    false = _false_delay(late_m)[:, None] * _false_level(_OVER_DB)[None]
    cell = width_m[:, None] * (_OVER_DB[1] - _OVER_DB[0])
    ratios, chances = [], []
    for doppler in range(len(POLICY.doppler_edges_hz) + 1):
        ratios.append(_ratio(model, echo, false, doppler))
        chance = model.echoes_per_satellite * echo * POLICY.echo_doppler_shares[doppler]
        chances.append((chance + model.unexplained_probability * false * POLICY.false_doppler_shares[doppler]) * cell)
    ratio, chance = np.ravel(ratios), np.ravel(chances)
    order = np.argsort(ratio)
    return ratio[order], np.minimum(np.cumsum(chance[order][::-1])[::-1], 1.0)
