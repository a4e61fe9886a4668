"""Fit two skies to all satellites' correlations of a burst at once, in place and clock.

Each satellite shows one signal of either sky. Their delays follow from two places and clocks: eight unknowns for all,
instead of two delays for each. Amplitudes are free in each interval and solved for (variable projection). Searched is

    F(x, x') = sum over satellites of Q(tau(x), tau(x'))

with Q of `bursts`. A satellite whose second signal noise alone would hide still counts, and one whose signals coincide
costs nothing. The fit begins where four satellites' own pairs of delays put two skies, one of each pair in either.

Where signals nearly coincide, F is no paraboloid and has several tops: its curvature at the highest one promises more
than is known. The likelihood itself holds: 2 (F - F at the truth) over a dispersion is chi-square of eight degrees.
The dispersion is the residual over that of noise of variance one, times what noise in the amplitudes adds to the slopes
(Kent, Biometrika 69(1), 1982; Stoica and Nehorai, IEEE Trans. ASSP 38(12), 1990). So places and their covariance are
the mean and spread over the whole likelihood, by importance sampling about all its tops. The covariance is then scaled
until the ellipsoid of `set_probability` encloses the likelihood-ratio region of it (Wilks, Ann. Math. Stat. 9, 1938).

Whether there are two skies is asked twice. One sky with noise explains as much as two by a chance that is bounded by
chi-square of the free amplitudes, times the number of places that the second sky might have. Signals that have nothing
to do with each other fit a position by the chance of `navigation.chance`, each as well known as its satellite alone
shows it.

What multipath and the atmosphere do to a range, alike in all intervals, is in the covariance and in the statistics,
not in the fit.
"""

from collections.abc import Sequence
from functools import cache
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from skyproof.arrays import Booleans, Complexes, Reals
from skyproof.compiled import compiled
from skyproof.decomposition.kernels import table_at
from skyproof.detectors.dccaf.bursts import Decomposed, joint_p_value
from skyproof.detectors.dccaf.policy import POLICY
from skyproof.navigation.chance import bound_chance_p_value
from skyproof.navigation.least_squares import design_matrix
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["FittedSkies", "fit_skies"]

_STARTED_FROM = 8
"""Satellites, those of the clearest second signals: 70 fours of them, 8 pairings each."""
_CLIMBED = 24
"""Of the starts that explain most, each unlike the others."""
_UNLIKE_CHIPS = 0.1
"""By which a delay of one start differs from that of another that is climbed too."""
_STEPS = 40
_SMALL_M = 0.1
_RIDGE = 0.01
"""Amplitudes ten times as large as one signal alone would have are as improbable as one sigma of noise: two signals
that nearly coincide may not cancel each other."""
_PAIRINGS = np.array([(0, second, third, fourth) for second in (0, 1) for third in (0, 1) for fourth in (0, 1)])
_DRAWN = 500
"""Points about the tops, and as many again, half of them about the mean."""
_TAIL_DEGREES = 5.0
"""Of the t distribution that points are drawn from: its tails are heavier than those of the likelihood."""
_FEWEST_M2, _MOST_M2 = 0.25, 1e5
"""Variances that points are drawn with."""
_UNKNOWNS = 8


class FittedSkies(NamedTuple):
    """state_m (2, 4), covariance_m2 (2, 4, 4): place and clock of each sky from the reference. statistic (2,),
    chi-square with `dof` degrees for a true sky. apart (n,) : the satellites whose two signals are apart. sigma_m
    (n, 2): of what each satellite's own correlation shows of its signals. late_m (n,): by how much that of the second
    sky is later. weaker_db (n,) : it is. doubt : bound of the probability that these are not two skies."""

    state_m: Reals
    covariance_m2: Reals
    statistic: Reals
    dof: int
    apart: Booleans
    sigma_m: Reals
    late_m: Reals
    weaker_db: Reals
    doubt: float


