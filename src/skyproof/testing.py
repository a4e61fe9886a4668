"""The contract that every detector meets, for ours and for other people's; and records at measurement level to hold it.

    from skyproof.testing import MeasuredScene, check_detector

    def test_my_detector_meets_the_contract():
        scene = MeasuredScene(epochs=10)                     # a true sky over two receivers
        check_detector(MyDetector, scene.records, np.random.default_rng(1))

The contract: a detector declares itself, takes settings, gives findings that can be used, in numbers and without
words, states what it lacks, leaves its inputs alone, gives the same for the same input and for channels in another
order, gives in pieces what it gives in one run, with a state that does not grow, and raises false alarms at the rate
that it states: not more, and not fewer without a reason. Its p-values are uniform under their null, on both sides,
unless there is a reason for larger ones. Each check raises AssertionError with what was found.
"""

import pickle
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Reals
from skyproof.detectors.adapter import get_signals
from skyproof.detectors.base import Detector
from skyproof.detectors.registry import find_result_fault, instantiate
from skyproof.explain import explain
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import ecef_from_geodetic, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation, rotate_to_reception
from skyproof.gnss.time import timedelta_from_s, week_and_tow
from skyproof.records import (
    AnyFinding,
    Cause,
    CellStatus,
    ConsistentSet,
    Ephemeris,
    Finding,
    NavigationData,
    Need,
    Observations,
    Records,
    SignalId,
)
from skyproof.statistics.distributions import binomial_survival, binomial_two_sided

__all__ = [
    "FalseSky",
    "MeasuredScene",
    "TrackErrors",
    "check_bounded_state",
    "check_channel_order",
    "check_declarations",
    "check_detector",
    "check_evidence",
    "check_false_alarms",
    "check_inputs_untouched",
    "check_missing_named",
    "check_no_words",
    "check_pieces",
    "check_repeatable",
    "check_takes_settings",
]

ALARMS = ("spoofed", "attack")
MOST_WORDS = 5
"""In a text of a finding's data: a name, a signal, an instant."""


# The contract ---------------------------------------------------------------------------------------------------------


def check_detector(
    make: Callable[[], Detector],
    null_records: Callable[[np.random.Generator], Records],
    rng: np.random.Generator,
    *,
    alarms: Collection[str] = ALARMS,
    windows: int = 1000,
    conservative: str | None = None,
) -> None:
    """Run the whole contract.

    Parameters
    ----------
    make : makes a new detector, with the same settings each time.
    null_records : one window under the hypothesis that the alarms reject. For "spoofed" and "attack" that is a true
        sky; for "authentic", signals that all come from one antenna.
    alarms : what a false alarm says.
    windows : how many to count false alarms in. Two-sided counts need several expected ones to mean something.
    conservative : why there may be fewer false alarms than stated; without a reason too few are a fault, too.

    Raises
    ------
    AssertionError : a promise is broken; the message says which and by what.
    """
    detector = make()
    check_declarations(detector)
    check_takes_settings(detector)
    examples = [null_records(rng) for _ in range(4)]
    check_missing_named(detector, examples[0])
    for records in examples:
        check_evidence(make, records)
        check_no_words(make, records)
        check_inputs_untouched(make, records)
        check_repeatable(make, records)
        check_channel_order(make, records, rng)
    check_pieces(make, examples)
    check_bounded_state(make, examples)
    check_false_alarms(make, (null_records(rng) for _ in range(windows)), alarms=alarms, conservative=conservative)


