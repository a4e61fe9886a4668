"""Simulate errors in the field beside white noise: reflections, and residual errors of the air's models.

All are correlated in time and stepped exactly whatever the interval between epochs. A test that is right under white
noise alone takes them for another place or time.

| error | one sigma | who shares it | |---|---|---| | reflections near the receiver | of code 0.13 m + 0.53 m
exp(-elevation / 10 deg) | none | | the same, of a transmitter on the ground | at elevation 0 | all its signals at one
antenna: they come one way | | the same, at the receive antenna of a relay | by the satellite's elevation there | all
that receive the relay | | ionosphere left over | vertical one by obliquity; carrier the other way | a satellite's at
places near each other | | troposphere left over | vertical one by obliquity | the same |

False signals that are made on the ground never went through air; a relay's did, on their way to it. A reflection moves
the carrier by a quarter of a cycle at most, being weaker than its signal, and by the sine of the angle whose cosine
moves the code, so that the two do not correlate.

Reflections are first-order Gauss-Markov processes. The air is smooth: of first order, 1.5 m over half an hour would
throw carriers about by 5 cm a second, so its processes have a rate as well, correlation (1 + t/T) exp(-t/T).

Sources: sigma of reflections RTCA DO-229D, J.2.4 (airborne; a car in a street has several times as much); obliquity of
the ionosphere A.4.4.10.4, of the troposphere and its 0.12 m A.4.2.4. Klobuchar's model leaves half of the ionosphere in
the rms (IS-GPS-200N, 20.3.3.5.2.5): 1.5 m vertical at middle latitudes. How long and how far is our choice: minutes as
satellites move through the reflections, the size of a weather front, half an hour of the sun's motion.
"""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from skyproof.arrays import Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.statistics.gauss_markov import gauss_markov_step

__all__ = [
    "Exposure",
    "FieldError",
    "FieldErrors",
    "SignalPath",
    "compute_ionosphere_obliquity",
    "compute_troposphere_obliquity",
    "draw_field_errors",
]

_EARTH_KM, _SHELL_KM = 6378.1363, 350.0
_QUARTER_CYC = 0.25
_STREAM = 1 << 23  # sets these random numbers apart from others of one seed


@dataclass(frozen=True, kw_only=True)
class FieldErrors:
    """How large, how slow, how far they reach.

    multipath_floor_m, multipath_low_m, multipath_deg : sigma = floor + low exp(-elevation / deg) of code.
    multipath_s : correlation time; tens of seconds to minutes where nothing moves but satellites, seconds on a vehicle.
    carrier_cyc_a_m : sigma of the carrier in cycles for a metre of code's.
    ionosphere_m, troposphere_m : sigma of the vertical delay left over, with correlation times, and `_km`: at this
        distance d two places correlate by exp(-1/2), else by exp(-(x / d)^2 / 2), so that neighbours differ by a
        gradient of sigma / d: 4 mm/km for the ionosphere, as RTCA DO-245A takes it for quiet days.
    seed : of the processes; drawn again for each window where absent. One seed gives one world at one interval,
        whatever window and satellites are asked for, and whichever receivers beside those named before.
    """

    multipath_floor_m: float = 0.13
    multipath_low_m: float = 0.53
    multipath_deg: float = 10.0
    multipath_s: float = 60.0
    carrier_cyc_a_m: float = 0.05
    ionosphere_m: float = 1.5
    ionosphere_s: float = 1800.0
    ionosphere_km: float = 375.0
    troposphere_m: float = 0.12
    troposphere_s: float = 3600.0
    troposphere_km: float = 100.0
    seed: int | None = None

    def multipath_sigma_m(self, el_rad: ArrayLike) -> Reals:
        """Return the sigma of code at elevations of any shape."""
        el_deg = np.maximum(np.degrees(np.asarray(el_rad, np.float64)), 0.0)
        return np.asarray(self.multipath_floor_m + self.multipath_low_m * np.exp(-el_deg / self.multipath_deg))


@dataclass(frozen=True, eq=False, kw_only=True)
class SignalPath:
    """How a signal came to an antenna.

    air_ecef_m : (3,) where it left the air: at the antenna itself or at a relay's; None if it was made on the
        ground. relay : name of the relay, "" for none. transmitter : of the transmit antenna that it
        comes from, "" for the satellite. carrier_hz : reflections of different carriers are independent, their
        ionosphere is one, by the inverse square.
    """

    sat: str
    air_ecef_m: Reals | None
    relay: str = ""
    transmitter: str = ""
    carrier_hz: float = L1_HZ


@dataclass(frozen=True, eq=False, kw_only=True)
class Exposure:
    """What an antenna receives, when: epochs number `first` and on, `interval_s` apart, since an instant that all
    share.

    el_rad : (n_epochs, n_paths) of the satellite where the signal left the air.
    """

    receiver: str
    paths: tuple[SignalPath, ...]
    first: int
    el_rad: Reals


