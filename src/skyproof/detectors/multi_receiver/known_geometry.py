"""Test if signals put the antennas where they are known to stand, which tells a captured receiver from a free one.

That signals of two receivers do not come from one antenna proves that not both follow one transmitter. It does not
prove that neither does: a transmitter that reaches one receiver only shows a baseline of its choice. What is known of
the true baseline decides. A false sky in one receiver that agrees with the antennas' places shows the true place; one
that agrees with their distance shows a point of the sphere around the other antenna.

Two questions, two p-values. `geometry_survival` holds for a rejection: under a clean sky it is below alpha at most with
probability alpha, whatever the noise (`one_antenna.ContrastLevels`). `consistency_p_value` decides whether to believe.
It takes the noise as it looks, over the whole window and over parts of it. So it notices a false sky that leaves the
true place within the window.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from skyproof.arrays import Reals
from skyproof.compiled import compiled
from skyproof.detectors.multi_receiver.one_antenna import BaselineEstimate
from skyproof.detectors.multi_receiver.policy import POLICY
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.slips import HEIGHT, list_distance_slips, list_position_slips, list_vector_slips
from skyproof.records import Baseline, Datum
from skyproof.statistics.distributions import chi_square_survival, f_survival

__all__ = [
    "AntennaDistance",
    "AntennaGeometry",
    "AntennaPlaces",
    "Fit",
    "GeometrySlip",
    "LearntBaseline",
    "LearntDistance",
    "Misfit",
    "Reach",
    "StatedGeometry",
    "consistency_p_value",
    "geometry_survival",
]

_ROUNDS = 80  # of bisection
_LEAST_M = 1e-6


class Misfit(NamedTuple):
    """squared (...): smallest squared deviation, in sigmas, of baselines from what is known; dof: of its law at worst,
    exact: of its law where the sigmas are small beside the distances."""

    squared: Reals
    dof: int
    exact: int


class Reach(NamedTuple):
    """Where a baseline may be: between two spheres about `centre_m` (3,)."""

    centre_m: Reals
    inner_m: float
    outer_m: float

    @property
    def volume_m3(self) -> float:
        return 4.0 / 3.0 * np.pi * (self.outer_m**3 - self.inner_m**3)


class AntennaGeometry(Protocol):
    """What is known of where antennas stand relative to each other."""

    @property
    def assumes(self) -> tuple[str, ...]:
        """Return codes of what has to hold for signals that agree with it to be true."""
        ...

    @property
    def stated(self) -> tuple[str, ...]:
        """Return codes of what has to hold for signals that disagree with it to be false."""
        ...

    @property
    def data(self) -> Mapping[str, Datum]:
        """Return what is known: "known", and the distance where it is one."""
        ...

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        """Test baselines (..., 3 (R - 1)) from the first receiver with covariance (..., 3 (R - 1), 3 (R - 1))."""
        ...

    def reach(self, receivers: Sequence[str]) -> Reach:
        """Return where the baseline of two receivers is, at five sigmas."""
        ...


class StatedGeometry(AntennaGeometry, Protocol):
    """What a user states of it. key : the setting."""

    @property
    def key(self) -> str: ...

    def slips(self, receivers: Sequence[str]) -> Iterator["GeometrySlip"]:
        """Yield what may have been meant, if it was stated with a likely slip."""
        ...

    def farthest_m(self, receivers: Sequence[str]) -> float:
        """Return how far apart the antennas stand at most, as stated."""
        ...


class Fit(Protocol):
    """What baselines can be held against."""

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit: ...
    def reach(self, receivers: Sequence[str]) -> Reach | None: ...


class GeometrySlip(NamedTuple):
    """A slip, what it is about, what would be right, and the geometry that then holds."""

    code: str
    about: str
    words: str
    value: str
    fit: Fit


@dataclass(frozen=True)
class AntennaPlaces:
    """Where each receiver's antenna stands, east, north, up of any common point, each axis to `sigma_m`.

    positions_ecef_m : (3,) of each receiver, where the places are those of surveyed positions.
    """

    enu_m: Mapping[str, tuple[float, float, float]]
    sigma_m: float = 0.1
    positions_ecef_m: Mapping[str, Reals] | None = None

    key = "antennas_enu_m"
    assumes = stated = ("antennas_as_stated",)

    @property
    def data(self) -> dict[str, Datum]:
        """Return that places are known."""
        return {"known": "places"}

    def baselines_m(self, receivers: Sequence[str]) -> Reals:
        """Return the baselines (3 (R - 1),) from the first receiver."""
        place_m = np.array([self.enu_m[name] for name in receivers], float)
        return np.asarray((place_m[1:] - place_m[0]).ravel())

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        antenna_m2 = self.sigma_m**2 * (
            np.eye(len(receivers) - 1) + 1.0
        )  # the first antenna's error is in every baseline
        return _from_vector(enu_m - self.baselines_m(receivers), covariance_m2 + np.kron(antenna_m2, np.eye(3)))

    def reach(self, receivers: Sequence[str]) -> Reach:
        return Reach(self.baselines_m(receivers), 0.0, POLICY.reach_sigmas * float(np.sqrt(2.0)) * self.sigma_m)

    def farthest_m(self, receivers: Sequence[str]) -> float:
        return float(np.linalg.norm(self.baselines_m(receivers).reshape(-1, 3), axis=1).max())

    def slips(self, receivers: Sequence[str]) -> Iterator[GeometrySlip]:
        place_m = np.array([self.enu_m[name] for name in receivers], float)
        open_m2 = self.sigma_m**2 * np.eye(place_m.size)
        if self.positions_ecef_m is not None and all(name in self.positions_ecef_m for name in receivers):
            yield from self._position_slips(receivers, open_m2)
        for slip in list_vector_slips():
            turned = _Guess(place_m @ slip.turn.T, open_m2)
            yield GeometrySlip(slip.code, self.key, slip.words, "", turned)
        for k, name in enumerate(receivers):
            up_m2 = open_m2.copy()
            up_m2[3 * k + 2, 3 * k + 2] += POLICY.unknown_height_sigma_m**2
            words = f"the height of {name} is wrong"
            yield GeometrySlip(HEIGHT, f"{self.key}.{name}", words, "", _Guess(place_m, up_m2))
        if len(receivers) == 2:
            sphere = AntennaDistance(self.farthest_m(receivers), float(np.sqrt(2.0)) * self.sigma_m)
            words = "the antennas are as far apart as stated in another direction: attitude or axes are wrong"
            yield GeometrySlip("attitude_or_axes", self.key, words, "", sphere)

    def _position_slips(self, receivers: Sequence[str], open_m2: Reals) -> Iterator[GeometrySlip]:
        """Yield the slips of each receiver alone, and of all of them alike."""
        assert self.positions_ecef_m is not None
        stated_m = np.array([self.positions_ecef_m[name] for name in receivers])
        every = [{slip.code: slip for slip in list_position_slips(place_m)} for place_m in stated_m]
        for k, name in enumerate(receivers):
            for slip in every[k].values():
                place_m, covariance_m2 = stated_m.copy(), open_m2.copy()
                place_m[k] = slip.position_ecef_m
                rows = slice(3 * k, 3 * k + 3)
                rot = _level_frame(place_m[0])
                covariance_m2[rows, rows] += rot @ slip.covariance_m2 @ rot.T
                fit = _Guess((place_m - place_m[0]) @ rot.T, covariance_m2)
                yield GeometrySlip(slip.code, f"position of {name}", slip.words, slip.value, fit)
        for code in set.intersection(*(set(slips) for slips in every)):
            place_m = np.array([slips[code].position_ecef_m for slips in every])
            fit = _Guess((place_m - place_m[0]) @ _level_frame(place_m[0]).T, open_m2)
            slip = every[0][code]
            if not np.any(slip.covariance_m2):  # an error that all heights share leaves the baseline as it is
                yield GeometrySlip(code, f"positions of {', '.join(receivers)}", slip.words, slip.value, fit)


@dataclass(frozen=True, eq=False)
class _Guess:
    """Places (R, 3) of the antennas, east, north, up, and the covariance (3 R, 3 R) of their remaining error."""

    place_m: Reals
    covariance_m2: Reals

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        n_baselines = len(receivers) - 1
        between = np.kron(np.column_stack([-np.ones(n_baselines), np.eye(n_baselines)]), np.eye(3))
        expected_m = between @ self.place_m.ravel()
        return _from_vector(enu_m - expected_m, covariance_m2 + between @ self.covariance_m2 @ between.T)

    def reach(self, receivers: Sequence[str]) -> Reach:
        sigma_m = np.sqrt(2.0 * np.linalg.eigvalsh(self.covariance_m2)[-1])
        return Reach(self.place_m[1] - self.place_m[0], 0.0, POLICY.reach_sigmas * float(sigma_m))


@dataclass(frozen=True)
class _LevelDistance:
    """The distance on a map, whatever the antennas differ by in height."""

    distance_m: float
    sigma_m: float

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        squared = _fit_sphere(enu_m[..., :2], covariance_m2[..., :2, :2], self.distance_m, self.sigma_m)
        return Misfit(squared, dof=3, exact=1)

    def reach(self, receivers: Sequence[str]) -> None:
        """Return None: the height is open."""


def _level_frame(place_ecef_m: Reals) -> Reals:
    """Return the rotation (3, 3) from ECEF to east, north, up of a place."""
    lat_rad, lon_rad, _ = geodetic_from_ecef(place_ecef_m)
    return rot_enu_ecef(lat_rad, lon_rad)


@dataclass(frozen=True)
class AntennaDistance:
    """The distance between the antennas of two receivers, with its sigma, metres."""

    distance_m: float
    sigma_m: float

    key = "antenna_distance_m"

    def farthest_m(self, receivers: Sequence[str]) -> float:
        return self.distance_m

    def slips(self, receivers: Sequence[str]) -> Iterator[GeometrySlip]:
        for slip in list_distance_slips(self.distance_m):
            sigma_m = max(self.sigma_m * slip.distance_m / self.distance_m, POLICY.least_distance_sigma_m)
            value = f"{self.key} = {slip.distance_m:.4g}"
            fit = AntennaDistance(slip.distance_m, sigma_m)
            yield GeometrySlip(slip.code, self.key, slip.words, value, fit)
        level = _LevelDistance(self.distance_m, self.sigma_m)
        yield GeometrySlip("level_distance", self.key, "it is the level distance, without the height", "", level)

    assumes: ClassVar[tuple[str, ...]] = ("distance_as_stated_and_not_shown",)
    stated: ClassVar[tuple[str, ...]] = ("distance_as_stated",)

    @property
    def data(self) -> dict[str, Datum]:
        """Return the distance and its sigma."""
        return {"known": "distance", "distance_m": self.distance_m, "distance_sigma_m": self.sigma_m}

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        return Misfit(_fit_sphere(enu_m, covariance_m2, self.distance_m, self.sigma_m), dof=4, exact=1)

    def reach(self, receivers: Sequence[str]) -> Reach:
        spread_m = POLICY.reach_sigmas * self.sigma_m
        return Reach(np.zeros(3), max(self.distance_m - spread_m, 0.0), self.distance_m + spread_m)


@dataclass(frozen=True)
class LearntDistance(AntennaDistance):
    """The distance that windows showed in which both skies were received: whatever way the antennas turn together."""

    assumes: ClassVar[tuple[str, ...]] = ("distance_kept", *AntennaDistance.assumes)
    stated: ClassVar[tuple[str, ...]] = assumes

    @property
    def data(self) -> dict[str, Datum]:
        """Return the distance and its sigma."""
        return {**super().data, "known": "learnt_distance"}


@dataclass(frozen=True, eq=False)
class LearntBaseline:
    """Baselines of windows in which both skies were received in every receiver, for those in which they were not."""

    baseline: Baseline

    assumes = stated = ("antennas_rigid",)

    @property
    def data(self) -> dict[str, Datum]:
        """Return that other windows show a baseline."""
        return {"known": "learnt_baseline"}

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        off_m = enu_m - self.baseline.enu_m.ravel()
        return _from_vector(off_m, covariance_m2 + self.baseline.covariance_m2)

    def reach(self, receivers: Sequence[str]) -> Reach:
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(self.baseline.covariance_m2)[-1]))
        return Reach(np.asarray(self.baseline.enu_m[0]), 0.0, POLICY.reach_sigmas * sigma_m)


def geometry_survival(geometry: Fit, receivers: Sequence[str], estimate: BaselineEstimate, dof_den: Reals) -> Reals:
    """Compute the p-value (G, ...) of "the sky over these antennas" for each noise considered, never too small.

    At the true baseline the squared deviation is chi-square; its degrees are the numbers to be met. The smallest one
    is no larger.
    """
    misfit = geometry.misfit(receivers, estimate.enu_m, estimate.covariance_m2)
    return f_survival(misfit.squared / misfit.dof, misfit.dof, dof_den)


def consistency_p_value(geometry: Fit, baselines: Sequence[Baseline]) -> float:
    """Return the p-value of the worst of these baselines of the same receivers, times their number.

    It is 1 if all are as known.
    """
    enu_m = np.array([baseline.enu_m.ravel() for baseline in baselines])
    covariance_m2 = np.array([baseline.covariance_m2 for baseline in baselines])
    misfit = geometry.misfit(baselines[0].receivers, enu_m, covariance_m2)
    return min(1.0, len(baselines) * float(np.min(chi_square_survival(misfit.squared, misfit.exact))))


def _from_vector(off_m: Reals, covariance_m2: Reals) -> Misfit:
    solved = np.linalg.solve(covariance_m2, off_m[..., None])[..., 0]
    dof = int(off_m.shape[-1])
    return Misfit(np.asarray(np.sum(off_m * solved, axis=-1)), dof, dof)


def _fit_sphere(enu_m: Reals, covariance_m2: Reals, distance_m: float, sigma_m: float) -> Reals:
    """Return the least value over b of (enu - b)^T W (enu - b) + ((|b| - D) / sigma)^2, W = C^-1.

    Shapes (..., n), (..., n, n): n is 3, or 2 on a map.
    Where the gradient is zero W (enu - b) = m b with m = (1 - D / |b|) / sigma^2, so b = (W + m)^-1 W enu. Let m grow
    from minus the least eigenvalue of W to 1 / sigma^2. Then |b| falls from infinity, and D / (1 - m sigma^2), which it
    must equal, rises to infinity. So there is one solution between, the smallest value of all; bisection finds it.
    """
    weight, axes = np.linalg.eigh(np.linalg.inv(covariance_m2))
    along_m = np.einsum("...ij,...i->...j", axes, enu_m)
    along_m = np.where(np.abs(along_m) < _LEAST_M, _LEAST_M, along_m)  # with nothing along the weakest axis b may turn
    weight, along_m = (np.array(np.broadcast_to(values, enu_m.shape), order="C") for values in (weight, along_m))
    high = np.empty(enu_m.shape[:-1])
    axes_of = (-1, enu_m.shape[-1])
    _bisect(weight.reshape(axes_of), along_m.reshape(axes_of), distance_m, sigma_m, high.reshape(-1))
    b = weight * along_m / (weight + high[..., None])
    radius_m = np.linalg.norm(b, axis=-1)
    return np.asarray(np.sum(weight * (along_m - b) ** 2, axis=-1) + ((radius_m - distance_m) / sigma_m) ** 2)


@compiled(error_model="numpy")
def _bisect(weight, along_m, distance_m, sigma_m, high):  # type: ignore[no-untyped-def]
    """Solve for m of `_fit_sphere`, into high (n,), for eigenvalues (n, 2 or 3) and the parts along their axes."""
    for k in range(high.size):
        low, high[k] = -weight[k, 0], 1.0 / sigma_m**2
        for _ in range(_ROUNDS):
            m = 0.5 * (low + high[k])
            length2 = 0.0
            for i in range(weight.shape[1]):
                length2 += (weight[k, i] * along_m[k, i] / (weight[k, i] + m)) ** 2
            if np.sqrt(length2) * (1.0 - m * sigma_m**2) > distance_m:
                low = m
            else:
                high[k] = m