def check_declarations(detector: Detector) -> None:
    """Name, needs and settings are declared, and the settings are a frozen dataclass with defaults."""
    kind = type(detector).__name__
    assert isinstance(detector, Detector), f"{kind} lacks one of name, needs, settings, examine"
    assert detector.name.isidentifier(), f"{kind}.name is {detector.name!r}, expected a lower-case identifier"
    assert detector.needs, f"{kind}.needs is empty: a detector without needs has nothing to say"
    assert all(isinstance(need, Need) for need in detector.needs), f"{kind}.needs must be members of Need"
    settings: Any = detector.settings
    assert is_dataclass(settings), f"settings of {kind} are not a dataclass"
    made: Any = type(settings)
    assert made.__dataclass_params__.frozen, f"settings of {kind} are not frozen"
    without = [f.name for f in fields(settings) if f.default is MISSING and f.default_factory is MISSING]
    assert not without, f"settings of {kind} have no default for {', '.join(without)}"
    rate = getattr(settings, "false_alarm_probability", None)
    assert isinstance(rate, float), f"settings of {kind} state no false_alarm_probability"
    assert 0.0 < rate < 1.0, f"settings of {kind} state no false_alarm_probability between 0 and 1"


def check_takes_settings(detector: Detector) -> None:
    """Check that it takes other settings: a run gives each detector its share of the error budget."""
    share = 0.5 * detector.settings.false_alarm_probability
    other_settings = replace(detector.settings, false_alarm_probability=share)
    kind = type(detector).__name__
    assert instantiate(type(detector), other_settings).settings == other_settings, (
        f"{kind}(settings=...) has other settings than those"
    )


def check_evidence(make: Callable[[], Detector], records: Records) -> None:
    """Check that its evidence is well formed.

    Evidence stands under its own name, on signals of the window, with a known word, a reason, and possible
    probabilities. An alarm's p-value is not above the rate that it states.
    """
    detector = make()
    fault = find_result_fault(detector, records, detector.examine(records))
    assert fault is None, f"{detector.name}: {fault}"


def check_no_words(make: Callable[[], Detector], records: Records) -> None:
    """Check that a finding has a code and data without sentences."""
    detector = make()
    for finding in detector.examine(records)[0]:
        if isinstance(finding, Finding):
            texts = [finding.code, *(text for value in finding.data.values() for text in _texts(value))]
            wordy = [text for text in texts if len(text.split()) > MOST_WORDS]
            assert not wordy, f"{detector.name} puts words in a finding: {wordy[0]!r}; give a code and data"
            assert finding.code.isidentifier(), f"{detector.name} has the code {finding.code!r}, expected an identifier"


def _texts(value: object) -> list[str]:
    values = value if isinstance(value, tuple) else (value,)
    return [text for text in values if isinstance(text, str)]


def check_bounded_state(make: Callable[[], Detector], windows: Sequence[Records], *, rounds: int = 6) -> None:
    """Check that the state that a detector keeps does not grow with time.

    After many windows it is as large as after a few.
    """
    detector, state, sizes = make(), None, list[int]()
    for number in range(rounds * len(windows)):
        _, state = detector.examine(_delay(windows[number % len(windows)], number), state)
        sizes.append(len(pickle.dumps(state)))
    half = len(sizes) // 2
    early, late = max(sizes[:half]), max(sizes[half:])
    assert late <= 1.2 * early + 200, f"{detector.name}: its state grows from {early} to {late} octets"


def _delay(records: Records, number: int) -> Records:
    """Return the records as of so many windows later."""
    by = number * (records.end_gpst - records.start_gpst)
    by_s = float(by / np.timedelta64(1, "s"))

    def later(measured: Any) -> Any:
        times = {"gpst": by, "elapsed_s": by_s, "found_elapsed_s": by_s, "missed_elapsed_s": by_s}
        return replace(measured, **{n: getattr(measured, n) + t for n, t in times.items() if hasattr(measured, n)})

    sets = tuple(replace(s, gpst=s.gpst + by) for s in records.sets)
    moved = _change_each(records, later)
    return replace(moved, start_gpst=records.start_gpst + by, end_gpst=records.end_gpst + by, sets=sets)