class _Data(NamedTuple):
    """Satellites' whitened intervals (n, k, d) and tables (n, g, d), with `ridge` (n,). From two states (2, 4) to
    delays (n, 2): design (n, 4), a chip a metre, and zero_chips (n,). slack_chips2 (n,): variance of what a delay is
    off by in all intervals alike. prior_chips2 : of a delay within the window."""

    white: Complexes
    first: float
    step: float
    value: Reals
    slope: Reals
    ridge: Reals
    design: Reals
    zero_chips: Reals
    slack_chips2: Reals
    prior_chips2: float

    def compute_delays(self, state_m: Reals) -> Reals:
        """Compute the delays (..., n, 2) of states (..., 2, 4)."""
        return np.asarray(np.einsum("ij,...kj->...ik", self.design, state_m) + self.zero_chips[:, None])

    def project(self, matrices: Reals) -> Reals:
        """Sum matrices of both delays (..., n, 2, 2) to one of both states (..., 8, 8)."""
        summed = np.einsum("ni,...nab,nj->...aibj", self.design, matrices, self.design)
        return np.asarray(summed.reshape(*summed.shape[:-4], 8, 8))


class _Local(NamedTuple):
    """What delays explain, (..., n), its slopes (..., n, 2), the variance of those (..., n, 2, 2), the information on
    both delays (..., n, 2, 2), and the signals' energies (..., n, 2). The variance has what noise adds to amplitudes;
    the information has not."""

    explained: Reals
    slope: Reals
    slope_variance: Reals
    information: Reals
    energy: Reals


class _Cloud(NamedTuple):
    """What points are drawn from: t about `center` (8,) with the scale `root` (8, 8); `share` of all points."""

    center: Reals
    root: Reals
    share: float


class _Top(NamedTuple):
    """A pair of skies (8,), what it explains, and the covariance (8, 8) by its curvature."""

    state_m: Reals
    explained: float
    covariance_m2: Reals


def fit_skies(
    signals: Sequence[Decomposed],
    unit: Reals,
    zero_m: Reals,
    systematic_m: Reals,
    chip_m: Reals,
    *,
    window_chips: float,
    set_probability: float,
    most_doubt: float,
) -> FittedSkies | None:
    """Fit two skies to a burst; None where it does not show them.

    Parameters
    ----------
    signals : one of each satellite (n,).
    unit : (n, 3) to the satellites from a place near both fixes, in any axes.
    zero_m : (n,) range that the grid's zero shows minus that modelled at that place.
    systematic_m : (n,) one sigma of what a range is off by, in all intervals alike.
    chip_m : (n,) of each signal's code.
    window_chips : delays are searched so far to both sides of the grid's zero.
    set_probability : that a true sky fails its chi-square test; also that noise takes one sky for two places.
    most_doubt : largest `doubt`.
    """
    n = len(signals)
    if n < POLICY.least_satellites:
        return None
    intervals, reach_m = signals[0].white.shape[0], window_chips * float(chip_m.max())
    alone = float(sum(signal.found.alone[0] for signal in signals))
    most = float(sum(signal.found.second[0] for signal in signals))
    if _bound_noise_chance(most, n, intervals, reach_m, float(chip_m.max())) > most_doubt:
        return None  # no two skies explain more than each satellite's own pair
    data = _build_data(signals, unit, zero_m, systematic_m, chip_m, window_chips)
    tops = _search(data, signals)
    if not tops:
        return None
    best = max(tops, key=lambda top: top.explained)
    local = _look(data, data.compute_delays(best.state_m.reshape(2, 4)))
    free = np.linalg.inv(local.information + np.eye(2) / data.prior_chips2)
    spread_chips2 = np.diagonal(free, axis1=1, axis2=2) + data.slack_chips2[:, None]
    off_chips = np.einsum("nab,nb->na", free, local.slope)
    statistic, dof = np.sum(off_chips**2 / spread_chips2, axis=0), n - 4
    if (statistic > chi_square_threshold(set_probability, dof)).any() or _has_other_signals(
        data, signals, best, set_probability
    ):
        return None
    integrated = _integrate(data, tops, best, set_probability)
    if integrated is None:
        return None
    state_m, covariance_m2 = integrated
    apart = np.concatenate((-np.eye(4), np.eye(4)), axis=1)
    difference_m = apart @ state_m
    distance = difference_m @ np.linalg.solve(apart @ covariance_m2 @ apart.T, difference_m)
    if distance < chi_square_threshold(set_probability, 4):
        return None
    late_chips = data.design @ difference_m
    is_apart = np.abs(late_chips) > POLICY.apart_sigmas * np.sqrt(free[:, 0, 0] + free[:, 1, 1] - 2.0 * free[:, 0, 1])
    sigma_m, fits = chip_m[:, None] * np.sqrt(spread_chips2), max(float(statistic.max()), float(dof))
    tried = 2.0 ** max(int(is_apart.sum()) - 1, 0)  # either signal may be in the first sky, where they differ
    by_chance = float(
        bound_chance_p_value(sigma_m.T, window_m=2.0 * reach_m, largest_statistic=fits, combinations=tried).max()
    )
    noise = _bound_noise_chance(2.0 * (best.explained - alone), n, intervals, reach_m, float(sigma_m.min()))
    if by_chance + noise > most_doubt:
        return None
    first, second = np.maximum(local.energy, 1e-9).T
    return FittedSkies(
        state_m=state_m.reshape(2, 4),
        covariance_m2=np.stack([covariance_m2[:4, :4], covariance_m2[4:, 4:]]),
        statistic=statistic,
        dof=dof,
        apart=is_apart,
        sigma_m=sigma_m,
        late_m=chip_m * late_chips,
        weaker_db=10.0 * np.log10(first / second),
        doubt=by_chance + noise,
    )


