"""Simulate a scene at the level of measurements: what receivers that track every copy would observe.

`make_ideal_measurements` does the work that does not depend on chance, once; `draw` adds noise, as often as windows are
wanted; `draw_noise` gives many draws at once as bare arrays, for counts of errors.

Errors are white unless the noise model has more; signals of one satellite do not disturb each other unless the geometry
is asked for as receivers see it, `pulled`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from skyproof.arrays import Booleans, Instants, Integers, Reals
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.time import GPS_EPOCH, timedelta_from_s
from skyproof.records import CellStatus, Observations, SignalId, SignalRef
from skyproof.simulator.attacks import Meaconer
from skyproof.simulator.kinds import Kind
from skyproof.simulator.measurement_errors import Exposure, FieldError, FieldErrors, SignalPath, draw_field_errors
from skyproof.simulator.overlap_bias import compute_pull
from skyproof.simulator.platforms import Point
from skyproof.simulator.received import ReceivedSignal, ReceiverSky, Scene, select_ephemeris
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.sky import make_scene

__all__ = ["IdealMeasurements", "NoiseModel", "draw", "draw_noise", "make_ideal_measurements", "simulate_observations"]

_SHORT_S = 0.01


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Errors of one channel's measurements.

    sigma_m : of the pseudorange at `reference_cn0_dbhz`; it changes with the root of the carrier-to-noise density, as
        thermal noise does.
    ar1 : correlation of the pseudorange error from one epoch to the next (0 is white); its variance stays the same.
    constant_m : sigma of one further error per channel that stays the same over the window.
    carrier_sigma_cyc, doppler_sigma_hz : white, at `reference_cn0_dbhz`.
    field : reflections and air besides, on code and carrier; the sigmas that observations state know nothing of them.
    """

    sigma_m: float = 0.5
    reference_cn0_dbhz: float = 45.0
    ar1: float = 0.0
    constant_m: float = 0.0
    carrier_sigma_cyc: float = 0.01
    doppler_sigma_hz: float = 0.05
    field: FieldErrors | None = None

    def growth(self, cn0_dbhz: Reals) -> Reals:
        """Compute how much larger thermal noise is than at the reference, any shape."""
        return np.asarray(10.0 ** ((self.reference_cn0_dbhz - cn0_dbhz) / 20.0))


@dataclass(frozen=True, eq=False, kw_only=True)
class IdealMeasurements:
    """One receiver's measurements without noise: (n_epochs, n_signals), NaN while a signal is absent."""

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
    air_s: Reals  # the ionosphere's delay on L1
    carrier_hz: Reals  # (n_signals,)
    exposure: Exposure

    @property
    def present(self) -> Booleans:
        return np.isfinite(self.pseudorange_m)


def simulate_observations(
    scenario: Scenario,
    navigation: NavigationData,
    *,
    rng: np.random.Generator,
    interval_s: float = 1.0,
    noise: NoiseModel | None = None,
    shuffle_copies: bool = False,
    pulled: bool = False,
) -> tuple[tuple[Observations, ...], dict[SignalRef, str]]:
    """Simulate observations of every receiver of a scene, and label each of their signals.

    The labels are "authentic" and "spoofed".

    Raises ScenarioError as `make_scene` does. See `make_ideal_measurements` for `pulled`, `draw` for `noise` and
    `shuffle_copies`.
    """
    geometries = make_ideal_measurements(make_scene(scenario, navigation), interval_s=interval_s, pulled=pulled)
    return draw(geometries, rng=rng, noise=noise, shuffle_copies=shuffle_copies)


def make_ideal_measurements(
    scene: Scene, *, interval_s: float = 1.0, pulled: bool = False, kinds: Sequence[Kind] | None = None
) -> tuple[IdealMeasurements, ...]:
    """Make measurements without noise, when each receiver's clock shows a whole multiple of `interval_s`.

    An epoch is a mean over `interval_s`, centred on it, so it needs that much of the recording around it. Receivers
    share the labels, while their true times differ by their clock errors.

    pulled : whether other signals of the satellite and reflections pull each signal, by `overlap_bias.compute_pull`;
        else each is measured as if alone.
    kinds : what each satellite sends, and how each receiver delays it; the first signal of its system alone if absent.

    Raises ValueError for `kinds` with `pulled`: what overlaps is known on the band of the first signal only.
    """
    if pulled and kinds is not None:
        raise ValueError("pulled measurements have one kind of signal; leave kinds or pulled out")
    every = tuple(_make_geometry(scene, index, interval_s, pulled) for index in range(len(scene.skies)))
    return every if kinds is None else tuple(_expand_kinds(geometry, scene, kinds) for geometry in every)