def check_missing_named(detector: Detector, records: Records) -> None:
    """Check that it answers "undecided" without a record that it needs, or with nothing measured.

    It gives the reason and what would be needed; it does not raise.
    """
    lacking = [need for need in detector.needs if not records.has(need)]
    assert not lacking, f"the records lack {', '.join(lacking)}, which {detector.name} needs: they are no test of it"
    empty = Records(start_gpst=records.start_gpst, end_gpst=records.end_gpst)
    poorer = {"any record": empty, "anything measured": _blank_measured(records)}
    poorer |= {need: _remove(records, need) for need in detector.needs}
    for lost, less in poorer.items():
        evidence, _ = detector.examine(less)
        assert evidence, f"{detector.name} says nothing without {lost}, which it needs"
        for finding in evidence:
            assert finding.says == "undecided", f"{detector.name} says {finding.says!r} without what it needs: {lost}"
            words = explain(finding)
            assert words.sentence, f"{detector.name} is undecided without {lost}, and does not say why"
            # A detector that is not installed yet has its remedies with it.
            remedy = words.remedy or getattr(detector, "remedies", {}).get(finding.code)
            assert remedy, f"{detector.name} is undecided without {lost}, and does not say what it would need"


def check_inputs_untouched(make: Callable[[], Detector], records: Records) -> None:
    """Check that every input array keeps its bytes."""
    before = [array.tobytes() for array in _arrays(records)]
    make().examine(records)
    changed = sum(a != b.tobytes() for a, b in zip(before, _arrays(records), strict=True))
    assert changed == 0, f"{make().name} has changed {changed} arrays of its input"


def check_repeatable(make: Callable[[], Detector], records: Records) -> None:
    """Check that the same input gives the same evidence, also from a new detector."""
    detector = make()
    first, second, third = detector.examine(records)[0], detector.examine(records)[0], make().examine(records)[0]
    assert (
        [_write_fields(e) for e in first] == [_write_fields(e) for e in second] == [_write_fields(e) for e in third]
    ), f"{detector.name} gives different evidence for the same records"


def check_channel_order(make: Callable[[], Detector], records: Records, rng: np.random.Generator) -> None:
    """Check that the order of channels means nothing.

    In observations, taps, grids and phases each has an order of its own: what belongs together follows from the names
    of signals.
    """
    shuffled = _change_each(records, lambda measured: _permute(measured, rng))
    first_order, other = make().examine(records)[0], make().examine(shuffled)[0]
    assert len(first_order) == len(other), (
        f"{make().name} finds {len(first_order)} or {len(other)} things by the order of the channels"
    )
    for a, b in zip(sorted(first_order, key=_key), sorted(other, key=_key), strict=True):
        assert _key(a) == _key(b), f"{make().name} says other things if the channels come in another order"
        same = np.allclose(_numbers(a), _numbers(b), rtol=1e-6, atol=1e-12, equal_nan=True)
        assert same, f"{make().name} finds other numbers if the channels come in another order"


def check_pieces(make: Callable[[], Detector], windows: Iterable[Records]) -> None:
    """Check that a run resumed by another process between windows gives what the whole gives."""
    whole, pieces = make(), make()
    state, saved = None, None
    for records in windows:
        expected, state = whole.examine(records, state)
        found, saved = pieces.examine(records, saved)
        assert [_write_fields(e) for e in found] == [_write_fields(e) for e in expected], (
            f"{whole.name}: pieces do not equal the whole"
        )
        pieces, saved = make(), pickle.loads(pickle.dumps(saved))


