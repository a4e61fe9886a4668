"""Do signals put the antennas where they are known to stand? What tells one captured receiver from a free one.

That signals of two receivers do not come from one antenna proves that not both follow one transmitter. It does not
prove that neither does: a transmitter that reaches one receiver only shows a baseline of its choice. What is known of
the true baseline decides. A false sky in one receiver that agrees with the antennas' places shows the true place; one
that agrees with their distance shows a point of the sphere around the other antenna.

Two questions, two p-values. `survival` holds for a rejection: under a clean sky it is below alpha at most with
probability alpha, whatever the noise (`one_antenna.ContrastLevels`). `agreement` decides whether to believe: it takes
the noise as it looks, over the whole window and over parts of it, so that a false sky that leaves the true place within
the window is noticed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from skyproof.arrays import Reals
from skyproof.detectors.multi_receiver.one_antenna import BaselineEstimate
from skyproof.records import Baseline
from skyproof.statistics.distributions import chi_square_survival, f_survival

__all__ = [
    "AntennaDistance",
    "AntennaGeometry",
    "AntennaPlaces",
    "LearntBaseline",
    "LearntDistance",
    "Misfit",
    "Reach",
    "agreement",
    "survival",
]

_ROUNDS = 80  # of bisection
_LEAST_M = 1e-6
_REACH = 5.0  # sigmas


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
        """What has to hold for signals that agree with it to be true."""
        ...

    @property
    def stated(self) -> tuple[str, ...]:
        """What has to hold for signals that disagree with it to be false."""
        ...

    @property
    def words(self) -> str:
        """What is known, to follow "with"."""
        ...

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        """Of baselines (..., 3 (R - 1)) from the first receiver with covariance (..., 3 (R - 1), 3 (R - 1))."""
        ...

    def reach(self, receivers: Sequence[str]) -> Reach:
        """Where the baseline of two receivers is, at five sigmas."""
        ...


@dataclass(frozen=True)
class AntennaPlaces:
    """Where each receiver's antenna stands, east, north, up of any common point, each axis to `sigma_m`."""

    enu_m: Mapping[str, tuple[float, float, float]]
    sigma_m: float = 0.1

    assumes = stated = ("the antennas stand where they are said to",)
    words = "where the antennas are known to stand"

    def expected_m(self, receivers: Sequence[str]) -> Reals:
        """(3 (R - 1),) baselines from the first receiver."""
        place_m = np.array([self.enu_m[name] for name in receivers], float)
        return np.asarray((place_m[1:] - place_m[0]).ravel())

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        own = self.sigma_m**2 * (np.eye(len(receivers) - 1) + 1.0)  # the first antenna's error is in every baseline
        return _from_vector(enu_m - self.expected_m(receivers), covariance_m2 + np.kron(own, np.eye(3)))

    def reach(self, receivers: Sequence[str]) -> Reach:
        return Reach(self.expected_m(receivers), 0.0, _REACH * float(np.sqrt(2.0)) * self.sigma_m)


@dataclass(frozen=True)
class AntennaDistance:
    """The distance between the antennas of two receivers, with its sigma, metres."""

    distance_m: float
    sigma_m: float

    @property
    def assumes(self) -> tuple[str, ...]:
        return (
            f"the antennas stand {self.distance_m:g} ± {self.sigma_m:.2g} m apart, and no false position of one "
            "receiver alone lies at that distance from the other",
        )

    @property
    def stated(self) -> tuple[str, ...]:
        return (f"the antennas stand {self.distance_m:g} ± {self.sigma_m:.2g} m apart",)

    @property
    def words(self) -> str:
        return f"the distance of {self.distance_m:g} m that was given"

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        return Misfit(_from_sphere(enu_m, covariance_m2, self.distance_m, self.sigma_m), dof=4, exact=1)

    def reach(self, receivers: Sequence[str]) -> Reach:
        spread_m = _REACH * self.sigma_m
        return Reach(np.zeros(3), max(self.distance_m - spread_m, 0.0), self.distance_m + spread_m)