def draw(
    geometries: Sequence[IdealMeasurements],
    *,
    rng: np.random.Generator,
    noise: NoiseModel | None = None,
    shuffle_copies: bool = False,
) -> tuple[tuple[Observations, ...], dict[SignalRef, str]]:
    """Draw one window of noisy observations per receiver, and the labels of the signals in them.

    Copy "a" is authentic and those from "b" on are false. With `shuffle_copies` the letters of each satellite's copies
    are dealt at random in each receiver, so that they carry no information.
    """
    noise = noise if noise is not None else NoiseModel()
    observations: list[Observations] = []
    labels: dict[SignalRef, str] = {}
    fields: Sequence[FieldError | None] = [None] * len(geometries)
    if noise.field is not None and geometries:
        exposures, first = [geometry.exposure for geometry in geometries], geometries[0]
        fields = draw_field_errors(noise.field, exposures, first.averaged_s, rng=rng)
    for geometry, field in zip(geometries, fields, strict=True):
        copies = _shuffle_copies(geometry.signals, rng) if shuffle_copies else geometry.signals
        order = sorted(range(len(copies)), key=lambda column: copies[column])
        drawn = _make_observations(geometry, noise, field, rng, [copies[column] for column in order], order)
        observations.append(drawn)
        labels |= {SignalRef(geometry.receiver, copies[column]): geometry.labels[column] for column in order}
    return tuple(observations), labels


def draw_noise(
    geometry: IdealMeasurements, noise: NoiseModel, *, rng: np.random.Generator, draws: tuple[int, ...] = ()
) -> Reals:
    """Draw errors of the pseudorange in metres, shape (*draws, n_epochs, n_signals).

    They are a stationary AR(1) process, a constant, and errors of the field.
    """
    error_m = _draw_code_noise_m(geometry, noise, rng, draws)
    if noise.field is not None:
        (field,) = draw_field_errors(noise.field, [geometry.exposure], geometry.averaged_s, rng=rng, draws=draws)
        error_m += field.code_m
    return error_m


def _draw_code_noise_m(
    geometry: IdealMeasurements, noise: NoiseModel, rng: np.random.Generator, draws: tuple[int, ...]
) -> Reals:
    sigma_m = noise.sigma_m * noise.growth(geometry.cn0_dbhz)
    unit = rng.standard_normal((*draws, *sigma_m.shape))
    if noise.ar1:
        unit[..., 1:, :] *= np.sqrt(1.0 - noise.ar1**2)
        unit = scipy.signal.lfilter([1.0], [1.0, -noise.ar1], unit, axis=-2)
    error_m = sigma_m * unit
    if noise.constant_m:
        error_m += noise.constant_m * rng.standard_normal((*draws, 1, sigma_m.shape[1]))
    return np.asarray(error_m)


