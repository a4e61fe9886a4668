"""Position, velocity and clock over time: a Kalman filter on code, carrier and Doppler of one frequency.

State, all in metres and seconds: ECEF position and velocity; c times clock bias and drift; c times the offset of every
further time scale; and for each signal two errors of its own:

    code    = range + clock + offset + troposphere + ionosphere + b + noise
    carrier = range + clock + offset + troposphere - ionosphere + n + noise

b, the error that stays in the code (multipath, what the models leave of the ionosphere, orbit and clock), fades and
renews itself with time: a Gauss-Markov process. Without it a filter at rest would average for an hour and claim
millimetres. n, the ambiguity, is constant in an arc but for a random walk, which takes up the carrier's own slow
errors and the drift of the ionosphere against the code. An ambiguity for each arc, and not differences of the carrier
from epoch to epoch: those share the noise of an epoch in two differences, and a filter that takes them for independent
claims too much.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from skyproof.arrays import Booleans, Indices, Instants, Integers, Reals
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.time import week_and_tow
from skyproof.navigation.fix import RangeRates, compute_range_rates, fix
from skyproof.navigation.least_squares import compute_line_of_sight
from skyproof.navigation.ranges import Ranges, compute_atmosphere, compute_space_sigma_m, correct_ranges, time_scale
from skyproof.navigation.vector_filter import CLOCK, CORE, DRIFT, POSITION, VELOCITY
from skyproof.records import CellStatus, Fix, FixStatus, NavigationData, Observations, Selectable, SignalId
from skyproof.statistics.distributions import chi_square_threshold
from skyproof.statistics.kalman import kalman_update
from skyproof.studies.position_filter_state import FilterSettings, FilterState, drop_old, predict

__all__ = ["FilterSettings", "FilterState", "Filtered", "step"]

# Priors that say nothing beside any measurement, and are small enough to keep all digits beside the carrier's noise.
_OPEN_M = 100.0
_OPEN_M_S = 300.0
_OPEN_DRIFT_M_S = 3000.0  # 1e-5
_FAR_M = 50.0  # beyond this a range is no longer linear to a tenth of a millimetre
_JUMP_M = 1000.0  # receivers move their clocks by a millisecond, 300 km; oscillators do not do the hundredth of it


@dataclass(frozen=True, eq=False, kw_only=True)
class Filtered:
    """What `step` gives out.

    fix : residuals are the code's, with the errors b left in. Status 1 where no measurement was used.
    nis, nis_dof : (n_epochs,) normalised innovation squared, chi-square with that many degrees; NaN at a start.
    rejected : (n_epochs, n_signals) a code or Doppler did not fit and was not used.
    slipped : (n_epochs, n_signals) a carrier did not fit the one before: a slip that nothing had reported.
    """

    fix: Fix
    nis: Reals
    nis_dof: Integers
    rejected: Booleans
    slipped: Booleans


def step(
    state: FilterState | None,
    observations: Observations,
    navigation: NavigationData,
    *,
    settings: FilterSettings | None = None,
    signals: tuple[SignalId, ...] | None = None,
) -> tuple[Filtered, FilterState | None]:
    """Filter the epochs of `observations`, after those that `state` comes from; pieces give what the whole gives.

    Ends and beginnings of signals need no care. An arc ends at a slip (status 3, or a carrier that does not fit), at a
    gap, and when the receiver moves its clock. The filter starts at the first epoch with a fix.

    Parameters
    ----------
    state : from the piece before, None at the start.
    signals : those to use, by default all; at most one of a satellite at a time.

    Raises
    ------
    ValueError : as `fix`; or the epochs do not come in the order of time.
    """
    settings = settings or FilterSettings()
    signals = observations.signals if signals is None else signals
    if np.any(np.diff(observations.gpst) <= np.timedelta64(0)) or (
        state is not None and observations.gpst.size and observations.gpst[0] <= state.gpst
    ):
        raise ValueError(f"the epochs of {observations.receiver} must come in the order of time, after those filtered")
    rows = _rows(observations, signals, navigation)
    n = observations.gpst.size
    out, first = _Out(observations.gpst, len(signals)), 0
    if state is None:
        state, first = _start(observations, navigation, signals, settings)
    if state is not None:
        for row in range(first, n):
            state = _epoch(state, rows, row, navigation, settings, out)
    return out.build_result(observations.receiver, signals), state


# ---------------------------------------------------------------- what comes in and what goes out


@dataclass(frozen=True, eq=False, kw_only=True)
class _Rows:
    """The signals in use over all epochs of a piece: arrays (epoch, channel), or (channel,) for what does not change.

    carrier_m has the satellite's clock taken off, as ranges.range_m has.
    """

    gpst: Instants
    tow_s: Reals
    signals: tuple[SignalId, ...]
    scales: tuple[str, ...]  # of each channel
    ranges: Ranges
    carrier_m: Reals
    doppler_hz: Reals
    code_sigma_m: Reals
    carrier_sigma_m: Reals
    doppler_sigma_hz: Reals
    slip: Booleans
    carrier_hz: Reals
    space_m: Reals


def _rows(observations: Observations, signals: tuple[SignalId, ...], navigation: NavigationData) -> _Rows:
    columns = [observations.signals.index(signal) for signal in signals]
    pseudorange_m = observations.pseudorange_m[:, columns]
    carrier_hz = observations.carrier_hz[columns]
    wavelength_m = SPEED_OF_LIGHT_M_S / carrier_hz
    ranges = correct_ranges(signals, observations.gpst, pseudorange_m, navigation)
    return _Rows(
        gpst=observations.gpst,
        tow_s=week_and_tow(observations.gpst)[1],
        signals=signals,
        scales=tuple(time_scale(signal) for signal in signals),
        ranges=ranges,
        carrier_m=observations.carrier_cyc[:, columns] * wavelength_m + (ranges.range_m - pseudorange_m),
        doppler_hz=observations.doppler_hz[:, columns],
        code_sigma_m=observations.pseudorange_sigma_m[:, columns],
        carrier_sigma_m=observations.carrier_sigma_cyc[:, columns] * wavelength_m,
        doppler_sigma_hz=observations.doppler_sigma_hz[:, columns],
        slip=observations.status[:, columns] == CellStatus.SLIP,
        carrier_hz=carrier_hz,
        space_m=compute_space_sigma_m(signals),
    )


class _Out:
    """Where the epochs of a piece write their results."""

    def __init__(self, gpst: Instants, channels: int) -> None:
        n = gpst.size
        self.gpst = gpst
        self.core, self.covariance = np.full((n, CORE), np.nan), np.full((n, 4, 4), np.nan)
        self.residual_m = np.full((n, channels), np.nan)
        self.status = np.full(n, FixStatus.TOO_FEW, np.uint8)
        self.offset_m: dict[str, Reals] = {}
        self.nis, self.nis_dof = np.full(n, np.nan), np.zeros(n, np.int64)
        self.rejected, self.slipped = np.zeros((n, channels), np.bool_), np.zeros((n, channels), np.bool_)

    def write(self, row: int, state: FilterState) -> None:
        self.core[row] = state.mean[:CORE]
        kept = [0, 1, 2, CLOCK]
        self.covariance[row] = state.covariance[np.ix_(kept, kept)]
        self.status[row] = FixStatus.OK
        offsets_m = np.concatenate(([0.0], state.mean[CORE : CORE + len(state.scales) - 1]))
        for scale, offset_m in zip(state.scales, offsets_m, strict=True):
            self.offset_m.setdefault(scale, np.full(self.gpst.size, np.nan))[row] = offset_m

    def build_result(self, receiver: str, signals: tuple[SignalId, ...]) -> Filtered:
        bias_s = self.core[:, CLOCK] / SPEED_OF_LIGHT_M_S
        bias_ns = np.rint(np.nan_to_num(bias_s) * 1e9).astype(np.int64)
        found = Fix(
            receiver=receiver,
            signals=signals,
            gpst=self.gpst - bias_ns.astype("timedelta64[ns]"),
            position_ecef_m=self.core[:, POSITION],
            velocity_ecef_m_s=self.core[:, VELOCITY],
            clock_bias_s=bias_s,
            clock_drift=self.core[:, DRIFT] / SPEED_OF_LIGHT_M_S,
            covariance_m2=self.covariance,
            residual_m=self.residual_m,
            status=self.status,
            inter_system_s={scale: offset_m / SPEED_OF_LIGHT_M_S for scale, offset_m in self.offset_m.items()},
        )
        return Filtered(fix=found, nis=self.nis, nis_dof=self.nis_dof, rejected=self.rejected, slipped=self.slipped)


def _start(
    observations: Observations, navigation: NavigationData, signals: tuple[SignalId, ...], settings: FilterSettings
) -> tuple[FilterState | None, int]:
    """Build a state without signals at the first epoch with a fix, and return that epoch."""
    found = fix(
        observations,
        navigation,
        signals=signals,
        elevation_mask_deg=settings.elevation_mask_deg,
        multipath_sigma_m=settings.multipath_sigma_m,
        ionosphere_share=settings.ionosphere_share,
        false_alarm_probability=settings.false_alarm_probability,
    )
    good = np.flatnonzero(found.status == FixStatus.OK)
    if good.size == 0:
        return None, 0
    row = int(good[0])
    offsets_m = {scale: SPEED_OF_LIGHT_M_S * float(s[row]) for scale, s in found.inter_system_s.items()}
    scales = tuple(scale for scale, offset_m in offsets_m.items() if np.isfinite(offset_m))
    velocity = np.append(found.velocity_ecef_m_s[row], SPEED_OF_LIGHT_M_S * found.clock_drift[row])
    sigma_m_s = np.where(np.isfinite(velocity), _OPEN_M_S, [_OPEN_M_S, _OPEN_M_S, _OPEN_M_S, _OPEN_DRIFT_M_S])
    velocity = np.nan_to_num(velocity)
    if settings.mode == "static":
        velocity[:3], sigma_m_s[:3] = 0.0, 0.0
    clock_m = SPEED_OF_LIGHT_M_S * found.clock_bias_s[row]
    further = [offsets_m[scale] for scale in scales[1:]]
    mean = np.concatenate((found.position_ecef_m[row], velocity[:3], [clock_m, velocity[3]], further))
    sigma = np.concatenate(([_OPEN_M] * 3, sigma_m_s[:3], [_OPEN_M, sigma_m_s[3]], [_OPEN_M] * len(further)))
    none = np.zeros(0, "datetime64[ns]")
    return FilterState(
        gpst=observations.gpst[row],
        scales=scales,
        mean=mean,
        covariance=np.diag(sigma**2),
        signals=(),
        seen=none,
        carried=none,
        error_sigma_m=np.zeros(0),
    ), row


# ---------------------------------------------------------------- one epoch


def _epoch(
    state: FilterState, rows: _Rows, row: int, navigation: NavigationData, settings: FilterSettings, out: _Out
) -> FilterState:
    starting = not state.signals
    state = predict(state, rows.gpst[row], settings)
    columns = np.flatnonzero(np.isfinite(rows.ranges.range_m[row]) & np.isfinite(rows.code_sigma_m[row]))
    view = _view(state.mean, rows, row, columns, navigation, settings)
    state = drop_old(state, settings)
    if columns.size == 0 or not np.any(view.elevation_rad >= np.radians(settings.elevation_mask_deg)):
        return state
    high = view.elevation_rad >= np.radians(settings.elevation_mask_deg)
    columns, view = columns[high], view.select(high)
    scales_before = len(state.scales)
    state = _add_new(state, rows, columns, view)
    problem = _Problem(state, rows, row, columns, view, settings)
    unknown = 4 + scales_before - 1 if starting else len(state.scales) - scales_before
    problem.begin_arcs()
    problem.leave_out(unknown, settings.false_alarm_probability)
    if not starting:
        out.nis[row], out.nis_dof[row] = problem.nis(), problem.dof(unknown)
    state = problem.update_state()
    out.write(row, state)
    out.residual_m[row, columns] = problem.code_residual_m(state)
    out.rejected[row, columns], out.slipped[row, columns] = problem.rejected, problem.slipped
    return state


@dataclass(frozen=True, eq=False, kw_only=True)
class _View(Selectable):
    """The satellites of an epoch as the state sees them, (k,): delays and sigmas that do not change as it improves."""

    elevation_rad: Reals
    delay_m: Reals
    ionosphere_m: Reals
    error_sigma_m: Reals


def _view(
    mean: Reals, rows: _Rows, row: int, columns: Indices, navigation: NavigationData, settings: FilterSettings
) -> _View:
    satellite, _, _ = compute_line_of_sight(rows.ranges.satellite_ecef_m[row, columns], mean[POSITION])
    delays = compute_atmosphere(
        mean[POSITION],
        satellite,
        rows.tow_s[row],
        navigation.ionosphere,
        ionosphere_share=settings.ionosphere_share,
        carrier_hz=rows.carrier_hz[columns],
    )
    low = np.maximum(np.sin(delays.elevation_rad), 0.05)
    return _View(
        elevation_rad=delays.elevation_rad,
        delay_m=delays.delay_m,
        ionosphere_m=delays.ionosphere_m,
        error_sigma_m=np.sqrt((settings.multipath_sigma_m / low) ** 2 + delays.sigma_m**2 + rows.space_m[columns] ** 2),
    )


def _add_new(state: FilterState, rows: _Rows, columns: Indices, view: _View) -> FilterState:
    """Make room for time scales and signals that come up, in the order of their coming."""
    k, first_error = len(state.signals), state.mean.size - 2 * len(state.signals)
    new = [i for i, column in enumerate(columns) if rows.signals[column] not in state.signals]
    scales = tuple(dict.fromkeys(rows.scales[columns[i]] for i in new if rows.scales[columns[i]] not in state.scales))
    signals = state.signals + tuple(rows.signals[columns[i]] for i in new)
    # Where the old entries go, and the sigmas of all; b begins at zero, n when its first carrier comes.
    first = first_error + len(scales)
    place = np.concatenate((np.arange(first_error), first + np.arange(k), first + len(signals) + np.arange(k))).astype(
        np.intp
    )
    mean = np.zeros(first + 2 * len(signals))
    variance = np.zeros(mean.size)
    variance[first_error:] = _OPEN_M**2
    variance[first + k : first + len(signals)] = view.error_sigma_m[new] ** 2
    mean[place] = state.mean
    covariance = np.diag(variance)
    covariance[np.ix_(place, place)] = state.covariance
    error_sigma_m = np.concatenate((state.error_sigma_m, view.error_sigma_m[new]))
    error_sigma_m[[signals.index(rows.signals[column]) for column in columns]] = view.error_sigma_m
    seen = np.concatenate((state.seen, np.full(len(new), state.gpst)))
    seen[[signals.index(rows.signals[column]) for column in columns]] = state.gpst
    return replace(
        state,
        scales=state.scales + scales,
        mean=mean,
        covariance=covariance,
        signals=signals,
        seen=seen,
        carried=np.concatenate((state.carried, np.full(len(new), np.datetime64("NaT"), "datetime64[ns]"))),
        error_sigma_m=error_sigma_m,
    )


class _Problem:
    """The measurements of one epoch against the predicted state: innovations, faults, update.

    Rows: codes, then carriers, then range rates, of the satellites that have them (`of`: which satellite).
    """

    def __init__(
        self,
        state: FilterState,
        rows: _Rows,
        row: int,
        columns: Indices,
        view: _View,
        settings: FilterSettings,
    ) -> None:
        self.state, self.view, self.settings = state, view, settings
        self.mean, self.covariance = state.mean.copy(), state.covariance.copy()
        k, n_signals = columns.size, len(state.signals)
        index = np.array([state.signals.index(rows.signals[column]) for column in columns])
        self.index = index
        first_error = state.mean.size - 2 * n_signals
        self.error, self.ambiguity = first_error + index, first_error + n_signals + index
        clock_of = [state.scales.index(rows.scales[column]) for column in columns]
        self.offset = np.array([CORE + c - 1 if c else -1 for c in clock_of])
        self.ranges, self.rows, self.row, self.columns = rows.ranges, rows, row, columns
        self.satellite_ecef_m = rows.ranges.satellite_ecef_m[row, columns]
        carrier_m, carrier_sigma_m = rows.carrier_m[row, columns], rows.carrier_sigma_m[row, columns]
        grown = settings.carrier_sigma_m / np.maximum(np.sin(view.elevation_rad), 0.05)
        rates = self._rates()
        carried = np.flatnonzero(np.isfinite(carrier_m) & np.isfinite(carrier_sigma_m))
        rated = np.flatnonzero(np.isfinite(rates.measured_m_s) & np.isfinite(rates.sigma_m_s))
        self.of = np.concatenate((np.arange(k), carried, rated))
        self.codes, self.carriers = slice(0, k), slice(k, k + carried.size)
        self.measured = np.concatenate(
            (rows.ranges.range_m[row, columns], carrier_m[carried], rates.measured_m_s[rated])
        )
        self.variance = np.concatenate(
            (
                rows.code_sigma_m[row, columns] ** 2,
                carrier_sigma_m[carried] ** 2 + grown[carried] ** 2,
                rates.sigma_m_s[rated] ** 2 + settings.range_rate_sigma_m_s**2,
            )
        )
        self.drift_gain = rates.drift_gain
        self.on = np.ones(self.of.size, np.bool_)
        self.rejected, self.slipped = np.zeros(k, np.bool_), np.zeros(k, np.bool_)
        self.begun = 0
        self.innovation, self.design = self._linear(self.mean)
        self._begin_scales()
        self._follow_clock()

    def _rates(self) -> RangeRates:
        """Compute range rates along today's lines of sight: a position better by 100 m turns them by 5 urad."""
        rows, cells = self.rows, (self.row, self.columns)
        satellite, unit, distance_m = compute_line_of_sight(self.satellite_ecef_m, self.mean[POSITION])
        ranges = replace(
            self.ranges,
            satellite_velocity_ecef_m_s=self.ranges.satellite_velocity_ecef_m_s[cells],
            satellite_drift=self.ranges.satellite_drift[cells],
        )
        return compute_range_rates(
            ranges,
            satellite,
            unit,
            distance_m,
            rows.doppler_hz[cells],
            rows.doppler_sigma_hz[cells],
            rows.carrier_hz[self.columns],
        )

    def _linear(self, at: Reals) -> tuple[Reals, Reals]:
        """Linearize: measured minus modelled at `at`, (m,), and the model's derivative, (m, n)."""
        _, unit, distance_m = compute_line_of_sight(self.satellite_ecef_m, at[POSITION])
        k, m = len(self.columns), self.of.size
        design = np.zeros((m, at.size))
        ranging = np.arange(self.carriers.stop)
        sat = self.of[ranging]
        design[ranging, POSITION] = -unit[sat]
        design[ranging, CLOCK] = 1.0
        further = self.offset[sat] >= 0
        design[ranging[further], self.offset[sat][further]] = 1.0
        design[np.arange(k), self.error] = 1.0
        carried = self.of[self.carriers]
        design[k + np.arange(carried.size), self.ambiguity[carried]] = 1.0
        rated = self.of[self.carriers.stop :]
        design[self.carriers.stop :, VELOCITY] = -unit[rated]
        design[self.carriers.stop :, DRIFT] = self.drift_gain[rated]
        modelled = design @ np.concatenate((np.zeros(3), at[3:]))
        modelled[ranging] += distance_m[sat] + self.view.delay_m[sat]
        modelled[self.carriers] -= 2.0 * self.view.ionosphere_m[carried]
        return self.measured - modelled, design

    def _shift(self, entry: int, by_m: float, sigma: float = _OPEN_M) -> None:
        """Make one entry of the state unknown, and move it so that it fits."""
        self.mean[entry] += by_m
        self.covariance[entry, :] = self.covariance[:, entry] = 0.0
        self.covariance[entry, entry] = sigma**2
        self.innovation = self.innovation - self.design[:, entry] * by_m

    def _begin_scales(self) -> None:
        """Begin a new time scale where its codes say: it may be far off."""
        first_error = self.mean.size - 2 * len(self.state.signals)
        for entry in range(CORE, first_error):
            rows_of_scale = self.offset == entry
            if self.mean[entry] == 0.0 and np.any(rows_of_scale):
                self._shift(entry, float(np.median(self.innovation[self.codes][rows_of_scale])))

    def _follow_clock(self) -> None:
        """Follow the receiver's clock where all codes jump alike; carriers may or may not have followed."""
        jump_m = float(np.median(self.innovation[self.codes]))
        variance_m2 = self.covariance[CLOCK, CLOCK]
        if variance_m2 > _JUMP_M**2:
            # The drift is still unknown, or the gap was long: begin where the codes say. So large a variance beside the
            # carrier's millimetres would leave no digits.
            drift_m_s = float(self.covariance[DRIFT, CLOCK] / variance_m2) * jump_m
            self._shift(CLOCK, jump_m)
            self._shift(DRIFT, drift_m_s, sigma=_OPEN_M_S)
            self.begun += 1
        elif abs(jump_m) > max(_JUMP_M, 10.0 * float(np.sqrt(variance_m2))):
            self._shift(CLOCK, jump_m)
            self.state = replace(self.state, carried=np.full_like(self.state.carried, np.datetime64("NaT")))
            self.begun += 1

    def begin_arcs(self) -> None:
        """Begin ambiguities where the carrier is new, has slipped, or was away for long."""
        carried_at = self.state.carried[self.index]
        away_s = (self.state.gpst - carried_at) / np.timedelta64(1, "s")
        slip = self.rows.slip[self.row, self.columns]
        restarts = slip | ~(away_s <= self.settings.max_gap_s)  # NaN, too
        for line in np.arange(self.of.size)[self.carriers]:
            if restarts[self.of[line]]:
                self._begin_arc(line)

    def _begin_arc(self, line: int) -> None:
        self._shift(int(self.ambiguity[self.of[line]]), float(self.innovation[line]))
        self.begun += 1

    def dof(self, unknown: int) -> int:
        return int(self.on.sum()) - self.begun - unknown

    def _spread(self) -> Reals:
        """Return the covariance of the innovations in use."""
        design = self.design[self.on]
        return np.asarray(design @ self.covariance @ design.T + np.diag(self.variance[self.on]))

    def nis(self) -> float:
        innovation = self.innovation[self.on]
        return float(innovation @ linalg.solve(self._spread(), innovation, assume_a="pos"))

    def leave_out(self, unknown: int, false_alarm_probability: float) -> None:
        """Drop the innovations that alone explain most, while all are too large together (Baarda's test).

        A carrier is not dropped: it begins a new arc.
        """
        for _ in range(self.of.size):
            dof = self.dof(unknown)
            if dof < 1 or self.nis() <= float(chi_square_threshold(false_alarm_probability, dof)):
                return
            inverse = linalg.inv(self._spread())
            w = np.abs(inverse @ self.innovation[self.on]) / np.sqrt(np.diag(inverse))
            line = int(np.flatnonzero(self.on)[np.argmax(w)])
            if self.carriers.start <= line < self.carriers.stop:
                self._begin_arc(line)
                self.slipped[self.of[line]] = True
            else:
                self.on[line] = False
                self.rejected[self.of[line]] = True

    def update_state(self) -> FilterState:
        """Update the state with the measurements; linearised again while the position moves far."""
        at, design, innovation = self.mean, self.design[self.on], self.innovation[self.on]
        for _ in range(3):
            update = kalman_update(self.covariance, design, np.diag(self.variance[self.on]), innovation)
            mean = self.mean + update.change
            if np.linalg.norm(mean[POSITION] - at[POSITION]) < _FAR_M:
                break
            at = mean
            innovation, design = (part[self.on] for part in self._linear(at))
            innovation = innovation - design @ (self.mean - at)
        covariance = update.covariance
        carried = self.state.carried.copy()
        carried[self.index[self.of[self.carriers]]] = self.state.gpst
        return replace(self.state, mean=mean, covariance=0.5 * (covariance + covariance.T), carried=carried)

    def code_residual_m(self, state: FilterState) -> Reals:
        """Compute measured minus modelled, with b; NaN where not used."""
        innovation, _ = self._linear(state.mean)
        return np.where(self.on[self.codes], innovation[self.codes] + state.mean[self.error], np.nan)