@dataclass(frozen=True, eq=False, kw_only=True)
class FieldError:
    """Of code in metres and of carrier in cycles, late is positive: (*draws, n_epochs, n_paths)."""

    code_m: Reals
    carrier_cyc: Reals


def compute_ionosphere_obliquity(el_rad: ArrayLike) -> Reals:
    """Compute slant over vertical delay of a thin shell at 350 km, any shape: RTCA DO-229D, A.4.4.10.4."""
    flat = _EARTH_KM * np.cos(np.maximum(np.asarray(el_rad, np.float64), 0.0)) / (_EARTH_KM + _SHELL_KM)
    return np.asarray(1.0 / np.sqrt(1.0 - flat**2))


def compute_troposphere_obliquity(el_rad: ArrayLike) -> Reals:
    """Compute slant over vertical delay, any shape: RTCA DO-229D, A.4.2.4."""
    return np.asarray(1.001 / np.sqrt(0.002001 + np.sin(np.maximum(np.asarray(el_rad, np.float64), 0.0)) ** 2))


def draw_field_errors(
    model: FieldErrors,
    exposures: Sequence[Exposure],
    interval_s: float,
    *,
    rng: np.random.Generator | None = None,
    draws: tuple[int, ...] = (),
) -> tuple[FieldError, ...]:
    """Draw the errors of every signal at every antenna. The draws are independent worlds of one seed.

    Raises ValueError without a seed in the model and without `rng` to draw one from.
    """
    if model.seed is None and rng is None:
        raise ValueError("field errors need a seed, or a generator to draw one from")
    seed = model.seed if model.seed is not None or rng is None else int(rng.integers(2**63))
    world = _World(replace(model, seed=seed), exposures, interval_s, draws)
    return tuple(_draw_error(model, exposure, world, draws) for exposure in exposures)


def _draw_error(model: FieldErrors, exposure: Exposure, world: "_World", draws: tuple[int, ...]) -> FieldError:
    shape = (*draws, *exposure.el_rad.shape)
    code_m, carrier_cyc = np.zeros(shape), np.zeros(shape)
    for column, path in enumerate(exposure.paths):
        el_rad = exposure.el_rad[:, column]
        wavelength_m, slower = SPEED_OF_LIGHT_M_S / path.carrier_hz, (L1_HZ / path.carrier_hz) ** 2
        band = "" if path.carrier_hz == L1_HZ else f" {path.carrier_hz:.0f}"
        reflections = []
        if path.transmitter:
            sigma_m = np.broadcast_to(model.multipath_sigma_m(0.0), el_rad.shape)
            reflections.append((f"{exposure.receiver}<{path.transmitter}", sigma_m))
        else:
            reflections.append((f"{exposure.receiver}<{path.sat}", model.multipath_sigma_m(el_rad)))
        if path.relay:
            reflections.append((f"{path.relay}<{path.sat}", model.multipath_sigma_m(el_rad)))
        for name, sigma_m in reflections:
            of_code, of_carrier = world.reflection(name + band, exposure)
            code_m[..., column] += sigma_m * of_code
            turned = model.carrier_cyc_a_m * sigma_m * of_carrier
            carrier_cyc[..., column] += _QUARTER_CYC * np.tanh(turned / _QUARTER_CYC)
        if path.air_ecef_m is not None:
            ionosphere_m = slower * compute_ionosphere_obliquity(el_rad) * world.air("ionosphere", path, exposure)
            troposphere_m = compute_troposphere_obliquity(el_rad) * world.air("troposphere", path, exposure)
            code_m[..., column] += troposphere_m + ionosphere_m
            carrier_cyc[..., column] += (troposphere_m - ionosphere_m) / wavelength_m
    return FieldError(code_m=code_m, carrier_cyc=carrier_cyc)