@dataclass(frozen=True)
class LearntDistance(AntennaDistance):
    """The distance that windows showed in which both skies were received: whatever way the antennas turn together."""

    @property
    def assumes(self) -> tuple[str, ...]:
        return ("the antennas keep the distance that they had while both skies were received", *super().assumes)

    @property
    def stated(self) -> tuple[str, ...]:
        return self.assumes

    @property
    def words(self) -> str:
        return f"the distance of {self.distance_m:.1f} m that they had while both skies were received"


@dataclass(frozen=True, eq=False)
class LearntBaseline:
    """Baselines of windows in which both skies were received in every receiver, for those in which they were not."""

    baseline: Baseline

    assumes = stated = ("the antennas do not move relative to each other",)
    words = "where the antennas stand by the windows in which both skies are received"

    def misfit(self, receivers: Sequence[str], enu_m: Reals, covariance_m2: Reals) -> Misfit:
        off_m = enu_m - self.baseline.enu_m.ravel()
        return _from_vector(off_m, covariance_m2 + self.baseline.covariance_m2)

    def reach(self, receivers: Sequence[str]) -> Reach:
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(self.baseline.covariance_m2)[-1]))
        return Reach(np.asarray(self.baseline.enu_m[0]), 0.0, _REACH * sigma_m)


def survival(geometry: AntennaGeometry, receivers: Sequence[str], estimate: BaselineEstimate, dof_den: Reals) -> Reals:
    """p-value (G, ...) of "the sky over these antennas" for each noise that is considered, never too small.

    At the true baseline the squared deviation is chi-square with as many degrees as there are numbers to be met, and
    the smallest one is no larger.
    """
    misfit = geometry.misfit(receivers, estimate.enu_m, estimate.covariance_m2)
    return f_survival(misfit.squared / misfit.dof, misfit.dof, dof_den)


def agreement(geometry: AntennaGeometry, baselines: Sequence[Baseline]) -> float:
    """p-value of the worst of these baselines of the same receivers, times their number: 1 where all are as known."""
    enu_m = np.array([baseline.enu_m.ravel() for baseline in baselines])
    covariance_m2 = np.array([baseline.covariance_m2 for baseline in baselines])
    misfit = geometry.misfit(baselines[0].receivers, enu_m, covariance_m2)
    return min(1.0, len(baselines) * float(np.min(chi_square_survival(misfit.squared, misfit.exact))))


def _from_vector(off_m: Reals, covariance_m2: Reals) -> Misfit:
    solved = np.linalg.solve(covariance_m2, off_m[..., None])[..., 0]
    dof = int(off_m.shape[-1])
    return Misfit(np.asarray(np.sum(off_m * solved, axis=-1)), dof, dof)


def _from_sphere(enu_m: Reals, covariance_m2: Reals, distance_m: float, sigma_m: float) -> Reals:
    """Smallest over b of (enu - b)^T W (enu - b) + ((|b| - D) / sigma)^2, W = C^-1, shapes (..., 3), (..., 3, 3).

    Where the gradient is zero W (enu - b) = m b with m = (1 - D / |b|) / sigma^2, so b = (W + m)^-1 W enu. As m grows
    from minus the least eigenvalue of W to 1 / sigma^2, |b| falls from infinity, and D / (1 - m sigma^2), which it must
    equal, rises to infinity: there is one solution between, the smallest value of all; bisection finds it.
    """
    weight, axes = np.linalg.eigh(np.linalg.inv(covariance_m2))
    along_m = np.einsum("...ij,...i->...j", axes, enu_m)
    along_m = np.where(np.abs(along_m) < _LEAST_M, _LEAST_M, along_m)  # with nothing along the weakest axis b may turn
    low, high = -weight[..., 0], np.full(enu_m.shape[:-1], 1.0 / sigma_m**2)
    for _ in range(_ROUNDS):
        m = 0.5 * (low + high)
        length_m = np.linalg.norm(weight * along_m / (weight + m[..., None]), axis=-1)
        longer = length_m * (1.0 - m * sigma_m**2) > distance_m
        low, high = np.where(longer, m, low), np.where(longer, high, m)
    b = weight * along_m / (weight + high[..., None])
    radius_m = np.linalg.norm(b, axis=-1)
    return np.asarray(np.sum(weight * (along_m - b) ** 2, axis=-1) + ((radius_m - distance_m) / sigma_m) ** 2)