def _make_geometry(scene: Scene, index: int, interval_s: float, pulled: bool) -> IdealMeasurements:
    sky = scene.skies[index]
    receiver, carrier_hz, half_s = sky.receiver, sky.signal.carrier_hz, 0.5 * interval_s
    shown_at_start_s = receiver.start_offset_s + receiver.clock_offset_s  # by its own clock
    start_ns = (scene.scenario.start_gpst - GPS_EPOCH).astype(np.int64)
    off_grid_s = float(start_ns % round(interval_s * 1e9)) * 1e-9
    first = int(np.ceil((off_grid_s + shown_at_start_s + half_s) / interval_s))
    last = int(np.floor((off_grid_s + shown_at_start_s + scene.scenario.duration_s - half_s) / interval_s))
    shown_s: Reals = interval_s * np.arange(first, last + 1, dtype=np.float64) - off_grid_s  # since the scene's start
    elapsed_s = shown_s - shown_at_start_s

    # knots are the middles and ends of the epochs' means; neighbours share ends
    knots_s = half_s * np.arange(2 * first - 1, 2 * last + 2, dtype=np.float64) - off_grid_s - shown_at_start_s
    late_s = sky.true_minus_elapsed_s(knots_s)
    known_s = knots_s + late_s
    true_s = known_s[:-1:2], known_s[1::2], known_s[2::2]
    clock_s = shown_at_start_s - late_s[1::2, np.newaxis]  # shown minus true time
    code_s, carrier_s = (
        (delay_s[:-1:2] + 4.0 * delay_s[1::2] + delay_s[2::2]) / 6.0 for delay_s in sky.delays_s(known_s)
    )  # Simpson's rule, exact for a cubic
    drift = _compute_drift(sky, elapsed_s)

    present = np.stack(
        [sum((begin <= true_s[0]) & (true_s[2] <= end) for begin, end in h.windows_s) > 0 for h in sky.signals], axis=1
    )
    kept = np.flatnonzero(present.any(axis=0))
    hidden = np.where(present, 0.0, np.nan)
    carrier_cyc = carrier_hz * (clock_s + carrier_s) + hidden
    pseudorange_m = SPEED_OF_LIGHT_M_S * (clock_s + code_s) + hidden
    noise = sky.noise_power(true_s[1]) + sky.line_power(true_s[1], scene.scenario.front_end.band_hz)
    doppler_hz = -carrier_hz * drift + hidden
    cn0_dbhz = sky.cn0_dbhz(true_s[1]) - 10.0 * np.log10(noise)[:, np.newaxis] + hidden
    if pulled:
        pull = compute_pull(scene, index, elapsed_s, averaged_s=interval_s)
        pseudorange_m += pull.code_m
        carrier_cyc += pull.carrier_cyc
        doppler_hz += pull.doppler_hz
        cn0_dbhz += pull.level_db
    start_cyc = np.array([column[np.isfinite(column)][:1].sum() for column in carrier_cyc.T])
    return IdealMeasurements(
        receiver=sky.name,
        signals=tuple(sky.signals[column].id for column in kept),
        labels=tuple(sky.signals[column].label for column in kept),
        gpst=scene.scenario.start_gpst + timedelta_from_s(shown_s),
        elapsed_s=elapsed_s,
        pseudorange_m=pseudorange_m[:, kept],
        carrier_cyc=(carrier_cyc - np.rint(start_cyc))[:, kept],
        doppler_hz=doppler_hz[:, kept],
        cn0_dbhz=cn0_dbhz[:, kept],
        averaged_s=interval_s,
        air_s=(0.5 * (code_s - carrier_s))[:, kept],
        carrier_hz=np.full(kept.size, carrier_hz),
        exposure=_make_exposure(
            scene, sky, kept, true_s[1], first - _number_first_epoch(scene, off_grid_s, interval_s)
        ),
    )


def _expand_kinds(geometry: IdealMeasurements, scene: Scene, kinds: Sequence[Kind]) -> IdealMeasurements:
    """Expand each signal to all bands and codes of its system."""
    picked = [
        (column, kind)
        for column, signal in enumerate(geometry.signals)
        for kind in kinds
        if kind.system == signal.sat[0]
    ]
    columns = np.array([column for column, _ in picked], np.intp)
    ephemerides = [select_ephemeris(scene.navigation, geometry.signals[c].sat, scene.scenario) for c in columns]
    delay_m, carrier_hz = np.empty(len(picked)), np.empty(len(picked))
    for n, ((_, kind), ephemeris) in enumerate(zip(picked, ephemerides, strict=True)):
        assert ephemeris is not None
        delay_m[n] = kind.satellite_delay_m(ephemeris) + kind.receiver_delay_m.get(geometry.receiver, 0.0)
        carrier_hz[n] = kind.carrier_hz(ephemeris)
    more = (L1_HZ / carrier_hz) ** 2 - 1.0  # the ionosphere's delay beyond that on L1, over that on L1
    air_m = SPEED_OF_LIGHT_M_S * geometry.air_s[:, columns]
    rate_m_s = np.gradient(air_m, geometry.elapsed_s, axis=0) if len(air_m) > 1 else np.zeros_like(air_m)
    wave_m, first_m = SPEED_OF_LIGHT_M_S / carrier_hz, SPEED_OF_LIGHT_M_S / geometry.carrier_hz[columns]
    paths = geometry.exposure.paths
    return replace(
        geometry,
        signals=tuple(replace(geometry.signals[c], band=k.band, code=k.code) for c, k in picked),
        labels=tuple(geometry.labels[c] for c in columns),
        pseudorange_m=geometry.pseudorange_m[:, columns] + more * air_m + delay_m,
        carrier_cyc=(geometry.carrier_cyc[:, columns] * first_m - more * air_m) / wave_m,
        doppler_hz=(geometry.doppler_hz[:, columns] * first_m + more * rate_m_s) / wave_m,
        cn0_dbhz=geometry.cn0_dbhz[:, columns],
        air_s=geometry.air_s[:, columns],
        carrier_hz=carrier_hz,
        exposure=replace(
            geometry.exposure,
            paths=tuple(replace(paths[c], carrier_hz=float(hz)) for c, hz in zip(columns, carrier_hz, strict=True)),
            el_rad=geometry.exposure.el_rad[:, columns],
        ),
    )


