"""Test if C/N0 and front-end levels of a receiver follow their own past, and if not, whether interference explains it.

Noise that comes in lowers C/N0 of all signals on a carrier alike and raises the level of the front end. False signals
raise the level as well, and C/N0 does not fall: it rises, or satellites get levels that are not theirs. Model: each
signal's level is its own slow course plus fading of its own; what all share is the receiver's or comes in
(`laws.estimate_shared_change`). Levels are held against the receiver's own past, and their wander is learnt from it.

There are five tests; a failed one makes *suspect* at most:

- **rise**: the satellites of a kind get stronger together. Shade that ends or interference that ends does so too.
- **pattern**: the levels of different satellites become equal. One antenna in a reflecting room may do so as well.
- **strong**: signals are stronger than any satellite sends and any common antenna receives.
- **level**: the front end takes in more power, and C/N0 does not fall. A change of gain does so, and interference
  beside the band.
- **entered**: within seconds more power comes in and half of a kind's signals get stronger (`parts`). Shade, a
  reflection and noise that begins do the one or the other. Noise that ends behind an automatic gain may do both.

A **fall** that all satellites on a carrier share is no sign of false signals. It is reported as interference
(`Finding.interference`): since which epoch, by how much, on which carrier, by C/N0, by lost signals or by the level.
So is one that lasts for a part of a window (`laws.find_dip`).
One that was there before the log began shows when it ends: C/N0 rises and the front end takes in less power. Until then
nothing tells it from shade or a poor antenna, which scale C/N0 alike: see `_Window._weak_start`.
Shade of the whole sky weakens all signals too. It is named beside unless the level rises, another carrier keeps its
levels, or the receiver is known to stand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Instants, Reals
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.levels.front_end import Gauge, GaugeChange, carrier_name, chain_covers, follow_gauges
from skyproof.detectors.levels.laws import (
    OwnRate,
    OwnScale,
    chance_of_excess,
    estimate_shared_change,
    find_dip,
    mean_by_group,
    pattern_slope,
    split_in_two,
)
from skyproof.detectors.levels.parts import LevelStep, cut_in_parts, find_power_step, learn_steps, list_steps
from skyproof.detectors.levels.past import LevelsPast, OwnLevel, SharedSeries, Unit, UnitChange
from skyproof.detectors.levels.policy import POLICY
from skyproof.errors import SettingsError, require_probability
from skyproof.gnss.received_power import LEAST_RECEIVED_DBW
from skyproof.records import (
    UNTESTED,
    Cause,
    Datum,
    Finding,
    Hypothesis,
    InterferenceSign,
    Need,
    NoiseRise,
    Observations,
    Records,
    SignalId,
    SignalRef,
    Transmission,
    WeakStart,
)

__all__ = ["SignalLevels", "SignalLevelsSettings"]


@dataclass(frozen=True)
class SignalLevelsSettings:
    """Settings of `SignalLevels`.

    false_alarm_probability : of each receiver and window, for all tests that may fail together.
    interference_probability : of each receiver and window, of reporting interference where there is none: 0.01 an hour
        of windows of 10 s.
    fading_db : of one satellite's level from window to window, one sigma; reflections of a plain antenna.
    common_db : by which the noise figure wanders from window to window, one sigma.
    gain_db, gain_share : by which the front end's gain wanders, one sigma, dB or a share of the full scale.
    speed_max_m_s : 0 of a receiver that stands, which shade does not reach.
    """

    false_alarm_probability: float = 1e-3
    interference_probability: float = 2.8e-5
    fading_db: float = 2.0
    common_db: float = 0.5
    gain_db: float = 1.0
    gain_share: float = 0.03
    speed_max_m_s: float | None = None

    def __post_init__(self) -> None:
        for name in ("false_alarm_probability", "interference_probability"):
            require_probability("levels", name, getattr(self, name))
        for name in ("fading_db", "common_db", "gain_db", "gain_share"):
            if not getattr(self, name) > 0.0:
                raise SettingsError(f"levels: {name} is {getattr(self, name)}, expected more than 0")


class _Test(NamedTuple):
    """One test: what it is called, its p-value, its numbers, what else explains it, its columns, since when."""

    name: str
    p_value: float
    data: Mapping[str, Datum]
    causes: Mapping[Cause, float]
    columns: tuple[int, ...]
    statistic: float
    since: np.datetime64 | None = None


class SignalLevels:
    """The detector: see the module's text. It remembers own levels of each receiver's signals and chains."""

    name = "levels"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: SignalLevelsSettings | None = None) -> None:
        self.settings = settings or SignalLevelsSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        report = Reporter(self, records, Hypothesis.STEADY_LEVELS)
        if lacking := report.name_missing():
            return lacking, state
        pasts: dict[str, LevelsPast] = dict(state or {})
        found = []
        for o in records.observations:
            before = pasts.get(o.receiver)
            if before is not None and o.elapsed_s[-1] <= before.end_s:
                before = None  # another recording
            finding, pasts[o.receiver] = _Window(report, self.settings, o, before).examine()
            found.append(finding)
        return found, pasts


class _Window:
    """One receiver in one window, after what came before."""

    def __init__(
        self, report: Reporter, settings: SignalLevelsSettings, o: Observations, past: LevelsPast | None
    ) -> None:
        self.report, self.settings, self.o = report, settings, o
        self.first = past is None
        self.past = past or LevelsPast(end_s=float(o.elapsed_s[-1]), began_gpst=o.gpst[0])
        self.levels_db = _medians(o.cn0_dbhz)
        self.known = np.isfinite(o.cn0_dbhz).mean(axis=0) >= 0.5
        self.kinds: list[Unit] = [(s.sat[0], s.band, s.code) for s in o.signals]
        self.floors_db = self._lowest()
        levels = report.records.levels.get(o.receiver)
        gain = {"gain_db": settings.gain_db, "gain_share": settings.gain_share}
        self.parts = (*self.past.parts, *cut_in_parts(o, levels, report.records.end_gpst, **gain))
        own_db: dict[Transmission, float] = {}
        for signal, reference in self.past.references.items():
            own_db[signal.transmission] = max(reference.level_db, own_db.get(signal.transmission, -np.inf))
        self.steps: list[LevelStep] = list_steps(self.parts, own_db, settings.fading_db)

    def examine(self) -> tuple[Finding, LevelsPast]:
        """Return the finding and what is remembered."""
        changes = [change for unit, columns in self._units().items() if (change := self._change(unit, columns))]
        carriers, kinds = ([c for c in changes if len(c.unit) == n] for n in (1, 3))
        gauges, gauges_after = follow_gauges(
            self.report.records.levels.get(self.o.receiver),
            self.past.gauges,
            gain_db=self.settings.gain_db,
            gain_share=self.settings.gain_share,
            steady_probability=self.settings.interference_probability,
        )
        interfered = {c.unit[0]: c for c in carriers if self._is_interference(c, gauges, len(carriers))}
        ended = {c.unit[0]: c for c in carriers if self._ends_interference(c, gauges, len(carriers))}
        tests = [
            *self._rises([c for c in kinds if self._carrier(c.unit) not in ended]),
            *self._patterns(kinds, interfered),
            *self._strong(),
        ]
        tests += self._level_alone(carriers, gauges)
        tests += self._test_entries(kinds)
        failed = min(tests, key=lambda test: test.p_value, default=None)
        count = len(tests)
        odd = failed is not None and count * failed.p_value < self.settings.false_alarm_probability
        noise = [self._noise_rise(c, carriers, interfered, gauges) for c in interfered.values()]
        noise += [rest for c in carriers if c.unit[0] not in interfered and (rest := self._last_of(c))]
        noise += [self._end_of(c, gauges) for c in ended.values()]
        finding = self._report_worst(changes, failed, count, tuple(noise))
        return finding, self._remember(changes, interfered, ended, gauges_after, odd=odd)

    # ------------------------------------------------------------------ common changes

    def _units(self) -> dict[Unit, list[int]]:
        """Return the columns of each carrier, on which noise weakens all systems alike, and of each kind of signal."""
        units: dict[Unit, list[int]] = {}
        for column, (signal, kind) in enumerate(zip(self.o.signals, self.kinds, strict=True)):
            for unit in ((carrier_name(signal),), kind):
                units.setdefault(unit, []).append(column)
        return units

    def _lowest(self) -> dict[Unit, float]:
        """Return the lowest level at which each kind of signal was tracked so far."""
        floors = dict(self.past.floors_db)
        for column in np.flatnonzero(np.isfinite(self.levels_db)):
            lowest = float(np.nanmin(self.o.cn0_dbhz[:, column]))
            floors[self.kinds[column]] = min(lowest, floors.get(self.kinds[column], np.inf))
        return floors

    def _change(self, unit: Unit, columns: list[int]) -> UnitChange | None:
        """Return what the satellites of a unit share against their own past; None with too few."""
        signals, references = self.o.signals, self.past.references
        used = [k for k in columns if (ref := references.get(signals[k])) is not None and self._counts(k, ref, unit)]
        if not used:
            return None
        own_db = np.array([references[signals[k]].level_db for k in used])
        least_db = np.minimum(np.array([self.floors_db.get(self.kinds[k], np.inf) for k in used]), own_db)
        cells_db = self.o.cn0_dbhz[:, used]
        cells_db = np.where(np.isfinite(cells_db), cells_db, least_db) - own_db  # what is lost fell as far at least
        change_db = np.median(cells_db, axis=0)
        satellite = np.unique([signals[k].sat for k in used], return_inverse=True)[1]
        by_sat = mean_by_group(satellite, change_db)
        if by_sat.size < POLICY.least_satellites:
            return None
        windows = float(np.mean([references[signals[k]].windows for k in used]))
        spread = {"fading_db": self.settings.fading_db, "common_db": self.settings.common_db}
        common = estimate_shared_change(by_sat, **spread)
        statistic = common.change_db / (common.sigma_db * np.sqrt(1.0 + 1.0 / windows))
        dip = find_dip(cells_db, satellite, **spread)
        in_part = dip.parts * self.past.dips.get(unit, OwnScale()).below(dip.statistic / np.sqrt(1.0 + 1.0 / windows))
        scale, rate = self.past.scales.get(unit, OwnScale()), self.past.rates.get(unit, OwnRate())
        lost, stayed = int((~self.known[used]).sum()), self.known[used]
        tracked_db = -float(np.median(change_db[stayed])) if stayed.sum() >= POLICY.least_satellites else -np.inf
        return UnitChange(
            unit=unit,
            columns=tuple(used),
            common=common,
            statistic=float(statistic),
            fall=scale.below(statistic),
            rise=scale.above(statistic),
            losses=rate.above(lost, len(used)),
            lost=lost,
            fall_db=max(-common.change_db, tracked_db),
            series=SharedSeries(self.o.gpst, np.median(cells_db, axis=1)),
            dip=dip,
            fall_in_part=min(1.0, in_part),
            lost_in_dip=int(np.isnan(self.o.cn0_dbhz[dip.first : dip.stop, used]).all(axis=0).sum()),
        )

    def _counts(self, column: int, reference: OwnLevel, unit: Unit) -> bool:
        """Tell whether a signal is there, or was until the window before or until interference began."""
        fresh = reference.fresh or self._carrier(unit) in self.past.interfered
        return self.o.elapsed_s[0] - reference.seen_s < POLICY.forgotten_s and (bool(self.known[column]) or fresh)

    # ------------------------------------------------------------------ interference

    def _is_interference(self, change: UnitChange, gauges: list[GaugeChange], n_carriers: int) -> bool:
        asked = self.settings.interference_probability
        supported = change.unit[0] in self.past.interfered or bool(self._find_risen(change, gauges))
        return n_carriers * change.noise < asked or (supported and change.noise < POLICY.confirming_p_value)

    def _find_risen(self, change: UnitChange, gauges: list[GaugeChange]) -> list[GaugeChange]:
        """Return the gauges of a unit's carrier that rose significantly."""
        carrier = self._carrier(change.unit)
        asked = self.settings.interference_probability
        return [g for g in gauges if chain_covers(g.chain, carrier) and len(gauges) * g.rise < asked]

    def _noise_rise(
        self,
        change: UnitChange,
        carriers: list[UnitChange],
        interfered: Mapping[str, UnitChange],
        gauges: list[GaugeChange],
    ) -> NoiseRise:
        (carrier,) = change.unit
        risen = self._find_risen(change, gauges)
        lasting = carrier in self.past.interfered
        # Where most satellites of another carrier keep their levels, nothing shades the antenna.
        other_carriers = [c for c in carriers if c.unit[0] not in interfered]
        kept = (c.dip.change_db if change.short else c.common.change_db for c in other_carriers)
        uneven = any(change_db > -0.25 * change.lasting_db for change_db in kept)
        stands = self.settings.speed_max_m_s == 0.0
        lost = change.lost_in_dip if change.short else change.lost
        signs: list[InterferenceSign] = ["cn0"]
        signs += ["lost"] if 2 * lost > change.common.satellites else []
        signs += ["level"] if risen else []
        level_db, level_sigma_db = _largest([(g.rise_db, g.sigma_db) for g in risen])
        rows = np.flatnonzero(change.series.change_db <= 0.5 * change.common.change_db)
        begun, ended = self.o.gpst[0] if lasting else self._first_changed(change), self.o.gpst[rows[-1]]
        if change.short:
            begun, ended = self.o.gpst[change.dip.first], self.o.gpst[change.dip.stop - 1]
        return NoiseRise(
            receiver=self.o.receiver,
            carrier=carrier,
            from_gpst=begun,
            to_gpst=ended,
            fall_db=max(change.lasting_db if change.short else change.fall_db, 0.0),
            sigma_db=self._sigma_db(change),
            level_db=level_db,
            lost=lost,
            signs=tuple(signs),
            may_be_shade=not (risen or uneven or stands),
            level_sigma_db=level_sigma_db,
        )

    def _last_of(self, change: UnitChange) -> NoiseRise | None:
        """Return the end of interference that lasts no longer than into the first half of this window."""
        (carrier,) = change.unit
        fall_db = self.past.interfered.get(carrier, np.inf)
        stays = np.append(change.series.change_db <= -0.5 * fall_db, False)
        rows = int(np.argmin(stays))
        if not rows:
            return None
        return NoiseRise(
            receiver=self.o.receiver,
            carrier=carrier,
            from_gpst=self.o.gpst[0],
            to_gpst=self.o.gpst[rows - 1],
            fall_db=float(-np.median(change.series.change_db[:rows])),
            sigma_db=self._sigma_db(change),
            level_db=None,
            lost=0,
            signs=("cn0",),
            may_be_shade=True,
        )

    def _ends_interference(self, change: UnitChange, gauges: list[GaugeChange], n_carriers: int) -> bool:
        """Tell whether C/N0 rises while less power comes in: what made noise is there no more."""
        fallen = change.rise < POLICY.confirming_p_value and bool(self._find_fallen(change, gauges))
        return fallen and change.unit[0] not in self.past.interfered

    def _find_fallen(self, change: UnitChange, gauges: list[GaugeChange]) -> list[GaugeChange]:
        """Return the gauges of a unit's carrier that fell significantly."""
        carrier, asked = self._carrier(change.unit), self.settings.interference_probability
        return [g for g in gauges if chain_covers(g.chain, carrier) and len(gauges) * g.fall < asked]

    def _end_of(self, change: UnitChange, gauges: list[GaugeChange]) -> NoiseRise:
        """Return interference that was there since the receiver's first epoch, now that it has ended."""
        (carrier,) = change.unit
        level_db, level_sigma_db = _largest([(-g.rise_db, g.sigma_db) for g in self._find_fallen(change, gauges)])
        return NoiseRise(
            receiver=self.o.receiver,
            carrier=carrier,
            from_gpst=self.past.began_gpst,
            to_gpst=self._last_unchanged(change),
            fall_db=max(change.common.change_db, 0.0),
            sigma_db=self._sigma_db(change),
            level_db=level_db,
            lost=0,
            signs=("cn0", "level"),
            may_be_shade=False,
            level_sigma_db=level_sigma_db,
        )

    def _weak_start(self) -> tuple[WeakStart, ...]:
        """Return the carriers of a first window whose satellites are weaker than an open sky's.

        C/N0 is P G / (k T + J): it shows the antenna's gain G over the noise, and never the gain or J alone.
        """
        found = []
        for kind, least_dbw in LEAST_RECEIVED_DBW.items() if self.first else ():
            columns = [k for k, unit_kind in enumerate(self.kinds) if unit_kind == kind and self.known[k]]
            if len(columns) < POLICY.least_satellites:
                continue
            least_dbhz = least_dbw - POLICY.noise_dbw_hz - POLICY.open_sky_loss_db
            cn0_dbhz = float(np.median(self.levels_db[columns]))
            if cn0_dbhz < least_dbhz:
                carrier = self._carrier(kind)
                found.append(
                    WeakStart(
                        receiver=self.o.receiver,
                        carrier=carrier,
                        from_gpst=self.o.gpst[0],
                        cn0_dbhz=cn0_dbhz,
                        least_dbhz=least_dbhz,
                    )
                )
        worst = sorted(found, key=lambda weak: weak.cn0_dbhz - weak.least_dbhz, reverse=True)
        return tuple({weak.carrier: weak for weak in worst}.values())

    def _sigma_db(self, change: UnitChange) -> float:
        return change.common.sigma_db * self.past.scales.get(change.unit, OwnScale()).sigma

    def _first_changed(self, change: UnitChange) -> np.datetime64:
        """Return the epoch from which on a unit's levels are other than before."""
        gpst, row = self._split(change)
        begun: np.datetime64 = gpst[row]
        return begun

    def _last_unchanged(self, change: UnitChange) -> np.datetime64:
        """Return the last epoch at which a unit's levels are as before."""
        gpst, row = self._split(change)
        until: np.datetime64 = gpst[max(row - 1, 0)]
        return until

    def _split(self, change: UnitChange) -> tuple[Instants, int]:
        """Return the epochs of this window and the one before, and the row at which a unit's levels change."""
        before = self.past.series.get(change.unit)
        parts = [change.series] if before is None else [before, change.series]
        gpst = np.concatenate([part.gpst for part in parts])
        return gpst, split_in_two(np.concatenate([part.change_db for part in parts]))

    # ------------------------------------------------------------------ tests that may fail

    def _rises(self, changes: list[UnitChange]) -> list[_Test]:
        return [
            _Test(
                "rise",
                change.rise,
                {
                    "unit": change.unit,
                    "satellites": change.common.satellites,
                    "change_db": float(change.common.change_db),
                },
                leave_open((Cause.SHADE, Cause.INTERFERENCE, Cause.GAIN)),
                change.columns,
                change.common.change_db,
                self._first_changed(change),
            )
            for change in changes
        ]

    def _patterns(self, changes: list[UnitChange], interfered: Mapping[str, UnitChange]) -> list[_Test]:
        disturbed = interfered.keys() | self.past.interfered.keys()
        tests = []
        for change in changes:
            found = (
                None
                if self._carrier(change.unit) in disturbed or change.noise < POLICY.confirming_p_value
                else self._slope(change)
            )
            if found is not None:
                slope, statistic = found
                tests.append(
                    _Test(
                        "pattern",
                        self.past.slopes.get(change.unit, OwnScale()).below(statistic),
                        {"unit": change.unit, "slope": float(slope)},
                        leave_open((Cause.REFLECTIONS, Cause.MOTION)),
                        change.columns,
                        slope,
                    )
                )
        return tests

    def _slope(self, change: UnitChange) -> tuple[float, float] | None:
        """Return the slope of changes over own levels, and the same over its sigma."""
        tracked = [k for k in change.columns if self.known[k]]
        if len(tracked) < POLICY.least_satellites:
            return None
        references = [self.past.references[self.o.signals[k]] for k in tracked]
        own_db = np.array([reference.level_db for reference in references])
        found = pattern_slope(
            own_db,
            self.levels_db[tracked] - own_db,
            fading_db=self.settings.fading_db,
            windows=[reference.windows for reference in references],
        )
        return None if found is None else (found[0], found[0] / found[1])

    def _strong(self) -> list[_Test]:
        """Return a test of signals over what satellites send at most, if there are any."""
        most_db = POLICY.most_cn0_over_power_db + np.array([s.plan.strongest_dbw for s in self.o.signals])
        over_db = np.where(self.known, self.levels_db - most_db, -np.inf)
        loud = np.flatnonzero(over_db > 0.0)
        if not loud.size:
            return []
        seconds = [np.unique(np.floor(self.o.elapsed_s[rows])).size for rows in np.isfinite(self.o.cn0_dbhz[:, loud]).T]
        p_value = chance_of_excess(over_db[loud], seconds, signals=int(self.known.sum()))
        strongest_db = float(self.levels_db[loud].max())
        data: dict[str, Datum] = {"strong": int(loud.size), "strongest_dbhz": strongest_db}
        return [_Test("strong", p_value, data, leave_open((Cause.GAIN,)), tuple(loud.tolist()), strongest_db)]

    def _level_alone(self, changes: list[UnitChange], gauges: list[GaugeChange]) -> list[_Test]:
        """Return tests of chains whose level rises while C/N0 of no carrier in them falls."""
        tests = []
        for gauge in gauges:
            covered = [c for c in changes if chain_covers(gauge.chain, self._carrier(c.unit))]
            if not covered or min(c.noise for c in covered) < POLICY.confirming_p_value:
                continue
            data: dict[str, Datum] = {"chain": gauge.chain}
            data |= {"rise_db": float(gauge.rise_db)} if np.isfinite(gauge.rise_db) else {}
            tests.append(
                _Test(
                    "level",
                    gauge.rise,
                    data,
                    leave_open((Cause.GAIN, Cause.INTERFERENCE)),
                    tuple(k for c in covered for k in c.columns),
                    gauge.statistic,
                )
            )
        return tests

    def _test_entries(self, changes: list[UnitChange]) -> list[_Test]:
        """Return tests of kinds whose signals get stronger within seconds while more power comes in."""
        tests = []
        stands = self.settings.speed_max_m_s == 0.0
        for change in changes:
            carrier = self._carrier(change.unit)
            step = find_power_step(
                self.steps,
                change.unit,
                carrier,
                self.past.steps,
                fading_db=self.settings.fading_db,
                common_db=self.settings.common_db,
                stands=stands,
            )
            if step is None:
                continue
            # Noise that ends behind an automatic gain; reflections fade each by itself where nothing moves.
            causes = {Cause.INTERFERENCE: UNTESTED, Cause.GAIN: step.p_alike}
            causes |= {Cause.REFLECTIONS: step.p_value} if stands else {Cause.SHADE: step.p_power}
            tests.append(
                _Test(
                    "entered",
                    step.p_value,
                    {"unit": change.unit, "satellites": step.satellites, "change_db": step.rise_db},
                    causes if stands else causes | {Cause.REFLECTIONS: step.p_power},
                    change.columns,
                    step.rise_db,
                    self._first_changed(change),
                )
            )
        return tests

    # ------------------------------------------------------------------ what is said and remembered

    def _report_worst(
        self, changes: list[UnitChange], worst: _Test | None, count: int, noise: tuple[NoiseRise, ...]
    ) -> Finding:
        """Return the finding of the least probable of so many tests, with the interference that was found."""
        receiver, lost = self.o.receiver, {k for change in changes for k in change.columns}
        columns = sorted(lost | set(np.flatnonzero(self.known).tolist()))
        if worst is None:
            signals = tuple(SignalRef(receiver, self.o.signals[k]) for k in columns)
            if noise:
                return self.report.find(signals, "interfered", {}, estimates={"interference": noise})
            why = self._explain_untested()
            return self.report.find(signals, why.code, {}, data=why.data, estimates={"weak_start": self._weak_start()})
        p_value = min(1.0, count * worst.p_value)
        failed = p_value < self.settings.false_alarm_probability
        data: dict[str, Datum] = {"test": worst.name, "statistic": float(worst.statistic)}
        return self.report.find(
            tuple(SignalRef(receiver, self.o.signals[k]) for k in (worst.columns if failed else columns)),
            "odd" if failed else "interfered" if noise else "steady",
            {Cause.CLEAN: p_value} | {cause: min(1.0, count * p) for cause, p in worst.causes.items()},
            data={**data, **worst.data},
            dated_gpst=worst.since if failed else None,
            estimates={"interference": noise},
        )

    def _explain_untested(self) -> NotTested:
        """Return why no test could run."""
        data: dict[str, Datum] = {"receiver": self.o.receiver, "needed": POLICY.least_satellites}
        if not self.known.any():
            return NotTested("no_levels", data)
        if not self.past.references:
            return NotTested("nothing_before", data)
        return NotTested("few_satellites", data)

    def _remember(
        self,
        changes: list[UnitChange],
        interfered: Mapping[str, UnitChange],
        ended: Mapping[str, UnitChange],
        gauges: Mapping[tuple[str, str], Gauge],
        *,
        odd: bool,
    ) -> LevelsPast:
        """Return what to remember: references follow each signal's own change, and the common one while nothing is odd.

        After interference that preceded the log ends, carriers and chains start again.
        """
        shared_db = self._hold_back(changes, interfered, odd=odd)
        end_s = float(self.o.elapsed_s[-1])
        references = {
            signal: reference._replace(fresh=False)
            for signal, reference in self.past.references.items()
            if end_s - reference.seen_s < POLICY.forgotten_s
        }
        for column in np.flatnonzero(self.known):
            signal = self.o.signals[column]
            level_db = float(self.levels_db[column]) - shared_db.get(carrier_name(signal), 0.0)
            reference = references.get(signal)
            windows = 1.0 if reference is None else min(reference.windows + 1.0, POLICY.remembered_windows)
            before_db = level_db if reference is None else reference.level_db
            references[signal] = OwnLevel(before_db + (level_db - before_db) / windows, windows, end_s)
        references = {
            signal: reference for signal, reference in references.items() if carrier_name(signal) not in ended
        }
        scales, slopes, rates = dict(self.past.scales), dict(self.past.slopes), dict(self.past.rates)
        dips = dict(self.past.dips)
        for change in changes:
            if odd or self._carrier(change.unit) in interfered:
                continue
            dips[change.unit] = dips.get(change.unit, OwnScale()).after(change.dip.scatter)
            scales[change.unit] = scales.get(change.unit, OwnScale()).after(change.statistic)
            rates[change.unit] = rates.get(change.unit, OwnRate()).after(change.lost, len(change.columns))
            if (found := self._slope(change)) is not None:
                slopes[change.unit] = slopes.get(change.unit, OwnScale()).after(found[1])
        return LevelsPast(
            end_s=end_s,
            began_gpst=max((self._first_changed(change) for change in ended.values()), default=self.past.began_gpst),
            references=references,
            floors_db=self.floors_db,
            scales=scales,
            dips=dips,
            slopes=slopes,
            rates=rates,
            series={change.unit: change.series for change in changes},
            gauges={
                name: gauge
                for name, gauge in gauges.items()
                if not any(chain_covers(name[0], carrier) for carrier in ended)
            },
            interfered={
                carrier: change.lasting_db
                for carrier, change in interfered.items()
                if not change.short or change.dip.stop == self.o.gpst.size
            },
            parts=self.parts[-2:],
            steps=self.past.steps
            if odd
            else learn_steps(self.past.steps, self.steps, self._find_disturbed(interfered)),
            odd=odd,
        )

    def _find_disturbed(self, interfered: Mapping[str, UnitChange]) -> frozenset[Unit]:
        """Return the kinds on carriers with interference now or in the window before."""
        carriers = interfered.keys() | self.past.interfered.keys()
        return frozenset(kind for kind in self.kinds if self._carrier(kind) in carriers)

    def _hold_back(
        self, changes: list[UnitChange], interfered: Mapping[str, UnitChange], *, odd: bool
    ) -> dict[str, float]:
        """Return the common change by carrier, dB, of carriers with interference, or of all while a test fails."""
        return {c.unit[0]: c.common.change_db for c in changes if len(c.unit) == 1 and (odd or c.unit[0] in interfered)}

    @staticmethod
    def _carrier(unit: Unit) -> str:
        return unit[0] if len(unit) == 1 else carrier_name(SignalId(f"{unit[0]}01", unit[1], unit[2]))


def _medians(values: Reals) -> Reals:
    """Return the median of each column over its finite rows; NaN without any."""
    known = np.isfinite(values).any(axis=0)
    found = np.full(values.shape[1], np.nan)
    found[known] = np.nanmedian(values[:, known], axis=0)
    return found


def _largest(changes: Sequence[tuple[float, float]]) -> tuple[float | None, float | None]:
    """Return the largest change of a level with its sigma, dB; None where none is known in decibels."""
    known = [(change_db, sigma_db) for change_db, sigma_db in changes if np.isfinite(change_db)]
    return max(known, default=(None, None))