def _has_other_signals(data: _Data, signals: Sequence[Decomposed], top: _Top, probability: float) -> bool:
    """Test whether a satellite's own pair explains more than both skies, by more than noise and systematic errors do.

    Where both skies' delays are right, that more is smaller than what a second signal explains under one.
    """
    delays = data.compute_delays(top.state_m.reshape(2, 4))
    local, slack = _look(data, delays), data.slack_chips2[:, None]
    stiff = local.information + np.eye(2) / data.prior_chips2 + np.eye(2) / slack[..., None]
    moved = np.linalg.solve(stiff, local.slope[..., None])[..., 0]
    both = 2.0 * _look(data, delays + moved).explained - np.sum(moved**2 / slack, axis=1)
    for signal, explained in zip(signals, both, strict=True):
        more = signal.found.second[0] + 2.0 * signal.found.alone[0] - explained
        if joint_p_value(more, len(signal.white), signal.shapes.path) < probability / len(signals):
            return True
    return False


def _integrate(data: _Data, tops: Sequence[_Top], best: _Top, set_probability: float) -> tuple[Reals, Reals] | None:
    """Compute the mean (8,) and covariance (8, 8) of both skies over the whole likelihood; None if points miss it.

    Points are drawn about all tops that the likelihood-ratio region may hold, then about their mean as well.
    """
    most = float(chi_square_threshold(set_probability, 3))  # of one place, whatever the five other unknowns are
    dispersion = _measure_dispersion(data, best)
    near = [top for top in tops if 2.0 * (best.explained - top.explained) < most * dispersion]
    share = 0.75 / len(near)
    clouds = [_Cloud(_order_skies(top.state_m, best.state_m), _root(1.5 * top.covariance_m2), share) for top in near]
    tries, tails = _draw_nodes()
    points = _place_nodes(clouds, tries[:_DRAWN], tails[:_DRAWN])
    explained = _sum_explained(data, points) / dispersion
    mean, covariance, _ = _average(points, _weigh(points, explained, clouds))
    clouds.append(_Cloud(mean, _root(1.2 * covariance), 0.25))
    half = _DRAWN + _DRAWN // 2
    more = (
        _place_nodes(clouds[:-1], tries[_DRAWN:half], tails[_DRAWN:half]),
        _place_nodes(clouds[-1:], tries[half:], tails[half:]),
    )
    points = np.concatenate((points, *more))
    explained = np.concatenate((explained, _sum_explained(data, points[_DRAWN:]) / dispersion))
    weight = _weigh(points, explained, clouds)
    if np.sum(weight**2) > 0.5 / _UNKNOWNS:  # no more points than twice the unknowns
        return None
    points = _order_skies(points, best.state_m)
    mean, covariance, about = _average(points, weight)
    highest = max(best.explained / dispersion, float(explained.max()))
    about = about[np.asarray(explained) > highest - 0.5 * most]
    blocks = [slice(0, 3), slice(4, 7)]
    distances = [_measure_distance(about[:, k], covariance[k, k]) for k in blocks]
    largest = float(np.concatenate(distances).max(initial=0.0))
    return mean, max(largest / most, 1.0) * covariance + _spread_slack(data, mean)


