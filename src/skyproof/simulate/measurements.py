"""The same scene at the level of measurements: what receivers that track every copy would observe, without samples.

`geometry_of` does the work that does not depend on chance, once; `draw` adds noise, as often as windows are wanted;
`noise_of` gives many draws at once as bare arrays, for counts of errors.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.time import GPS_EPOCH
from skyproof.records import Instants, Observations, SignalId, SignalRef
from skyproof.simulate.heard import ReceiverSky, Scene
from skyproof.simulate.scenario import Scenario
from skyproof.simulate.sky import scene_of

__all__ = ["Geometry", "NoiseModel", "draw", "geometry_of", "noise_of", "observations_of"]

Reals = NDArray[np.float64]

_NOT_TRACKED = 1  # CELL_STATUS
_SHORT_S = 0.01
_SIMPSON = np.array([1.0, 4.0, 1.0]) / 6.0  # the mean over an epoch, exact for a cubic


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Errors of one channel's measurements.

    sigma_m : of the pseudorange at `reference_cn0_dbhz`; it changes with the root of the carrier-to-noise density, as
        thermal noise does.
    ar1 : correlation of the pseudorange error from one epoch to the next (0 is white); its variance stays the same.
    constant_m : sigma of one further error per channel that stays the same over the window.
    carrier_sigma_cyc, doppler_sigma_hz : white, at `reference_cn0_dbhz`.
    """

    sigma_m: float = 0.5
    reference_cn0_dbhz: float = 45.0
    ar1: float = 0.0
    constant_m: float = 0.0
    carrier_sigma_cyc: float = 0.01
    doppler_sigma_hz: float = 0.05

    def growth(self, cn0_dbhz: Reals) -> Reals:
        """How much larger thermal noise is than at the reference, any shape."""
        return np.asarray(10.0 ** ((self.reference_cn0_dbhz - cn0_dbhz) / 20.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class Geometry:
    """One receiver's measurements without noise: (n_epochs, n_signals), NaN while a signal is not there."""

    receiver: str
    signals: tuple[SignalId, ...]
    labels: tuple[str, ...]
    gpst: Instants
    elapsed_s: Reals
    pseudorange_m: Reals
    carrier_cyc: Reals
    doppler_hz: Reals
    cn0_dbhz: Reals
    averaged_s: float
    carrier_hz: float

    @property
    def there(self) -> NDArray[np.bool_]:
        return np.isfinite(self.pseudorange_m)


def observations_of(
    scenario: Scenario, navigation: NavigationData, *, rng: np.random.Generator, interval_s: float = 1.0,
    noise: NoiseModel | None = None, shuffle_copies: bool = False,
) -> tuple[tuple[Observations, ...], dict[SignalRef, str]]:  # fmt: skip
    """Observations of every receiver of a scene, and the label ("authentic", "spoofed") of each of their signals.

    Raises ScenarioError as `scene_of` does. See `draw` for `noise` and `shuffle_copies`.
    """
    geometries = geometry_of(scene_of(scenario, navigation), interval_s=interval_s)
    return draw(geometries, rng=rng, noise=noise, shuffle_copies=shuffle_copies)


def geometry_of(scene: Scene, *, interval_s: float = 1.0) -> tuple[Geometry, ...]:
    """Measurements without noise, at the times when each receiver's clock shows a whole multiple of `interval_s`.

    An epoch is a mean over `interval_s`, centred on it, so it needs that much of the recording around it. Receivers
    share the labels, while their true times differ by their clock errors.
    """
    return tuple(_geometry(scene, sky, interval_s) for sky in scene.skies)


def draw(
    geometries: Sequence[Geometry], *, rng: np.random.Generator, noise: NoiseModel | None = None,
    shuffle_copies: bool = False,
) -> tuple[tuple[Observations, ...], dict[SignalRef, str]]:  # fmt: skip
    """One window of noisy observations per receiver, and the labels of the signals in them.

    Copy "a" is authentic and "b" on false, unless `shuffle_copies`: then the letters of each satellite's copies are
    dealt anew in each receiver, so that they say nothing.
    """
    noise = noise if noise is not None else NoiseModel()
    observations: list[Observations] = []
    labels: dict[SignalRef, str] = {}
    for geometry in geometries:
        copies = _dealt_anew(geometry.signals, rng) if shuffle_copies else geometry.signals
        order = sorted(range(len(copies)), key=lambda column: copies[column])
        drawn = _observations(geometry, noise, rng, [copies[column] for column in order], order)
        observations.append(drawn)
        labels |= {SignalRef(geometry.receiver, copies[column]): geometry.labels[column] for column in order}
    return tuple(observations), labels


def noise_of(geometry: Geometry, noise: NoiseModel, *, rng: np.random.Generator, draws: tuple[int, ...] = ()) -> Reals:
    """Errors of the pseudorange in metres, shape (*draws, n_epochs, n_signals): stationary AR(1) and a constant."""
    sigma_m = noise.sigma_m * noise.growth(geometry.cn0_dbhz)
    unit = rng.standard_normal((*draws, *sigma_m.shape))
    if noise.ar1:
        unit[..., 1:, :] *= np.sqrt(1.0 - noise.ar1**2)
        unit = lfilter([1.0], [1.0, -noise.ar1], unit, axis=-2)
    error_m = sigma_m * unit
    if noise.constant_m:
        error_m += noise.constant_m * rng.standard_normal((*draws, 1, sigma_m.shape[1]))
    return np.asarray(error_m)


def _geometry(scene: Scene, sky: ReceiverSky, interval_s: float) -> Geometry:
    receiver, carrier_hz, half_s = sky.receiver, sky.signal.carrier_hz, 0.5 * interval_s
    shown_at_start_s = receiver.start_offset_s + receiver.clock_offset_s  # by its own clock
    start_ns = (scene.scenario.start_gpst - GPS_EPOCH).astype(np.int64)
    off_grid_s = float(start_ns % round(interval_s * 1e9)) * 1e-9
    first = int(np.ceil((off_grid_s + shown_at_start_s + half_s) / interval_s))
    last = int(np.floor((off_grid_s + shown_at_start_s + scene.scenario.duration_s - half_s) / interval_s))
    shown_s: Reals = interval_s * np.arange(first, last + 1, dtype=np.float64) - off_grid_s  # since the scene's start
    elapsed_s = shown_s - shown_at_start_s

    # ends and middle of each epoch's mean; its true time is what has elapsed and a small number
    knots_s = elapsed_s + half_s * np.array([[-1.0], [0.0], [1.0]])
    late_s = sky.true_minus_elapsed_s(knots_s)
    true_s = knots_s + late_s
    clock_s = shown_at_start_s - late_s[1, :, np.newaxis]  # shown minus true time
    code_s, carrier_s = (_SIMPSON @ delay_s.reshape(3, -1) for delay_s in sky.delays_s(true_s.ravel()))
    drift = _drift(sky, elapsed_s)

    there = np.stack(
        [sum((begin <= true_s[0]) & (true_s[2] <= end) for begin, end in h.windows_s) > 0 for h in sky.signals], axis=1
    )
    kept = np.flatnonzero(there.any(axis=0))
    hidden = np.where(there, 0.0, np.nan)
    cell = clock_s.shape[0], len(sky.signals)
    carrier_cyc = carrier_hz * (clock_s + carrier_s.reshape(cell)) + hidden
    start_cyc = np.array([column[np.isfinite(column)][:1].sum() for column in carrier_cyc.T])
    return Geometry(
        receiver=sky.name,
        signals=tuple(sky.signals[column].id for column in kept),
        labels=tuple(sky.signals[column].label for column in kept),
        gpst=scene.scenario.start_gpst + np.rint(shown_s * 1e9).astype("timedelta64[ns]"),
        elapsed_s=elapsed_s,
        pseudorange_m=(SPEED_OF_LIGHT_M_S * (clock_s + code_s.reshape(cell)) + hidden)[:, kept],
        carrier_cyc=(carrier_cyc - np.rint(start_cyc))[:, kept],
        doppler_hz=(-carrier_hz * drift + hidden)[:, kept],
        cn0_dbhz=(sky.cn0_dbhz(true_s[1]) + hidden)[:, kept],
        averaged_s=interval_s,
        carrier_hz=carrier_hz,
    )


def _drift(sky: ReceiverSky, elapsed_s: Reals) -> Reals:
    """By how much the carriers' delays grow in a second of the receiver's clock, against its own, (n, n_signals)."""
    shown_s = elapsed_s + _SHORT_S * np.array([[-1.0], [1.0]])
    late_s = sky.true_minus_elapsed_s(shown_s)
    delay_s = sky.carrier_delay_s(shown_s + late_s) - late_s[..., np.newaxis]
    return np.asarray((delay_s[1] - delay_s[0]) / (2.0 * _SHORT_S))


def _observations(
    geometry: Geometry, noise: NoiseModel, rng: np.random.Generator, signals: Sequence[SignalId], order: Sequence[int]
) -> Observations:
    """`signals` are the names of the geometry's columns `order`."""
    growth = noise.growth(geometry.cn0_dbhz)
    shape = growth.shape
    pseudorange_m = geometry.pseudorange_m + noise_of(geometry, noise, rng=rng)
    carrier_cyc = geometry.carrier_cyc + noise.carrier_sigma_cyc * growth * rng.standard_normal(shape)
    doppler_hz = geometry.doppler_hz + noise.doppler_sigma_hz * growth * rng.standard_normal(shape)
    columns = np.asarray(order, dtype=np.intp)
    there = geometry.there[:, columns]
    first = there.argmax(axis=0)
    found_s = geometry.elapsed_s[first] - 0.5 * geometry.averaged_s
    return Observations(
        receiver=geometry.receiver,
        signals=tuple(signals),
        gpst=geometry.gpst,
        elapsed_s=geometry.elapsed_s,
        pseudorange_m=pseudorange_m[:, columns],
        carrier_cyc=carrier_cyc[:, columns],
        doppler_hz=doppler_hz[:, columns],
        cn0_dbhz=geometry.cn0_dbhz[:, columns],
        pseudorange_sigma_m=(noise.sigma_m * growth)[:, columns],
        carrier_sigma_cyc=(noise.carrier_sigma_cyc * growth)[:, columns],
        doppler_sigma_hz=(noise.doppler_sigma_hz * growth)[:, columns],
        status=np.where(there, 0, _NOT_TRACKED).astype(np.uint8),
        found_elapsed_s=found_s,
        missed_elapsed_s=np.where(first > 0, found_s - geometry.averaged_s, np.nan),
        carrier_hz=np.full(len(signals), geometry.carrier_hz),
        averaged_s=geometry.averaged_s,
    )


def _dealt_anew(signals: Sequence[SignalId], rng: np.random.Generator) -> list[SignalId]:
    """The same satellites with the letters a, b, ... in a random order among each satellite's copies."""
    dealt = list(signals)
    for sat in sorted({signal.sat for signal in signals}):
        columns = [column for column, signal in enumerate(signals) if signal.sat == sat]
        for column, letter in zip(columns, rng.permutation(len(columns)), strict=True):
            dealt[column] = replace(signals[column], copy=chr(ord("a") + int(letter)))
    return dealt
