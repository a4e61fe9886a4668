"""Test if each signal comes to an antenna array from where its satellite stands, by a known or an estimated attitude.

The model and its tests are in `array_model`; which signals agree, with what is known of attitude and lines or with what
most of them show, in `find_agreement`; from where the others come in `find_arrivals`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import comb
from typing import Any, NamedTuple

import numpy as np

from skyproof.arrays import Indices, Reals
from skyproof.detectors.array.agreement import (
    Agreement,
    ArrayFrame,
    MeanPhases,
    find_agreement,
    find_best_agreement,
    fit_frame,
    residuals,
)
from skyproof.detectors.array.array_common import bound_chance_of_cluster, select_one_sky, select_unrepeated
from skyproof.detectors.array.array_model import array_design, mean_differences, predict_directions, white_covariance
from skyproof.detectors.array.arrivals import Arrival, across, find_arrivals
from skyproof.detectors.array.failing import Failing, Fault, find_failing, leave_out
from skyproof.detectors.array.noticed import least_noticeable_angle
from skyproof.detectors.array.over_time import Block, Waiting, add_block, alpha_alone, alpha_of_block
from skyproof.detectors.array.policy import POLICY
from skyproof.detectors.array.reflected import levels_dbhz, select_reflections
from skyproof.detectors.base import NotTested, Reporter, leave_open
from skyproof.detectors.messages.laws import lowest_elevation_rad
from skyproof.errors import require_probability
from skyproof.gnss.constants import L1_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.frames import attitude_ecef, geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import seconds_between
from skyproof.records import (
    ArrayPhases,
    Cause,
    Datum,
    Direction,
    Finding,
    Hypothesis,
    NavigationData,
    NavState,
    Need,
    NoticedAttack,
    Observations,
    Records,
    SignalRef,
    list_refs,
)
from skyproof.statistics.directions import equal_clusters, equal_statistic, equality_chance, subtract_nearest_whole
from skyproof.statistics.distributions import chi_square_survival, chi_square_threshold

__all__ = ["ArrayView", "InsArray", "InsArraySettings", "build_level_states", "list_places", "select_likeliest"]


@dataclass(frozen=True)
class InsArraySettings:
    """Settings of `InsArray`.

    false_alarm_probability : of each array and window.
    position_sigma_m : of each antenna's phase centre along each axis, where the array does not state it.
    pattern_sigma_m : of each antenna's phase by its pattern and its neighbours, where the array does not state it.
    scale_sigma : of the length of all baselines together, as a share of it.
    bias_sigma_cyc : of what calibration leaves of each antenna's line.
    attitude_sigma_deg : about each axis, where the inertial system gives no covariance.
    min_share : of a signal that is tested, of the epochs of the signal that has most.
    multipath_sigma_m, ionosphere_share : of ranges, as of `navigation.sets`.
    """

    false_alarm_probability: float = 1e-3
    position_sigma_m: float = 0.003
    pattern_sigma_m: float = POLICY.coupled_pattern_sigma_m
    scale_sigma: float = 0.0
    bias_sigma_cyc: float = 0.005
    attitude_sigma_deg: float = 0.05
    min_share: float = 0.2
    multipath_sigma_m: float = 1.0
    ionosphere_share: float = 0.25

    def __post_init__(self) -> None:
        require_probability("ins_array", "false_alarm_probability", self.false_alarm_probability)


class ArrayView(NamedTuple):
    """A window's phases as seen from one place with one first attitude. refs : of the rows of `measured`. stated : what
    was known before."""

    state: NavState
    stated: ArrayFrame
    refs: tuple[SignalRef, ...]
    measured: MeanPhases
    agreed: Agreement
    accepted: bool

    @property
    def satellites(self) -> int:
        return len({self.refs[k].signal.sat for k in self.agreed.members})


@dataclass(frozen=True)
class _ByPlace:
    """Rows of signals that do not come from their satellites.

    spoofed : of one place each, with a p-value. alike : which reflections explain but for coming from one place, with
    the chance of that. reflected : which reflections explain, by row: whether it is late, and its p-value.
    """

    spoofed: list[tuple[list[int], float]] = field(default_factory=list)
    alike: list[tuple[list[int], float]] = field(default_factory=list)
    reflected: dict[int, tuple[bool, float]] = field(default_factory=dict)


class InsArray:
    """Detect false directions of arrival, from `array_phases`, orbits, and the attitude in `nav_state` if known.

    If the body's place is unknown, each consistent set of signals gives a candidate. It is the true place if the set's
    signals come from where their satellites stand by it. Attitude or line delays may be unknown, or the stated ones may
    not fit while others fit distinctly more signals. Then those count that most satellites agree on. That
    is good enough if so many agree by chance with less than the false-alarm probability.

    The joint test of all signals and the conditional tests of each share the false alarms evenly, by the union bound.
    In a sky that fails, a signal is false if it comes from elsewhere than its satellite and is earlier or
    stronger than reflections are. So are the signals of three satellites or more from one place. Others from elsewhere
    are reflections, or false; which is open of those that are not late.
    """

    name = "ins_array"
    needs = (Need.ARRAY_PHASES, Need.NAVIGATION)

    def __init__(self, settings: InsArraySettings | None = None) -> None:
        self.settings = settings or InsArraySettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Finding], Any]:
        """Return the findings of one window; never raises for what the data lack."""
        alone = self.spending(alpha_alone(self.settings.false_alarm_probability))
        report = Reporter(alone, records, Hypothesis.SKY_DIRECTIONS)
        lacking = report.name_missing()
        if lacking or records.navigation is None:
            return lacking, state
        waiting: dict[str, Waiting] = dict(state or {})
        found = [
            f for phases in records.array_phases for f in self._test_array(report, phases, records.navigation, waiting)
        ]
        return found, waiting

    def _test_array(
        self, report: Reporter, phases: ArrayPhases, navigation: NavigationData, waiting: dict[str, Waiting]
    ) -> list[Finding]:
        """Return what fails or is not as stated in one array, and what its signals show.

        waiting : blocks of windows of each receiver; brought up to date.
        """
        every = list_refs(phases.receiver, phases.signals)
        lost = find_failing(phases)
        notes = [NotTested(f"antennas_{fault}", _name_antennas(lost, fault)) for fault in dict.fromkeys(lost.values())]
        phases = leave_out(phases, lost)
        alone = self.spending(alpha_alone(self.settings.false_alarm_probability))
        bodies = _list_states(report.records, phases.receiver) if len(phases.elements_m) > 1 else []
        views = [view for body in bodies if (view := alone.view_from(phases, body, navigation)) is not None]
        if not views:
            return [report.pass_over(every, why) for why in (*notes, _explain_unseen(phases, bodies))]
        view = select_likeliest(views)
        notes += _list_unused(view)
        lasting_cyc = np.full(len(phases.elements_m), phases.lasting_sigma_cyc)
        block = block_from_view(view, lasting_cyc, report.records)
        alone_findings = alone.judge(report, view, navigation)
        waiting[phases.receiver], found = self.judge_with_blocks(
            report, alone_findings, waiting.get(phases.receiver, Waiting()), block, view, navigation
        )
        return [*(report.pass_over(every, why) for why in notes), *found]

    def spending(self, false_alarm_probability: float) -> "InsArray":
        """Return this detector at another error rate."""
        return type(self)(replace(self.settings, false_alarm_probability=false_alarm_probability))

    def judge_with_blocks(
        self,
        report: Reporter,
        alone: Sequence[Finding],
        waiting: Waiting,
        block: Block,
        view: ArrayView,
        navigation: NavigationData,
        kept: float = 0.0,
    ) -> tuple[Waiting, list[Finding]]:
        """Return what waits, and the findings of a window beside those of the longer blocks that it completes.

        alone : findings of the window. block : of the window that `view` shows. kept : as of `Block.mean_phases`.
        """
        if not view.accepted and (view.agreed.frame.attitude_free or view.agreed.frame.bias_free):
            return waiting, list(alone)  # nothing shows how the body stands
        waiting, complete = add_block(waiting, block)
        named = {ref for finding in alone if finding.singled_out for ref in finding.signals}
        found = list[Finding]()
        for joined in complete:
            judge = self.spending(alpha_of_block(self.settings.false_alarm_probability, joined.windows))
            over = Reporter(judge, report.records, report.hypothesis)
            for finding in judge.judge(over, judge.view_of(joined, view, kept), navigation):
                if not finding.singled_out:
                    continue
                waiting = waiting.with_false(finding.signals, joined.windows)
                if not named.issuperset(finding.signals):
                    named |= set(finding.signals)
                    data = {**finding.data, "over_s": joined.duration_s}
                    found.append(replace(finding, code=f"{finding.code}_over_time", data=data))
        # A window alone sees too little to vouch for what longer blocks have shown to be false.
        return waiting, [
            *(f for alone_finding in alone if (f := _leave_out_false(alone_finding, waiting.false))),
            *found,
        ]

    def view_of(self, block: Block, newest: ArrayView, kept: float) -> ArrayView:
        """Return what agrees in the mean of a block. newest : of its last window."""
        measured = block.mean_phases(kept)
        sats = np.unique([ref.signal.sat for ref in block.refs], return_inverse=True)[1]
        agreed = find_agreement(measured, fit_frame(measured, block.frame), self.settings.false_alarm_probability)
        accepted = self._is_no_chance(measured, agreed, sats)
        return newest._replace(refs=block.refs, measured=measured, agreed=agreed, accepted=accepted)

    def view_from(self, phases: ArrayPhases, state: NavState, navigation: NavigationData) -> ArrayView | None:
        """Compare an array's phases with a place and attitude; None if no signal can be compared."""
        direction = predict_directions(phases, state, navigation)
        elements_cyc = phases.elements_m * (L1_HZ / SPEED_OF_LIGHT_M_S)
        ratio = phases.carrier_hz / L1_HZ
        mean = mean_differences(phases, np.einsum("kni,mi,n->knm", direction, elements_cyc, ratio))
        used = np.flatnonzero(mean.long_enough(self.settings.min_share))
        if not used.size:
            return None
        known_m, pattern_m = phases.elements_sigma_m, phases.pattern_sigma_m
        measured = MeanPhases(
            cycles=mean.cycles[used],
            direction=np.einsum("kn,kni->ni", mean.share, np.nan_to_num(direction))[used],
            sigma_cyc=mean.sigma_cyc[used],
            elements_cyc=elements_cyc,
            ratio=ratio[used],
            position_sigma_cyc=(self.settings.position_sigma_m if known_m is None else known_m)
            * L1_HZ
            / SPEED_OF_LIGHT_M_S,
            scale_sigma=self.settings.scale_sigma,
            pattern_sigma_cyc=(self.settings.pattern_sigma_m if pattern_m is None else pattern_m)
            * L1_HZ
            / SPEED_OF_LIGHT_M_S,
        )
        refs = tuple(SignalRef(phases.receiver, phases.signals[k]) for k in used)
        stated = ArrayFrame(
            turn=np.eye(3),
            bias_cyc=np.zeros(len(elements_cyc) - 1),
            attitude_covariance_rad2=self._attitude_covariance(state),
            bias_sigma_cyc=self.settings.bias_sigma_cyc,
        )
        stated = stated.widen(attitude=stated.attitude_free, bias=not phases.calibrated)
        return self._find_best_view(state, refs, measured, stated)

    def _find_best_view(
        self, state: NavState, refs: tuple[SignalRef, ...], measured: MeanPhases, stated: ArrayFrame
    ) -> ArrayView:
        """Return the view with the stated attitude and lines, unless others fit distinctly more signals."""
        names, sats = np.unique([ref.signal.sat for ref in refs], return_inverse=True)
        alpha = self.settings.false_alarm_probability

        def view(frame: ArrayFrame) -> ArrayView:
            agreed = find_best_agreement(measured, frame, alpha)
            return ArrayView(state, stated, refs, measured, agreed, self._is_no_chance(measured, agreed, sats))

        # Whole cycles are chosen by an attitude only if it leaves less than that of the longest baseline.
        reach = float(np.linalg.norm(array_design(measured.elements_cyc), axis=1).max(initial=0.0))
        vague = bool(stated.attitude_sigma_rad * reach > POLICY.vague_sigma_cyc)
        start = stated.widen(attitude=vague or stated.attitude_free, bias=stated.bias_free)
        found = view(start)
        if found.agreed.p_value >= alpha or len(names) - found.satellites < 2:
            return found
        for attitude, bias in ((True, False), (False, True), (True, True)):
            attitude, bias = attitude or start.attitude_free, bias or start.bias_free
            other = start.widen(attitude=attitude, bias=bias)
            tried = view(other) if other.freed > start.freed else found
            if tried.accepted and tried.satellites > found.satellites + 1:
                return tried
        return found

    def _is_no_chance(self, measured: MeanPhases, agreed: Agreement, sats: Indices) -> bool:
        """Test if so many satellites agree, or agree well, by chance with less than the false-alarm probability."""
        d = measured.cycles.shape[1]
        alpha, total = self.settings.false_alarm_probability, np.unique(sats).size
        lasting_cyc = np.hypot(measured.position_sigma_cyc, measured.pattern_sigma_cyc)
        lasting = white_covariance(np.full(d + 1, lasting_cyc))
        design = array_design(measured.elements_cyc)
        covariance = (
            white_covariance(measured.sigma_cyc).mean(axis=0) + lasting + measured.scale_sigma**2 * design @ design.T
        )
        for missed in POLICY.gates_missed_probability:
            size = np.unique(sats[agreed.members[agreed.p_values[agreed.members] >= missed]]).size
            beyond = size - agreed.frame.freed / d
            if beyond <= 1.0:
                continue
            # A signal from anywhere is taken for that of a satellite; the pair that is compared has half of it each.
            chance = equality_chance(design, 0.5 * covariance, float(chi_square_threshold(missed, d)), wrapped=True)
            if len(POLICY.gates_missed_probability) * min(1.0, comb(total, size) * chance**beyond) < alpha:
                return True
        return False

    def judge(self, report: Reporter, view: ArrayView, navigation: NavigationData) -> list[Finding]:
        """Return what the directions show of the signals of a view."""
        records, receiver = report.records, view.refs[0].receiver
        alpha, agreed, n = self.settings.false_alarm_probability, view.agreed, len(view.refs)
        sure = np.setdiff1d(agreed.members, agreed.doubtful)
        deviating = np.setdiff1d(np.arange(n), np.union1d(agreed.members, agreed.doubtful) if view.accepted else [])
        true = select_one_sky(records, receiver, [view.refs[k] for k in sure]) if view.accepted else ()
        by_place = (
            self._sort_by_place(records, view, deviating, true, navigation) if agreed.p_value < alpha else _ByPlace()
        )
        spoofed = by_place.spoofed
        found = [self._find_false(report, view, rows, p_value) for rows, p_value in spoofed]
        true = tuple(
            view.refs[k]
            for k in sure
            if view.refs[k] in true and not any(self._is_behind_transmitter(view, k, rows) for rows, _ in spoofed)
        )
        p_one = self._test_one_place(view, [k for k in sure if view.refs[k] in true])
        if p_one < alpha:
            data: dict[str, Datum] = {
                "from_satellites": len(true),
                "of": n,
                "as_reflections": int(deviating.size) - sum(len(rows) for rows, _ in spoofed),
                "assumes": ("none_from_satellites",),
            }
            p = {Cause.FALSE_SKY: p_one}
            estimates = {"noticed": self._state_noticeable(view)}
            found.append(
                report.find(
                    true, "from_satellites", p, hypothesis=Hypothesis.ONE_ANTENNA, data=data, estimates=estimates
                )
            )
            found += [self._find_repeated(report, view, rows, chance) for rows, chance in by_place.alike]
            found += self._find_reflected(report, view, by_place.reflected)
            if agreed.p_value < alpha:
                found += self._find_doubtful(report, view)
        if found:
            return [*found, *self._test_rest(report, view, found)]
        if agreed.p_value >= alpha:
            estimates = {"noticed": self._state_noticeable(view)}
            return [report.find(view.refs, "all_from_satellites", {Cause.CLEAN: agreed.p_value}, estimates=estimates)]
        # Differing directions that are not the satellites' may be several waves in each signal: they vouch for nothing.
        return [self._find_unlike_statement(report, view, Hypothesis.AS_STATED)]

    def _state_noticeable(self, view: ArrayView) -> tuple[NoticedAttack, ...]:
        """Return what the directions of a view would have shown of false signals."""
        frame = view.agreed.frame
        if not view.accepted and (frame.attitude_free or frame.bias_free):
            return ()
        up = _rot_enu_body(view.state)[2]
        return least_noticeable_angle(view.measured, frame, up, self.settings.false_alarm_probability)

    def _test_rest(self, report: Reporter, view: ArrayView, found: Sequence[Finding]) -> list[Finding]:
        """Return, beside signals that were named, that the others agree with no attitude and no lines."""
        named = {ref for finding in found for ref in finding.signals}
        rest = np.array([k for k, ref in enumerate(view.refs) if ref not in named], np.intp)
        if view.accepted or not rest.size:
            return []
        rest_view = self._find_best_view(
            view.state, tuple(view.refs[k] for k in rest), view.measured.part(rest), view.stated
        )
        if rest_view.accepted or rest_view.agreed.p_value >= self.settings.false_alarm_probability:
            return []
        return [self._find_unlike_statement(report, rest_view, Hypothesis.SKY_DIRECTIONS, beside=True)]

    def _find_unlike_statement(
        self, report: Reporter, view: ArrayView, hypothesis: Hypothesis, *, beside: bool = False
    ) -> Finding:
        """Return that too few of the view's signals agree, with any attitude and lines.

        beside : signals that were named are none of them.
        """
        data: dict[str, Datum] = {"off": len(view.refs) - int(view.agreed.members.size), "beside": beside}
        p = {Cause.CLEAN: view.agreed.p_value, **leave_open((Cause.STATEMENT, Cause.REFLECTIONS))}
        return report.find(view.refs, "not_as_stated", p, hypothesis=hypothesis, data=data)

    def _sort_by_place(
        self,
        records: Records,
        view: ArrayView,
        others: Indices,
        true: Sequence[SignalRef],
        navigation: NavigationData,
    ) -> "_ByPlace":
        """Sort signals that do not come from their satellites by the place that they come from."""
        sorted_ = _ByPlace()
        if not others.size:
            return sorted_
        alpha, measured, n = self.settings.false_alarm_probability, view.measured, len(view.refs)
        # Those that come from where their satellites stand are no choice for a cluster, and so count for none.
        white = white_covariance(measured.sigma_cyc[others])
        clusters = equal_clusters(measured.raw_cyc[others], white, false_alarm_probability=alpha, wrapped=True)
        every = len({view.refs[k].signal.sat for k in others})
        design, usual = array_design(measured.elements_cyc), white.mean(axis=0)
        observed = {o.receiver: o for o in records.observations}
        explained = select_reflections(
            observed.get(view.refs[0].receiver),
            navigation,
            view.state.position_ecef_m[0],
            [ref.signal for ref in true],
            [view.refs[k].signal for k in others],
            multipath_sigma_m=self.settings.multipath_sigma_m,
            ionosphere_share=self.settings.ionosphere_share,
        )
        overlapped = _find_overlapped(observed.get(view.refs[0].receiver), view.refs)
        below = _find_below_horizon(view, observed.get(view.refs[0].receiver))
        for label in np.unique(clusters.labels):
            rows = others[clusters.labels == label]
            size = len({view.refs[k].signal.sat for k in rows})
            near = np.flatnonzero(clusters.labels == label)
            by_chance = bound_chance_of_cluster(clusters, near, every, size, design, usual, wrapped=True)
            if size >= POLICY.one_place_satellites and by_chance < alpha:
                # Of two signals of one satellite from there, one may be the true one of a satellite behind it.
                named = select_unrepeated(view.refs, rows.tolist())
                (sorted_.spoofed if named else sorted_.alike).append((named or rows.tolist(), by_chance))
                continue
            by_itself = [k for k in select_unrepeated(view.refs, rows.tolist()) if view.refs[k] not in overlapped]
            unexplained = [k for k in by_itself if true and view.refs[k].signal not in explained]
            false = sorted({*unexplained, *(k for k in by_itself if k in below)})
            p_values = np.minimum(1.0, n * view.agreed.p_values)
            p_value = float(p_values[false].max(initial=0.0))
            if false and p_value < alpha:
                sorted_.spoofed.append((self._with_companions(view, false, rows, every), p_value))
            elif size > 1 and by_chance < POLICY.reflections_alike_probability:
                sorted_.alike.append((rows.tolist(), by_chance))
            else:
                late = {k: explained[view.refs[k].signal] for k in by_itself if view.refs[k].signal in explained}
                sorted_.reflected.update({k: (late[k], p_values[k]) for k in late if p_values[k] < alpha})
        return sorted_

    def _with_companions(self, view: ArrayView, false: list[int], rows: Indices, satellites: int) -> list[int]:
        """Return false signals with those that come from their place, if reflections rarely come from so near to it.

        satellites : of all signals that do not come from their satellite. The nearest others, as many as go together,
        are of that place if so many of all others rarely lie so near to the false signal that is farthest from them.
        """
        once = select_unrepeated(view.refs, rows.tolist())
        known = {view.refs[k].signal.sat for k in false}
        measured = view.measured
        # What is measured of the false signals is given; only the other one's errors are drawn.
        white = white_covariance(measured.sigma_cyc)
        design = array_design(measured.elements_cyc)
        chances = dict[int, float]()
        for k in once:
            if view.refs[k].signal.sat in known:
                continue
            apart = measured.raw_cyc[[k]] - measured.raw_cyc[false]
            farthest = float(subtract_nearest_whole(apart, white[k])[1].max())
            chances[k] = equality_chance(design, 0.5 * white[k], farthest, wrapped=True)
        nearest = sorted(chances, key=chances.__getitem__)
        for more in range(len(nearest), 0, -1):
            chance = comb(satellites - len(known), more) * chances[nearest[more - 1]] ** more
            if chance < POLICY.reflections_alike_probability:
                return sorted([*false, *nearest[:more]])
        return false

    def _find_false(self, report: Reporter, view: ArrayView, rows: list[int], p_value: float) -> Finding:
        """Return that each of these signals is false, and from where they may come."""
        refs = tuple(view.refs[k] for k in rows)
        satellites = len({ref.signal.sat for ref in refs})
        return report.find(
            refs,
            "from_elsewhere" if satellites == 1 else "from_one_direction",
            {Cause.CLEAN: p_value},
            singled_out=True,
            data={"sat": refs[0].signal.sat},
            estimates={"directions": _list_directions(view, rows)},
        )

    def _find_repeated(self, report: Reporter, view: ArrayView, rows: list[int], chance: float) -> Finding:
        """Return that signals come later and weaker than true ones, as reflections do, but from one place."""
        p = {Cause.CLEAN: chance, **leave_open((Cause.REFLECTIONS,))}
        refs = tuple(view.refs[k] for k in rows)
        return report.find(
            refs, "repeated", p, hypothesis=Hypothesis.SEPARATE_ORIGINS, alpha=POLICY.reflections_alike_probability
        )

    def _find_reflected(
        self, report: Reporter, view: ArrayView, reflected: Mapping[int, tuple[bool, float]]
    ) -> list[Finding]:
        """Return which signals are late as reflections are, and which may be reflections or false.

        A reflection is later than the direct signal would be, by less than noise only if the reflector is near.
        """
        found = list[Finding]()
        for late, code, causes in (
            (True, "reflected", (Cause.REFLECTIONS,)),
            (False, "not_late", (Cause.REFLECTIONS, Cause.FAULT)),
        ):
            p_values = {k: p_value for k, (is_late, p_value) in reflected.items() if is_late == late}
            if p_values:
                refs = tuple(view.refs[k] for k in p_values)
                p = {Cause.CLEAN: max(p_values.values()), **leave_open(causes)}
                data: dict[str, Datum] = {"sats": tuple(ref.signal.sat for ref in refs)}
                found.append(report.find(refs, code, p, singled_out=True, data=data))
        return found

    def _find_doubtful(self, report: Reporter, view: ArrayView) -> list[Finding]:
        """Return which signals of a sky that fails true ones are rarely like, though none would be named for it.

        That directions differ shows none of them to be true.
        """
        p_values = np.minimum(1.0, len(view.refs) * view.agreed.p_values)
        rare = POLICY.fitted_missed_probability
        rows = [k for k in view.agreed.doubtful if p_values[k] < rare]
        if not rows:
            return []
        refs = tuple(view.refs[k] for k in rows)
        p = {Cause.CLEAN: float(p_values[rows].max()), **leave_open((Cause.REFLECTIONS, Cause.FAULT))}
        data: dict[str, Datum] = {"sats": tuple(ref.signal.sat for ref in refs)}
        return [report.find(refs, "not_late", p, singled_out=True, data=data, alpha=rare)]

    def _is_behind_transmitter(self, view: ArrayView, k: int, rows: list[int]) -> bool:
        """Tell if a signal could come from the place of false ones, none of them of its satellite.

        Then its satellite stands behind the transmitter, and nothing tells whose signal it is.
        """
        sent = {view.refs[row].signal.transmission for row in rows}
        if len(sent) < POLICY.one_place_satellites or view.refs[k].signal.transmission in sent:
            return False
        part = view.measured.part(np.array([*rows, k]))
        statistic = equal_statistic(part.raw_cyc, white_covariance(part.sigma_cyc), wrapped=True)[0]
        p_value = float(chi_square_survival(statistic, len(rows) * part.cycles.shape[1]))
        return p_value >= self.settings.false_alarm_probability

    def _test_one_place(self, view: ArrayView, rows: list[int]) -> float:
        """Return the p-value of these signals coming from one place; 1 for fewer than three satellites."""
        if len({view.refs[k].signal.sat for k in rows}) < POLICY.one_place_satellites:
            return 1.0
        part = view.measured.part(np.array(rows))
        statistic = equal_statistic(part.raw_cyc, white_covariance(part.sigma_cyc), wrapped=True)[0]
        return float(chi_square_survival(statistic, (len(rows) - 1) * part.cycles.shape[1]))

    def _attitude_covariance(self, state: NavState) -> Reals:
        """Return the attitude's covariance (3, 3) in the body frame, in the middle of the window.

        An inertial system's error hardly changes within a window.
        """
        if state.covariance is None:
            return np.asarray(np.radians(self.settings.attitude_sigma_deg) ** 2 * np.eye(3))
        middle = state.gpst.size // 2
        attitude = state.attitude[middle]
        return np.asarray(attitude.T @ state.covariance[middle, 6:, 6:] @ attitude)