def _measure_dispersion(data: _Data, top: _Top) -> float:
    """Measure by how much the likelihood's differences are too large, at least one."""
    n, intervals, _ = data.white.shape
    local = _look(data, data.compute_delays(top.state_m.reshape(2, 4)))
    left_over = np.sum(np.abs(data.white) ** 2) - local.explained.sum()
    noise = left_over / (np.count_nonzero(data.white) - 2 * n * intervals)
    slopes = np.trace(np.linalg.solve(data.project(local.information), data.project(local.slope_variance))) / _UNKNOWNS
    return float(max(noise, 1.0) * max(slopes, 1.0))


def _average(points: Reals, weight: Reals) -> tuple[Reals, Reals, Reals]:
    """Compute mean (8,) and covariance (8, 8) of weighted points (m, 8), and the points from the mean."""
    mean = weight @ points
    about = points - mean
    return mean, about.T @ (about * weight[:, None]), about


def _measure_distance(about: Reals, covariance: Reals) -> Reals:
    """Measure the squared distance of points (m, k) in sigmas (m,)."""
    return np.asarray(np.sum(about.T * np.linalg.solve(covariance, about.T), axis=0))


def _order_skies(points: Reals, reference: Reals) -> Reals:
    """Exchange the skies of points (..., 8) where that brings them nearer to a reference (8,)."""
    exchanged = np.roll(points, 4, axis=-1)
    nearer = np.linalg.norm(exchanged - reference, axis=-1) < np.linalg.norm(points - reference, axis=-1)
    return np.where(nearer[..., None], exchanged, points)


@cache
def _draw_nodes() -> tuple[Reals, Reals]:
    """Draw normal points (2 _DRAWN, 8) and what lengthens each to a point of the t distribution (2 _DRAWN, 1).

    The same ones serve every burst.
    """
    rng = np.random.default_rng(1)
    tries = rng.standard_normal((2 * _DRAWN, _UNKNOWNS))
    return tries, np.sqrt(_TAIL_DEGREES / rng.chisquare(_TAIL_DEGREES, (2 * _DRAWN, 1)))


def _place_nodes(clouds: Sequence[_Cloud], tries: Reals, tails: Reals) -> Reals:
    """Place points (m, 8) in clouds by turns."""
    turn = np.arange(len(tries)) % len(clouds)
    center, root = np.stack([cloud.center for cloud in clouds]), np.stack([cloud.root for cloud in clouds])
    return np.asarray(center[turn] + tails * np.einsum("mij,mj->mi", root[turn], tries))


def _weigh(points: Reals, explained: Reals, clouds: Sequence[_Cloud]) -> Reals:
    """Weigh points (m, 8) by likelihood over the density that they were drawn with; the sum is one."""
    degrees, logs = _TAIL_DEGREES + _UNKNOWNS, np.empty((len(clouds), len(points)))
    for k, cloud in enumerate(clouds):
        far = np.sum(np.linalg.solve(cloud.root, (points - cloud.center).T) ** 2, axis=0)
        scale = np.log(cloud.share) - np.sum(np.log(np.diag(cloud.root)))
        logs[k] = scale - 0.5 * degrees * np.log1p(far / _TAIL_DEGREES)
    log_weight = explained - logsumexp(logs, axis=0)
    return np.asarray(np.exp(log_weight - logsumexp(log_weight)))