def _number_first_epoch(scene: Scene, off_grid_s: float, interval_s: float) -> int:
    """Return the number of an epoch before all of the scene's."""
    shown_s = min(receiver.start_offset_s + receiver.clock_offset_s for receiver in scene.scenario.receivers)
    return math.floor((off_grid_s + shown_s) / interval_s)


def _make_exposure(scene: Scene, sky: ReceiverSky, kept: Integers, true_s: Reals, first: int) -> Exposure:
    """Describe the paths by which signals reach an antenna.

    The air is taken where the scene's middle has it, since a scene is short beside the extent of the air's errors.
    """
    attacks = dict(zip(scene.scenario.attack_names, zip(scene.scenario.attacks, scene.shown, strict=True), strict=True))
    middle_s = true_s[true_s.size // 2 :][:1]

    def path_of(received: ReceivedSignal) -> SignalPath:
        if received.source not in attacks:
            return SignalPath(sat=received.id.sat, air_ecef_m=_find_first_place(sky.point, middle_s))
        attack, shown = attacks[received.source]
        transmitter = f"{received.source}/{attack.find_antenna(received.id.sat)}"
        if isinstance(attack, Meaconer):
            return SignalPath(
                sat=received.id.sat,
                air_ecef_m=_find_first_place(shown, middle_s),
                relay=received.source,
                transmitter=transmitter,
            )
        return SignalPath(sat=received.id.sat, air_ecef_m=None, transmitter=transmitter)

    at = np.clip(np.searchsorted(sky.knots_s, true_s) - 1, 0, sky.knots_s.size - 2)
    share = ((true_s - sky.knots_s[at]) / (sky.knots_s[at + 1] - sky.knots_s[at]))[:, np.newaxis]
    el_rad = sky.el_rad[at] * (1.0 - share) + sky.el_rad[at + 1] * share
    return Exposure(
        receiver=sky.name,
        paths=tuple(path_of(sky.signals[column]) for column in kept),
        first=first,
        el_rad=el_rad[:, kept],
    )


def _find_first_place(point: Point, at_s: Reals) -> Reals | None:
    return np.asarray(point(at_s).position_ecef_m[0]) if at_s.size else None


def _compute_drift(sky: ReceiverSky, elapsed_s: Reals) -> Reals:
    """Compute the growth of the carriers' delays in a second of the receiver's own clock, (n, n_signals)."""
    shown_s = elapsed_s + _SHORT_S * np.array([[-1.0], [1.0]])
    late_s = sky.true_minus_elapsed_s(shown_s)
    delay_s = sky.carrier_delay_s(shown_s + late_s) - late_s[..., np.newaxis]
    return np.asarray((delay_s[1] - delay_s[0]) / (2.0 * _SHORT_S))


def _make_observations(
    geometry: IdealMeasurements,
    noise: NoiseModel,
    field: FieldError | None,
    rng: np.random.Generator,
    signals: Sequence[SignalId],
    order: Sequence[int],
) -> Observations:
    """Add noise to a geometry; `signals` are the names of its columns `order`."""
    growth = noise.growth(geometry.cn0_dbhz)
    shape = growth.shape
    pseudorange_m = geometry.pseudorange_m + _draw_code_noise_m(geometry, noise, rng, ())
    carrier_cyc = geometry.carrier_cyc + noise.carrier_sigma_cyc * growth * rng.standard_normal(shape)
    doppler_hz = geometry.doppler_hz + noise.doppler_sigma_hz * growth * rng.standard_normal(shape)
    if field is not None:
        pseudorange_m += field.code_m
        carrier_cyc += field.carrier_cyc
    columns = np.asarray(order, dtype=np.intp)
    present = geometry.present[:, columns]
    first = present.argmax(axis=0)
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
        status=np.where(present, CellStatus.OK, CellStatus.NOT_TRACKED).astype(np.uint8),
        found_elapsed_s=found_s,
        missed_elapsed_s=np.where(first > 0, found_s - geometry.averaged_s, np.nan),
        carrier_hz=geometry.carrier_hz[columns],
        averaged_s=geometry.averaged_s,
    )


def _shuffle_copies(signals: Sequence[SignalId], rng: np.random.Generator) -> list[SignalId]:
    """Give the copies of each transmission the letters a, b, ... in a random order."""
    dealt = list(signals)
    for transmission in sorted({signal.transmission for signal in signals}):
        columns = [column for column, signal in enumerate(signals) if signal.transmission == transmission]
        for column, letter in zip(columns, rng.permutation(len(columns)), strict=True):
            dealt[column] = replace(signals[column], copy=chr(ord("a") + int(letter)))
    return dealt