def _find_overlapped(o: Observations | None, refs: Sequence[SignalRef]) -> set[SignalRef]:
    """Find signals that overlap another one of their satellite, or are masked by it: their phases are a mixture."""
    if o is None:
        return set()
    columns = {ref: o.signals.index(ref.signal) for ref in refs if ref.signal in o.signals}
    found = set[SignalRef]()
    for signal, other in combinations(columns, 2):
        if signal.signal.transmission == other.signal.transmission:
            a, b = columns[signal], columns[other]
            stronger_db = o.cn0_dbhz[:, a] - o.cn0_dbhz[:, b]
            overlap_m = POLICY.overlap_chips * signal.signal.plan.chip_m
            if np.any(np.abs(o.pseudorange_m[:, a] - o.pseudorange_m[:, b]) < overlap_m):  # NaN is not
                found |= {signal, other}
            elif np.any(stronger_db > POLICY.covered_db):
                found.add(other)
            elif np.any(stronger_db < -POLICY.covered_db):
                found.add(signal)
    return found


def _find_below_horizon(view: ArrayView, o: Observations | None) -> set[int]:
    """Find rows of signals whose satellites are below the horizon, if place and attitude are known.

    No reflector is reached by those. Signals that a stronger signal's code may imitate are left out.
    """
    frame = view.agreed.frame
    if not view.accepted and (frame.attitude_free or frame.bias_free):
        return set()
    up = view.measured.direction @ _rot_enu_body(view.state)[2]
    lowest = np.sin(lowest_elevation_rad(view.state.position_ecef_m[0]))
    low = set(np.flatnonzero(up < lowest).tolist())
    if o is None:
        return low
    level = dict(zip(o.signals, levels_dbhz(o), strict=True))
    strongest = max((level.get(ref.signal, -np.inf) for ref in view.refs), default=-np.inf)
    lobe_db = {k: 20.0 * np.log10(view.refs[k].signal.plan.highest_side_lobe) for k in low}
    return {k for k in low if level.get(view.refs[k].signal, -np.inf) > strongest + lobe_db[k] + POLICY.covered_db}