def _root(covariance_m2: Reals) -> Reals:
    """Compute the lower root of a covariance (8, 8), its variances within what points are drawn with."""
    values, vectors = np.linalg.eigh(covariance_m2)
    return np.asarray(np.linalg.cholesky((vectors * np.clip(values, _FEWEST_M2, _MOST_M2)) @ vectors.T))


def _spread_slack(data: _Data, state_m: Reals) -> Reals:
    """Compute the covariance (8, 8) of both skies by what ranges are off by in all intervals alike."""
    information = _look(data, data.compute_delays(state_m.reshape(2, 4))).information
    inverse = np.linalg.pinv(data.project(information), hermitian=True)
    slack = information @ (data.slack_chips2[:, None, None] * information)
    return np.asarray(inverse @ data.project(slack) @ inverse)


def _bound_noise_chance(statistic: float, n: int, intervals: int, reach_m: float, sigma_m: float) -> float:
    """Bound the chance that noise of one sky explains so much more as two.

    Chi-square of all free amplitudes and of the delays, wherever in four dimensions the second sky is, a step of a
    sigma each.
    """
    places = max(2.0 * reach_m / sigma_m, 1.0) ** 4
    return min(places * float(chi_square_survival(max(statistic, 0.0), 2 * intervals * n + n)), 1.0)


def _build_data(
    signals: Sequence[Decomposed], unit: Reals, zero_m: Reals, systematic_m: Reals, chip_m: Reals, window_chips: float
) -> _Data:
    """Build what the kernels work on."""
    size = max(signal.white.shape[1] for signal in signals)

    def stack(arrays: Sequence[Reals | Complexes]) -> Any:
        return np.stack([np.pad(array, ((0, 0), (0, size - array.shape[1]))) for array in arrays])

    tables = [signal.shapes for signal in signals]
    middle = len(tables[0].grid) // 2
    strength = np.array([max(signal.found.alone[0] / len(signal.white) - 1.0, 1.0) for signal in signals])
    square = np.array([np.sum(table.value[middle] ** 2) for table in tables])
    return _Data(
        white=stack([signal.white for signal in signals]),
        first=float(tables[0].grid[0]),
        step=float(tables[0].grid[1] - tables[0].grid[0]),
        value=stack([table.value for table in tables]),
        slope=stack([table.slope for table in tables]),
        ridge=_RIDGE * square / strength,
        design=design_matrix(unit) / chip_m[:, None],
        zero_chips=-zero_m / chip_m,
        slack_chips2=(systematic_m / chip_m) ** 2,
        prior_chips2=window_chips**2,
    )


def _search(data: _Data, signals: Sequence[Decomposed]) -> list[_Top]:
    """Find the tops that the starts which explain most lead to."""
    pairs = np.stack([signal.found.two_chips[0] for signal in signals]) - data.zero_chips[:, None]
    clear = np.argsort([-signal.found.second[0] for signal in signals], kind="stable")[:_STARTED_FROM]
    starts: list[Reals] = []
    for four in combinations(np.sort(clear).tolist(), 4):
        rows = np.array(four)
        if np.linalg.cond(data.design[rows]) > POLICY.most_condition:
            continue
        back = np.linalg.inv(data.design[rows])
        firsts = pairs[rows, _PAIRINGS] @ back.T
        starts.append(np.concatenate((firsts, pairs[rows, 1 - _PAIRINGS] @ back.T), axis=1))
    every = np.concatenate(starts) if starts else np.empty((0, _UNKNOWNS))
    every = every[np.isfinite(every).all(axis=1)]
    if not every.size:
        return []
    every = every[np.argsort(-_sum_explained(data, every), kind="stable")]
    return _climb(data, np.stack(_select_unlike(data, every)).reshape(-1, 2, 4))


def _select_unlike(data: _Data, states_m: Reals) -> list[Reals]:
    """Select the first states (m, 8) whose delays differ from those of all selected ones, at most `_CLIMBED`."""
    delays = data.compute_delays(states_m.reshape(-1, 2, 4))
    waiting, selected = np.arange(len(states_m)), list[Reals]()
    while waiting.size and len(selected) < _CLIMBED:
        first = delays[waiting[0]]
        selected.append(states_m[waiting[0]])
        off = [np.abs(delays[waiting] - order).max(axis=(1, 2)) for order in (first, first[:, ::-1])]
        waiting = waiting[np.minimum(*off) > _UNLIKE_CHIPS]
    return selected