def check_false_alarms(
    make: Callable[[], Detector],
    windows: Iterable[Records],
    *,
    alarms: Collection[str] = ALARMS,
    conservative: str | None = None,
    significance: float = 1e-4,
) -> tuple[int, int, float]:
    """Count false alarms against the stated rates (`Finding.alpha`), two-sided unless `conservative`.

    A finding that rejects a clean sky is one, whatever benign causes remain. Where nothing but alarms and "clean" is
    said, p-values are counted below 0.1 and 0.5 as well.

    Returns
    -------
    alarms, tests, stated rate.
    """
    detector = make()
    state, count, rates, p_values, words = None, 0, list[float](), list[float](), set[str]()
    for records in windows:
        evidence, state = detector.examine(records, state)
        for finding in evidence:
            alpha = finding.alpha if isinstance(finding, Finding) else finding.false_alarm_probability
            assert alpha is not None, f"{detector.name} states no false alarm probability"
            rates.append(alpha)
            count += _is_alarm(finding, alarms)
            words.add(finding.says)
            p_values += [] if finding.p_value is None else [finding.p_value]
    assert rates, f"{detector.name} says nothing of these windows"
    rate = float(np.mean(rates))
    if conservative is None:
        chance = binomial_two_sided(count, len(rates), rate)
    else:
        chance = float(binomial_survival(count, len(rates), rate))
    assert chance >= significance, (
        f"{detector.name}: {count} false alarms in {len(rates)} tests at a stated rate of {rate:.3g}, "
        f"that is {count / len(rates):.3g}; the chance of this is {chance:.1g}. Does what it looks at vary in these "
        "records as it does in what is received?"
    )
    if words <= {*alarms, "clean"}:
        for limit in (0.1, 0.5):
            below = sum(p <= limit for p in p_values)
            if conservative is not None or not p_values:
                chance = float(binomial_survival(below, len(p_values), limit)) if p_values else 1.0
            else:
                chance = binomial_two_sided(below, len(p_values), limit)
            assert chance >= significance, (
                f"{detector.name}: {below} of {len(p_values)} p-values of a true null are not above {limit}; "
                f"the chance of this is {chance:.1g}"
            )
    return count, len(rates), rate


def _is_alarm(finding: AnyFinding, alarms: Collection[str]) -> bool:
    if isinstance(finding, Finding) and tuple(alarms) == ALARMS:
        return finding.alpha is not None and finding.p.get(Cause.CLEAN, 1.0) < finding.alpha
    return finding.says in alarms


def _arrays(record: Any) -> list[NDArray[Any]]:
    if isinstance(record, np.ndarray):
        return [record]
    if isinstance(record, (tuple, list)):
        return [array for item in record for array in _arrays(item)]
    if isinstance(record, Mapping):
        return [array for item in record.values() for array in _arrays(item)]
    if is_dataclass(record):
        return [array for f in fields(record) for array in _arrays(getattr(record, f.name))]
    return []


def _write_fields(evidence: AnyFinding) -> tuple[str, ...]:
    """Write all fields of it, NaN equal to NaN."""
    return tuple(repr(getattr(evidence, f.name)) for f in fields(evidence))


def _key(evidence: AnyFinding) -> tuple[str, tuple[str, ...], str]:
    return evidence.says, tuple(sorted(map(str, get_signals(evidence)))), evidence.code


def _numbers(evidence: AnyFinding) -> list[float]:
    numbers = (evidence.statistic, evidence.threshold, evidence.p_value, evidence.log_likelihood_ratio)
    return [np.nan if number is None else number for number in numbers]


def _remove(records: Records, need: Need) -> Records:
    """Remove what a detector needs from the records."""
    if need is Need.TWO_RECEIVERS:
        return replace(records, observations=records.observations[:1])
    empty: Any = {Need.NAVIGATION: None, Need.NAV_STATE: {}}.get(need, ())
    changes: dict[str, Any] = {need: empty}
    return replace(records, **changes)


def _change_each(records: Records, change: Callable[[Any], Any]) -> Records:
    """Change every record of channels, observations or other; each knows its `signals`."""
    kinds = ("observations", "taps", "vector_taps", "ccaf", "array_phases")
    changed: dict[str, Any] = {kind: tuple(change(measured) for measured in getattr(records, kind)) for kind in kinds}
    return replace(records, **changed)