class _World:
    """The processes, each made once, of all epochs since the instant that all share."""

    def __init__(
        self, model: FieldErrors, exposures: Sequence[Exposure], interval_s: float, draws: tuple[int, ...]
    ) -> None:
        self.model, self.interval_s, self.draws = model, interval_s, draws
        self.epochs = max(exposure.first + exposure.el_rad.shape[0] for exposure in exposures)
        if min(exposure.first for exposure in exposures) < 0:
            raise ValueError("epochs are counted from an instant before all of them")
        self.places: dict[str, list[Reals]] = {}  # of each satellite, where its signals left the air
        for exposure in exposures:
            for path in exposure.paths:
                if path.air_ecef_m is not None and self._place(path) is None:
                    self.places.setdefault(path.sat, []).append(path.air_ecef_m)
        self.made: dict[str, Reals] = {}

    def reflection(self, name: str, exposure: Exposure) -> tuple[Reals, Reals]:
        """Draw a reflection's errors of code and carrier, of deviation 1 each, (*draws, n_epochs)."""
        if name not in self.made:
            normals = self._draw_normals(name)
            step = gauss_markov_step(1.0, self.model.multipath_s, self.interval_s)
            normals[1:] *= step.drive
            self.made[name] = scipy.signal.lfilter([1.0], [1.0, -float(step.keep)], normals, axis=0)
        window = self._window(self.made[name], exposure)
        return window[..., 0], window[..., 1]

    def air(self, what: str, path: SignalPath, exposure: Exposure) -> Reals:
        """Draw the vertical error of the air, in metres, (*draws, n_epochs), at the place of a path."""
        name, model = f"{what} {path.sat}", self.model
        sigma_m, correlation_s, reach_km = {
            "ionosphere": (model.ionosphere_m, model.ionosphere_s, model.ionosphere_km),
            "troposphere": (model.troposphere_m, model.troposphere_s, model.troposphere_km),
        }[what]
        if name not in self.made:
            places_m = np.stack(self.places[path.sat])
            apart_km = 1e-3 * np.linalg.norm(places_m[:, np.newaxis] - places_m, axis=-1)
            alike = _factor_lower(np.exp(-0.5 * (apart_km / reach_km) ** 2))
            keep, drive = _compute_smooth_step(self.interval_s / correlation_s)
            paths = np.empty((self.epochs, math.prod(self.draws), len(places_m)))
            for place in range(len(places_m)):
                _fill_smooth_paths(paths[:, :, place], self._draw_normals(f"{name} {place}"), keep, drive)
            self.made[name] = sigma_m * paths @ alike.T
        number = self._place(path)
        assert number is not None
        return self._window(self.made[name], exposure)[..., number]

    def _place(self, path: SignalPath) -> int | None:
        known = enumerate(self.places.get(path.sat, []))
        return next((number for number, place in known if bool((place == path.air_ecef_m).all())), None)

    def _window(self, paths: Reals, exposure: Exposure) -> Reals:
        """Cut (n_epochs, all draws, n) to what an antenna receives of it, (*draws, n_epochs, n)."""
        those = paths[exposure.first : exposure.first + exposure.el_rad.shape[0]]
        return np.moveaxis(those, 0, -2).reshape(*self.draws, those.shape[0], those.shape[-1])

    def _draw_normals(self, name: str) -> Reals:
        """Draw a stream of this name alone, two numbers an epoch.

        Time is first, so that a longer window continues a shorter one.
        """
        key = _STREAM, zlib.crc32(name.encode())
        rng = np.random.Generator(np.random.SFC64(np.random.SeedSequence(self.model.seed, spawn_key=key)))
        return rng.standard_normal((self.epochs, math.prod(self.draws), 2))


def _compute_smooth_step(step: float) -> tuple[Reals, Reals]:
    """Compute keep (2, 2) and the noise's root for value and rate times T, of variance 1, over `step` T.

    The correlation (1 + t) exp(-t) has the transition exp(-t) [[1 + t, t], [-t, 1 - t]].
    """
    fade, fade2 = math.exp(-step), math.exp(-2.0 * step)
    keep = fade * np.array([[1.0 + step, step], [-step, 1.0 - step]])
    small = step < 1e-3  # differences lose digits; the series is right to 1e-6
    value = 4.0 / 3.0 * step**3 * (1.0 - 1.5 * step) if small else 1.0 - fade2 * (1.0 + 2.0 * step + 2.0 * step**2)
    rate = 1.0 - fade2 * (1.0 - 2.0 * step + 2.0 * step**2)
    covariance = 2.0 * step**2 * fade2
    first = math.sqrt(value)
    return keep, np.array([[first, 0.0], [covariance / first, math.sqrt(max(rate - covariance**2 / value, 0.0))]])


@compiled
def _fill_smooth_paths(values: Reals, normals: Reals, keep: Reals, drive: Reals) -> None:
    """Fill values (n, k) from normals (n, k, 2), stationary from the first on."""
    for k in range(values.shape[1]):
        value, rate = normals[0, k, 0], normals[0, k, 1]
        values[0, k] = value
        for n in range(1, values.shape[0]):
            first_normal, second_normal = normals[n, k, 0], normals[n, k, 1]
            value, rate = (
                keep[0, 0] * value + keep[0, 1] * rate + drive[0, 0] * first_normal,
                keep[1, 0] * value + keep[1, 1] * rate + drive[1, 0] * first_normal + drive[1, 1] * second_normal,
            )
            values[n, k] = value


def _factor_lower(covariance: Reals) -> Reals:
    """Factor a covariance matrix to a lower triangle. So a further place does not change those before it.

    Places a few metres apart are one but for 1e-10 of it, which roundings may make negative.
    """
    size = covariance.shape[0]
    root = np.zeros((size, size))
    for row in range(size):
        for column in range(row):
            rest = covariance[row, column] - root[row, :column] @ root[column, :column]
            root[row, column] = rest / root[column, column] if root[column, column] > 1e-7 else 0.0
        root[row, row] = np.sqrt(max(covariance[row, row] - root[row, :row] @ root[row, :row], 0.0))
    return root