def _name_antennas(lost: Failing, fault: Fault) -> dict[str, Datum]:
    """Return the numbers of the antennas with a fault, from 1."""
    return {"antennas": tuple(str(k + 1) for k, how in lost.items() if how == fault)}


def _explain_unseen(phases: ArrayPhases, bodies: Sequence[NavState]) -> NotTested:
    """Return whether antennas, a place, or signals with orbits are what is missing."""
    data: dict[str, Datum] = {"receiver": phases.receiver}
    if len(phases.elements_m) < 2:
        return NotTested("few_antennas", data)
    return NotTested("no_signal", data) if bodies else NotTested("no_place", data)


def block_from_view(view: ArrayView, lasting_cyc: Reals, records: Records) -> Block:
    """Return a window's block. lasting_cyc : (M,) of each antenna's phase, what the window's mean keeps."""
    measured, frame = view.measured, view.agreed.frame
    off = residuals(measured, frame)
    return Block(
        refs=view.refs,
        residual_cyc=off - np.rint(off),
        towards=measured.direction @ frame.turn.T,
        white_cyc2=np.maximum(measured.sigma_cyc**2 - lasting_cyc**2, 0.0),
        lasting_cyc2=lasting_cyc**2,
        frame=frame,
        body=frame.turn @ view.state.attitude[view.state.gpst.size // 2].T,
        measured=measured,
        windows=1,
        duration_s=seconds_between(records.end_gpst, records.start_gpst),
    )


def _leave_out_false(finding: Finding, false: Collection[SignalRef]) -> Finding | None:
    """Return a finding of true signals without those that are shown to be false elsewhere; None if none stay."""
    if finding.says != "authentic":
        return finding
    kept = tuple(ref for ref in finding.signals if ref not in false)
    return replace(finding, signals=kept) if kept else None


def select_likeliest(views: Sequence[ArrayView]) -> ArrayView:
    """Select the likeliest of views from several places."""
    return max(views, key=lambda one: (one.accepted, -one.agreed.cost))


def _list_states(records: Records, receiver: str) -> list[NavState]:
    """List the states that the body may be in.

    It is the known state, or one at each place of `list_places`. Without an attitude it is level, heads north, and
    nothing of that is taken for known.
    """
    state = records.nav_state.get(receiver)
    if state is not None and (state.covariance is None or bool(np.isfinite(state.covariance[0, 0, 0]))):
        return [state]
    places = list_places(records, receiver)
    if state is not None:
        return [replace(state, position_ecef_m=np.tile(place, (state.gpst.size, 1))) for place in places]
    return build_level_states(records, places, POLICY.free_attitude_sigma_rad)


def list_places(records: Records, receiver: str) -> list[Reals]:
    """List the places (3,) where a receiver may be: the surveyed one, else that of each of its consistent sets."""
    standing = records.standing.get(receiver)
    if standing is not None and standing.surveyed:
        return [standing.known.mean[:3]]
    return [candidate.position_ecef_m for candidate in records.sets if candidate.receiver == receiver]


def build_level_states(records: Records, places: Sequence[Reals], tilt_sigma_rad: float) -> list[NavState]:
    """Build at each place (3,) a state of a level body with this tilt sigma and an unknown heading."""
    gpst = np.array([records.start_gpst, records.end_gpst])
    known = np.diag([tilt_sigma_rad**2, tilt_sigma_rad**2, POLICY.free_attitude_sigma_rad**2])
    states = []
    for place in places:
        position_ecef_m = np.tile(place, (2, 1))
        attitude = attitude_ecef(position_ecef_m, *np.zeros((3, 2)))
        covariance = np.zeros((2, 9, 9))
        covariance[:, range(6), range(6)] = np.inf
        covariance[:, 6:, 6:] = attitude @ known @ np.swapaxes(attitude, -1, -2)
        states.append(
            NavState(
                gpst=gpst,
                position_ecef_m=position_ecef_m,
                velocity_ecef_m_s=np.zeros((2, 3)),
                attitude=attitude,
                covariance=covariance,
            )
        )
    return states


def _list_unused(view: ArrayView) -> list[NotTested]:
    """Return what was stated and is not used."""
    frame, found = view.agreed.frame, list[NotTested]()
    off_rad = float(np.arccos(np.clip(0.5 * (np.trace(frame.turn) - 1.0), -1.0, 1.0)))
    off = not view.agreed.lone or off_rad > POLICY.attitude_off_sigmas * view.stated.attitude_sigma_rad
    if frame.attitude_free and not view.stated.attitude_free and view.accepted and off:
        found.append(NotTested("attitude_unused", {"off_deg": float(np.degrees(off_rad))} if view.agreed.lone else {}))
    if frame.bias_free and not view.stated.bias_free:
        found.append(NotTested("lines_unused"))
    return found


def _list_directions(view: ArrayView, rows: list[int]) -> tuple[Direction, ...]:
    """List the directions from which signals of one place may come, the likeliest first."""
    measured, agreed = view.measured, view.agreed
    on_ground = agreed.lone if view.accepted else not agreed.frame.attitude_free
    if not view.accepted:
        if agreed.frame.bias_free:
            return ()
        frame = replace(agreed.frame, turn=np.eye(3))
        agreed = replace(agreed, frame=frame, members=np.zeros(0, np.intp), residual_cyc=agreed.residual_cyc[:0])
    part = measured.part(np.array(rows))
    if np.unique(part.ratio).size > 1:
        part = part.part(np.flatnonzero(part.ratio == part.ratio[0]))
    _, cycles, covariance = equal_statistic(part.raw_cyc, white_covariance(part.sigma_cyc), wrapped=True)
    if not on_ground and not view.accepted:
        agreed = replace(agreed, frame=replace(agreed.frame, attitude_covariance_rad2=np.zeros((3, 3))))
    found = find_arrivals(measured, agreed, cycles, covariance, float(part.ratio[0]))
    turn = _rot_enu_body(view.state) if on_ground else np.diag([1.0, 1.0, -1.0]) @ agreed.frame.turn
    seen = [_direction_from_arrival(arrival, turn, "enu" if on_ground else "body") for arrival in found]
    above = [arrival for arrival in seen if np.sin(arrival.elevation_rad) > POLICY.lowest_transmitter_sine]
    return tuple(above or seen)


def _rot_enu_body(state: NavState) -> Reals:
    """Return the rotation (3, 3) from body to east, north, up in the middle of the window."""
    middle = state.gpst.size // 2
    lat, lon, _ = geodetic_from_ecef(state.position_ecef_m[middle])
    return np.asarray(rot_enu_ecef(lat, lon) @ state.attitude[middle])


def _direction_from_arrival(arrival: Arrival, turn: Reals, frame: Any) -> Direction:
    """Convert to azimuth and elevation.

    In east, north, up the azimuth counts from north to east; in the body, from forward to the right.
    """
    turned = turn @ arrival.direction
    azimuth = np.arctan2(turned[0], turned[1]) if frame == "enu" else np.arctan2(turned[1], turned[0])
    elevation = np.arcsin(np.clip(turned[2], -1.0, 1.0))
    # The axes of the covariance, turned, along growing azimuth and elevation.
    axes = across(turned)
    if frame == "enu":
        axes = axes * [[-1.0], [1.0]]
    mixed = axes @ turn @ across(arrival.direction).T
    covariance = mixed @ arrival.covariance_rad2 @ mixed.T
    return Direction(
        azimuth_rad=float(azimuth % (2.0 * np.pi)),
        elevation_rad=float(elevation),
        covariance_rad2=covariance,
        frame=frame,
    )