_OF_CHANNELS = ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")  # one number each
_OF_ANTENNAS = ("elements_m",)


def _channel_axes(measured: Any) -> dict[str, int]:
    """Return the fields of a record that have channels, and along which axis: the second, after time."""
    arrays = {f.name: getattr(measured, f.name) for f in fields(measured)}
    axes = {name: 1 for name, array in arrays.items() if np.ndim(array) >= 2 and name not in _OF_ANTENNAS}
    return axes | {name: 0 for name in _OF_CHANNELS if name in arrays}


def _permute(measured: Any, rng: np.random.Generator) -> Any:
    order = rng.permutation(len(measured.signals))
    changes = {name: np.take(getattr(measured, name), order, axis) for name, axis in _channel_axes(measured).items()}
    return replace(measured, signals=tuple(measured.signals[k] for k in order), **changes)


def _blank_measured(records: Records) -> Records:
    """Blank all channels, so that no set was found and no receiver has a fix of its own."""

    def blank(measured: Any) -> Any:
        cells = {name: getattr(measured, name) for name, axis in _channel_axes(measured).items() if axis == 1}
        return replace(
            measured,
            **{n: np.full_like(v, CellStatus.NOT_TRACKED if n == "status" else np.nan) for n, v in cells.items()},
        )

    return replace(_change_each(records, blank), sets=(), own_fixes={})


# Records at measurement level -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TrackErrors:
    """Pseudorange errors of every track: AR(1) of standard deviation `sigma_m` and coefficient `correlation` from epoch
    to epoch, and a constant one of standard deviation `constant_m`."""

    sigma_m: float = 1.0
    correlation: float = 0.0
    constant_m: float = 0.0