def _climb(data: _Data, starts_m: Reals) -> list[_Top]:
    """Climb to the tops near pairs of states (m, 2, 4), by damped Gauss-Newton steps of all at once.

    Tops that leave a direction open are left out.
    """
    states_m, damping, climbing = starts_m.copy(), np.full(len(starts_m), 1e-3), np.arange(len(starts_m))
    local = _look(data, data.compute_delays(states_m))
    for _ in range(_STEPS):
        slope = np.einsum("ni,mna->mai", data.design, local.slope[climbing]).reshape(-1, 8, 1)
        whole = data.project(local.information[climbing])
        scale = damping[climbing, None] * np.maximum(np.diagonal(whole, axis1=1, axis2=2), 1e-12)
        steps_m = np.linalg.solve(whole + scale[:, None] * np.eye(8), slope).reshape(-1, 2, 4)
        after = _look(data, data.compute_delays(states_m[climbing] + steps_m))
        higher = after.explained.sum(axis=1) > local.explained[climbing].sum(axis=1)
        states_m[climbing[higher]] += steps_m[higher]
        for before, now in zip(local, after, strict=True):
            before[climbing[higher]] = now[higher]
        damping[climbing] = np.where(higher, np.maximum(0.2 * damping[climbing], 1e-6), 6.0 * damping[climbing])
        arrived = np.where(higher, np.abs(steps_m).max(axis=(1, 2)) < _SMALL_M, damping[climbing] > 1e6)
        climbing = climbing[~arrived]
        if not climbing.size:
            break
    whole = data.project(local.information)
    closed = np.flatnonzero(np.linalg.cond(whole) <= POLICY.most_condition**2)
    covariances_m2 = np.linalg.inv(whole[closed])
    return [
        _Top(states_m[row].ravel(), float(local.explained[row].sum()), covariance_m2)
        for row, covariance_m2 in zip(closed.tolist(), covariances_m2, strict=True)
    ]


def _sum_explained(data: _Data, states_m: Reals) -> Reals:
    """Sum over satellites what states (m, 8) explain (m,)."""
    out = np.empty(len(states_m))
    _explain_all(*data[:6], np.ascontiguousarray(data.compute_delays(states_m.reshape(-1, 2, 4))), out)
    return out


def _look(data: _Data, delays_chips: Reals) -> _Local:
    """Compute what delays (..., n, 2) explain, and how that changes."""
    each = np.ascontiguousarray(delays_chips).reshape(-1, *delays_chips.shape[-2:])
    shape = each.shape[:2]
    found = (np.empty(shape), np.empty((*shape, 2)), *np.empty((2, *shape, 2, 2)), np.empty((*shape, 2)))
    _explain(*data[:6], each, *found)
    return _Local(*(field.reshape(*delays_chips.shape[:-2], *field.shape[1:]) for field in found))


