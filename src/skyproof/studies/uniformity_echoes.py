"""Second signals by reflections alone, drawn from what the echo model says, without its grid."""

from typing import Final

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.second_signals.echoes import EchoModel, Second, echo_p_value, false_over_echo
from skyproof.detectors.second_signals.policy import POLICY as SECOND_SIGNALS
from skyproof.gnss.signals import GPS_L1_CA
from skyproof.statistics.many_small import many_small

__all__ = ["drawn_seconds", "echo_delays_m", "echoes_of_ten"]

_SHAPE: Final = (2.62, 2.77, 2.81, 2.56, 2.47, 2.40)  # of delays, by elevations of 15 degrees each
_SCALE_M: Final = (129.83, 105.52, 80.93, 65.12, 53.22, 43.24)
_APART_HZ: Final = np.array([0.0, 300.0, 1000.0])
_SATS: Final = 10


def drawn_seconds(
    rng: np.random.Generator, model: EchoModel, below_db: Reals, elevation_deg: Reals
) -> list[tuple[int, Second]]:
    """Second signals that are looked at of satellites (n,): number of the satellite, and what it is beside its direct
    one, which is `below_db` under the strongest."""
    n = below_db.size
    sat = np.repeat(np.arange(n), rng.poisson(model.echoes_per_satellite, n))
    m = sat.size
    late_m = echo_delays_m(rng, model, elevation_deg[sat])
    blocked_db = _draw_blocked_db(rng, model, below_db[sat] + model.gain_db)
    rough_db = -12.35 - 0.0016 * late_m + 10.0 * np.log10(rng.exponential(size=m))
    smooth_db = rng.uniform(-model.most_weaker_db, model.gain_db, m)
    over_db = np.where(rng.random(m) < model.smooth_share, smooth_db, rough_db) + blocked_db
    apart_hz = rng.choice(_APART_HZ, m, p=(0.95, 0.05 - 1e-6, 1e-6))
    odd = np.flatnonzero(rng.random(n) < model.unexplained_probability)
    reach_m = np.where(rng.random(odd.size) < 0.5, 3000.0, 150e3)
    sat, late_m = np.append(sat, odd), np.append(late_m, reach_m * rng.uniform(-1.0, 1.0, odd.size))
    over_db = np.append(over_db, rng.uniform(-12.0, 30.0, odd.size))
    apart_hz = np.append(apart_hz, rng.choice(_APART_HZ, odd.size, p=(0.7, 0.15, 0.15)))
    seen = np.flatnonzero((late_m > model.least_delay_chips * GPS_L1_CA.chip_m) & (over_db > -model.most_weaker_db))
    return [
        (
            int(sat[k]),
            Second(
                float(late_m[k]),
                float(over_db[k]),
                float(apart_hz[k]),
                float(below_db[sat[k]]),
                GPS_L1_CA.chip_m,
                float(np.radians(elevation_deg[sat[k]])),
            ),
        )
        for k in seen
    ]


def echo_delays_m(rng: np.random.Generator, model: EchoModel, elevation_deg: Reals) -> Reals:
    """Draw how late echoes of satellites at these elevations (m,) come."""
    m = elevation_deg.size
    kind = np.minimum(elevation_deg // 15.0, 5).astype(int)
    near_m = rng.gamma(np.take(_SHAPE, kind), np.take(_SCALE_M, kind))
    return np.where(rng.random(m) < model.far_share, rng.uniform(0.0, 4500.0, m), near_m)


def _draw_blocked_db(rng: np.random.Generator, model: EchoModel, most_db: Reals) -> Reals:
    """By how much each direct signal is blocked, at most `most_db`; drawn again until it is."""
    found = np.full(most_db.size, np.nan)
    while (blocked := np.flatnonzero(np.isnan(found))).size:
        drawn = rng.normal(model.blocked_db, model.blocked_sigma_db, blocked.size)
        drawn = np.where(rng.random(blocked.size) < model.blocked_share, drawn, 0.0)
        found[blocked] = np.where((drawn >= 0.0) & (drawn <= most_db[blocked]), drawn, np.nan)
    return found


def echoes_of_ten(rng: np.random.Generator, n: int) -> Reals:
    """Windows of ten satellites at 5 to 75 degrees, whose direct signals lie up to 10 dB below the strongest."""
    model = EchoModel()
    elevation_deg = np.tile(np.linspace(5.0, 75.0, _SATS), n)
    below_db = np.tile(np.linspace(10.0, 0.0, _SATS), n)
    p_values = np.ones(n * _SATS)
    for sat, second in drawn_seconds(rng, model, below_db, elevation_deg):
        ratio = false_over_echo(model, second)
        echoes = echo_p_value(model, ratio, second)
        p_values[sat] = min(p_values[sat], echoes)
    return np.array(
        [
            many_small(echoes, least=SECOND_SIGNALS.attack_satellites, most=SECOND_SIGNALS.telling_p_value).p_value
            for echoes in p_values.reshape(n, _SATS)
        ]
    )