@dataclass(frozen=True)
class FalseSky:
    """One antenna that sends what was received elsewhere. Places are east, north, up of the scene's place, in metres.

    antenna_enu_m : where it sends. shows_enu_m : the position that the signals show. delay_m : added to the way.
    receivers : who receives it; all if empty.
    """

    antenna_enu_m: tuple[float, float, float] = (400.0, 300.0, 10.0)
    shows_enu_m: tuple[float, float, float] = (250.0, -600.0, 5.0)
    delay_m: float = 400.0
    receivers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasuredScene:
    """Receivers that stand still under a true sky, false ones, or both. Ranges are computed once, errors drawn each
    time.

    antennas_enu_m : where each receiver's antenna is, east, north, up of `place_deg` (latitude, longitude, height in
        m).
    sky : the receivers that the true sky reaches; None for all.
    clock_bias_s, first_epoch_s : of each receiver; by default some tenths of a millisecond and of an epoch apart.
    max_satellites : keep the highest only.
    cn0_dbhz, cn0_sigma_db : of all signals, and how much it varies from epoch to epoch, white.

    Code errors are those of `errors`; carriers have 0.01 cycles, Dopplers 0.1 Hz, as their sigmas state.

    The sets in the records are the true ones, with true positions and clocks: they are not searched for.
    """

    antennas_enu_m: Mapping[str, tuple[float, float, float]] = field(
        default_factory=lambda: {"rx1": (0.0, 0.0, 0.0), "rx2": (20.0, 0.0, 0.0)}
    )
    sky: tuple[str, ...] | None = None
    false: tuple[FalseSky, ...] = ()
    epochs: int = 30
    step_s: float = 1.0
    errors: TrackErrors = TrackErrors()
    place_deg: tuple[float, float, float] = (59.0, 17.0, 100.0)
    start_gpst: np.datetime64 = np.datetime64("2022-01-01T20:00:00", "ns")  # noqa: RUF009
    mask_deg: float = 8.0
    max_satellites: int = 32
    cn0_dbhz: float = 45.0
    cn0_sigma_db: float = 0.0
    clock_bias_s: tuple[float, ...] = (2.1e-4, -3.3e-4, 7.0e-4, -9.0e-4)
    first_epoch_s: tuple[float, ...] = (0.0, 0.3, 0.4, 0.1)
    navigation: NavigationData = field(init=False)
    _exact: list[Observations] = field(init=False)
    _sets: tuple[ConsistentSet, ...] = field(init=False)

    def __post_init__(self) -> None:
        navigation = make_nominal_constellation(self.start_gpst)
        object.__setattr__(self, "navigation", navigation)
        lat_deg, lon_deg, height_m = self.place_deg
        geodetic = np.radians(lat_deg), np.radians(lon_deg), height_m
        place_ecef_m, rot = ecef_from_geodetic(*geodetic), rot_enu_ecef(*geodetic[:2])

        def ecef(enu_m: tuple[float, float, float]) -> Reals:
            return np.asarray(place_ecef_m + np.array(enu_m) @ rot)

        orbits = self._in_view(navigation, place_ecef_m)
        exact, sets = [], []
        for i, (receiver, enu_m) in enumerate(self.antennas_enu_m.items()):
            bias_s = self.clock_bias_s[i]
            since_s = self.step_s * np.asarray(self.first_epoch_s[i] + np.arange(self.epochs), float)
            # Where the signals are received that reach this receiver, and how far they go from there.
            received = [(ecef(enu_m), 0.0)] if self.sky is None or receiver in self.sky else []
            for attack in self.false:
                if not attack.receivers or receiver in attack.receivers:
                    way_m = float(np.linalg.norm(np.subtract(enu_m, attack.antenna_enu_m))) + attack.delay_m
                    received.append((ecef(attack.shows_enu_m), way_m))
            ranges_m: list[Reals] = []
            signals: list[SignalId] = []
            for copy, (there_ecef_m, way_m) in enumerate(received):
                true_s = np.asarray(since_s - bias_s - way_m / SPEED_OF_LIGHT_M_S, float)
                ranges_m += [
                    _compute_range_m(orbit, navigation, there_ecef_m, self.start_gpst, true_s)
                    + way_m
                    + SPEED_OF_LIGHT_M_S * bias_s
                    for orbit in orbits
                ]
                names = tuple(SignalId(orbit.sat, copy="abcdefgh"[copy]) for orbit in orbits)
                signals += names
                middle = self.start_gpst + timedelta_from_s(since_s[self.epochs // 2])
                sets.append(
                    ConsistentSet(
                        receiver=receiver,
                        signals=names,
                        gpst=middle,
                        position_ecef_m=there_ecef_m,
                        clock_bias_s=bias_s + way_m / SPEED_OF_LIGHT_M_S,
                        covariance_m2=np.eye(4),
                        statistic=float(len(names) - 4),
                        dof=len(names) - 4,
                        p_value=0.4,
                    )
                )
            exact.append(self._observations(receiver, tuple(signals), since_s, np.array(ranges_m).T))
        object.__setattr__(self, "_exact", exact)
        object.__setattr__(self, "_sets", tuple(sets))

    def records(self, rng: np.random.Generator) -> Records:
        """Draw one window with new errors."""
        return Records(
            start_gpst=self.start_gpst,
            end_gpst=self.start_gpst + timedelta_from_s((self.epochs + 0.5) * self.step_s),
            observations=tuple(self._with_errors(exact, rng) for exact in self._exact),
            navigation=self.navigation,
            sets=self._sets,
        )

    def _in_view(self, navigation: NavigationData, place_ecef_m: Reals) -> list[Ephemeris]:
        week, tow_s = week_and_tow(self.start_gpst)
        heights = []
        for orbit in navigation.ephemerides:
            position = compute_satellite_state_s(orbit, week, tow_s).position_ecef_m
            heights.append(float(compute_azimuth_elevation(place_ecef_m, position)[1]))
        highest = np.argsort(heights)[::-1][: self.max_satellites]
        return [navigation.ephemerides[k] for k in sorted(highest) if np.degrees(heights[k]) >= self.mask_deg]

    def _observations(
        self, receiver: str, signals: tuple[SignalId, ...], since_s: Reals, range_m: Reals
    ) -> Observations:
        ones = np.ones(range_m.shape)
        rate_m_s = np.gradient(range_m, self.step_s, axis=0, edge_order=2)
        return Observations(
            receiver=receiver,
            signals=signals,
            gpst=self.start_gpst + timedelta_from_s(since_s),
            elapsed_s=since_s - since_s[0],
            pseudorange_m=range_m,
            carrier_cyc=range_m * (L1_HZ / SPEED_OF_LIGHT_M_S),
            doppler_hz=-rate_m_s * (L1_HZ / SPEED_OF_LIGHT_M_S),
            cn0_dbhz=self.cn0_dbhz * ones,
            pseudorange_sigma_m=self.errors.sigma_m * ones,
            carrier_sigma_cyc=0.01 * ones,
            doppler_sigma_hz=0.1 * ones,
            status=np.full(range_m.shape, CellStatus.OK, np.uint8),
            found_elapsed_s=np.zeros(len(signals)),
            missed_elapsed_s=np.full(len(signals), np.nan),
            averaged_s=self.step_s,
        )

    def _with_errors(self, exact: Observations, rng: np.random.Generator) -> Observations:
        shape = exact.pseudorange_m.shape
        errors = self.errors
        code_m = errors.sigma_m * _draw_ar1(rng, shape, errors.correlation)
        code_m += errors.constant_m * rng.standard_normal(shape[1])
        return replace(
            exact,
            pseudorange_m=exact.pseudorange_m + code_m,
            carrier_cyc=exact.carrier_cyc + 0.01 * rng.standard_normal(shape),
            doppler_hz=exact.doppler_hz + 0.1 * rng.standard_normal(shape),
            cn0_dbhz=exact.cn0_dbhz + (self.cn0_sigma_db * rng.standard_normal(shape) if self.cn0_sigma_db else 0.0),
        )


def _draw_ar1(rng: np.random.Generator, shape: tuple[int, ...], correlation: float) -> Reals:
    """Draw stationary AR(1) along axis 0 with variance 1."""
    noise = rng.standard_normal(shape)
    for n in range(1, shape[0]):
        noise[n] = correlation * noise[n - 1] + np.sqrt(1.0 - correlation**2) * noise[n]
    return noise


def _compute_range_m(
    orbit: Ephemeris, navigation: NavigationData, place_ecef_m: Reals, start_gpst: np.datetime64, true_s: Reals
) -> Reals:
    """Compute the pseudorange of a receiver with a perfect clock at `true_s` after the start."""
    week, tow_s = week_and_tow(start_gpst)
    travel_s: Reals = np.full(true_s.shape, 0.075)
    for _ in range(4):  # each takes the error down by v/c
        state = compute_satellite_state_s(orbit, week, tow_s + true_s - travel_s)
        turned_ecef_m = rotate_to_reception(state.position_ecef_m, travel_s)
        travel_s = np.linalg.norm(turned_ecef_m - place_ecef_m, axis=-1) / SPEED_OF_LIGHT_M_S
    az_rad, el_rad = compute_azimuth_elevation(place_ecef_m, turned_ecef_m)
    lat_rad, lon_rad, height_m = geodetic_from_ecef(place_ecef_m)
    delay_m = compute_troposphere_m(lat_rad, height_m, el_rad)
    if navigation.ionosphere is not None:
        delay_m = delay_m + SPEED_OF_LIGHT_M_S * compute_klobuchar_s(
            navigation.ionosphere, lat_rad, lon_rad, az_rad, el_rad, tow_s
        )
    return np.asarray(SPEED_OF_LIGHT_M_S * (travel_s - state.clock_s + orbit.tgd) + delay_m, float)