@compiled
def _explain(white, first, step, value, slope, ridge, delays, explained, slopes, variance, information, energy):  # type: ignore[no-untyped-def]
    """Fill a `_Local` of delays (m, n, 2); a signal outside the tables contributes nothing."""
    n, intervals, size = white.shape
    v, s, rest = np.empty((2, size)), np.empty((2, size)), np.empty(size, np.complex128)
    last = first + step * (value.shape[1] - 1)
    for p in range(delays.shape[0]):
        for i in range(n):
            for a in range(2):
                v[a] = 0.0
                s[a] = 0.0
                if first <= delays[p, i, a] <= last:
                    table_at(delays[p, i, a], first, step, value[i], slope[i], v[a], s[a])
            g11, g22, g12 = np.sum(v[0] ** 2) + ridge[i], np.sum(v[1] ** 2) + ridge[i], np.sum(v[0] * v[1])
            det = g11 * g22 - g12 * g12
            h11, h22, h12 = g22 / det, g11 / det, -g12 / det
            e11, e22, e12 = 0.0, 0.0, 0.0
            explained[p, i] = 0.0
            slopes[p, i] = 0.0
            for k in range(intervals):
                b1, b2 = 0.0j, 0.0j
                for d in range(size):
                    b1 += v[0, d] * white[i, k, d]
                    b2 += v[1, d] * white[i, k, d]
                a1, a2 = h11 * b1 + h12 * b2, h12 * b1 + h22 * b2
                explained[p, i] += (np.conj(b1) * a1 + np.conj(b2) * a2).real
                e11 += abs(a1) ** 2
                e22 += abs(a2) ** 2
                e12 += (np.conj(a1) * a2).real
                for d in range(size):
                    rest[d] = white[i, k, d] - v[0, d] * a1 - v[1, d] * a2
                t1, t2 = 0.0j, 0.0j
                for d in range(size):
                    t1 += s[0, d] * rest[d]
                    t2 += s[1, d] * rest[d]
                slopes[p, i, 0] += 2.0 * (np.conj(a1) * t1).real
                slopes[p, i, 1] += 2.0 * (np.conj(a2) * t2).real
            p11, p12 = np.sum(v[0] * s[0]), np.sum(v[1] * s[0])
            p21, p22 = np.sum(v[0] * s[1]), np.sum(v[1] * s[1])
            n11 = np.sum(s[0] ** 2) - (p11 * p11 * h11 + 2.0 * p11 * p12 * h12 + p12 * p12 * h22)
            n22 = np.sum(s[1] ** 2) - (p21 * p21 * h11 + 2.0 * p21 * p22 * h12 + p22 * p22 * h22)
            n12 = np.sum(s[0] * s[1]) - (p11 * p21 * h11 + (p11 * p22 + p12 * p21) * h12 + p12 * p22 * h22)
            variance[p, i, 0, 0], variance[p, i, 1, 1] = 2.0 * e11 * n11, 2.0 * e22 * n22
            variance[p, i, 0, 1] = variance[p, i, 1, 0] = 2.0 * e12 * n12
            e11, e22 = max(e11 - intervals * h11, 0.0), max(e22 - intervals * h22, 0.0)
            bound = np.sqrt(e11 * e22)
            e12 = min(max(e12 - intervals * h12, -bound), bound)
            energy[p, i, 0], energy[p, i, 1] = e11 / intervals, e22 / intervals
            information[p, i, 0, 0], information[p, i, 1, 1] = 2.0 * e11 * n11, 2.0 * e22 * n22
            information[p, i, 0, 1] = information[p, i, 1, 0] = 2.0 * e12 * n12


@compiled
def _explain_all(white, first, step, value, slope, ridge, delays, out):  # type: ignore[no-untyped-def]
    """Sum over satellites what each of many delays (m, n, 2) explains, into (m,)."""
    n, intervals, size = white.shape
    v, s = np.empty((2, size)), np.empty((2, size))
    last = first + step * (value.shape[1] - 1)
    for p in range(delays.shape[0]):
        out[p] = 0.0
        for i in range(n):
            for a in range(2):
                v[a] = 0.0
                if first <= delays[p, i, a] <= last:
                    table_at(delays[p, i, a], first, step, value[i], slope[i], v[a], s[a])
            g11, g22, g12 = np.sum(v[0] ** 2) + ridge[i], np.sum(v[1] ** 2) + ridge[i], np.sum(v[0] * v[1])
            e1, e2, x = 0.0, 0.0, 0.0
            for k in range(intervals):
                b1, b2 = 0.0j, 0.0j
                for d in range(size):
                    b1 += v[0, d] * white[i, k, d]
                    b2 += v[1, d] * white[i, k, d]
                e1 += abs(b1) ** 2
                e2 += abs(b2) ** 2
                x += (np.conj(b1) * b2).real
            out[p] += (e1 * g22 + e2 * g11 - 2.0 * g12 * x) / (g11 * g22 - g12 * g12)
