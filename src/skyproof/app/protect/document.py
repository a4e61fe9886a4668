"""The outcome of a run as the verdict document, in words that are never stronger than the evidence."""

import importlib.metadata
import platform as machine
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.protect.bearings import Bearing, bearings_of, ellipse_95
from skyproof.app.protect.methods import of_detectors
from skyproof.app.protect.noticed import noticed_sizes
from skyproof.app.protect.own_words import own_fix_of, own_states_of, own_words_of
from skyproof.app.protect.positions import KINDS, Positions, Track
from skyproof.app.receive.observed import ObservedFile
from skyproof.app.receive.reception import Reception
from skyproof.arrays import Reals
from skyproof.detectors.base import NEEDS
from skyproof.detectors.entries import of_others
from skyproof.explain import explain, stands_beside
from skyproof.fusion.choice import Compared
from skyproof.fusion.fuse import Decision
from skyproof.fusion.labels import FalseSource, LabelledSignal
from skyproof.fusion.unexplained import Kind, Unexplained
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.time import iso, timedelta_from_s
from skyproof.records import (
    CauseName,
    ConsistentSet,
    Direction,
    Finding,
    Fix,
    NavigationData,
    Need,
    ObservationLog,
)
from skyproof.remarks import Remark, RemarkKind
from skyproof.report.positions import radius_95_m
from skyproof.short_repr import ShortRepr
from skyproof.verdict import (
    VERDICT_FORMAT,
    Because,
    DoubtfulStatement,
    InputFile,
    InterferenceResult,
    InterferenceSpell,
    Place,
    Position,
    ReceiverResult,
    Signal,
    SourceDirection,
    SourcePlace,
    Verdict,
    WeakCarrier,
    clock_words,
)
from skyproof.verdict import Source as SourceModel

__all__ = ["InputNote", "Outcome", "ReceiverOutcome", "document", "versions", "why_untested"]

DIGITS = 6  # of a second in instants


@dataclass(frozen=True, kw_only=True)
class InputNote:
    """One input as it was read. remarks : of any kind (`records.Remark`)."""

    path: str
    format: str
    sha256: str | None
    remarks: tuple[str, ...]

    def of_kind(self, kind: RemarkKind) -> tuple[str, ...]:
        """Select the remarks of a kind, as plain text."""
        return tuple(str(remark) for remark in self.remarks if Remark.kind_of(remark) is kind)

    def file(self) -> InputFile:
        """Make the row of the document."""
        return InputFile(
            path=self.path,
            format=self.format,
            sha256=self.sha256,
            cut=self.of_kind(RemarkKind.CUT),
            left_out=self.of_kind(RemarkKind.BEARS),
            remarks=self.of_kind(RemarkKind.NOTE),
        )


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ReceiverOutcome(ShortRepr):
    """One receiver's positions by kind (`positions.KINDS`, or the name of a source or of one of two open skies).

    tracks : those that have a fix.
    """

    reception: Reception
    positions: Positions | None = None
    tracks: Mapping[str, Track] = field(default_factory=dict)

    @property
    def shown(self) -> dict[str, Track]:
        """By the name of what shows it, whether a source of false signals or one of two open skies."""
        return {name: track for name, track in self.tracks.items() if name not in KINDS}

    @cached_property
    def trusted(self) -> Fix | None:
        """All fixes from authentic signals; None if there is none."""
        return None if self.positions is None else self.positions.whole("trusted")


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Outcome(ShortRepr):
    """Everything that a run found out.

    sets : in the order of their windows. compared : skies beside what was expected, of receivers that had two.
    """

    receivers: tuple[ReceiverOutcome, ...]
    decision: Decision
    evidence: Sequence[Finding]
    sets: Sequence[ConsistentSet]
    navigation: NavigationData
    compared: tuple[Compared, ...] = ()

    @cached_property
    def bearings(self) -> Mapping[str, Bearing]:
        """Of the sources that are seen from trusted places, by their names."""
        trusted = {r.reception.source.name: r.tracks["trusted"] for r in self.receivers if "trusted" in r.tracks}
        return {one.source.name: one for one in bearings_of(self.decision.sources, self.evidence, trusted)}


def document(outcome: Outcome, notes: Sequence[InputNote], settings: Settings, *, interrupted: bool = False) -> Verdict:
    """The verdict document of an outcome."""
    decision = outcome.decision
    receivers = tuple(_receiver(r) for r in outcome.receivers)
    onset = decision.onset
    summary = _summary(outcome) + _noted(outcome) + _left_out(outcome)
    summary = summary[:1].upper() + summary[1:]
    word, why = decision.verdict, _explanation(outcome)
    ended = _interrupted(outcome) if interrupted else _cut(outcome, notes)
    if ended is not None:
        summary = f"{ended.what} {ended.when}; up to then: {summary}"
        if word == "authentic":  # an attack can begin after what was read
            word, why = "no_attack_seen", _Explanation(reason=ended.reason, remedy=ended.remedy)
        if word == "no_attack_seen":
            why = replace(why, not_excluded=(f"what comes {ended.when}", *why.not_excluded))
    return Verdict(
        format=VERDICT_FORMAT,
        verdict=word,
        summary=summary,
        reason=why.reason,
        may_also_be=why.may_also_be,
        not_excluded=why.not_excluded,
        remedy=why.remedy,
        since_gpst=None if onset is None else iso(onset.gpst, DIGITS),
        since_sigma_s=None if onset is None else onset.sigma_s,
        since_earliest_gpst=None if onset is None or onset.earliest is None else iso(onset.earliest, DIGITS),
        since_latest_gpst=None if onset is None else iso(onset.seen, DIGITS),
        until_gpst=None if decision.until is None else iso(decision.until, DIGITS),
        false_alarm_probability_per_hour=settings.false_alarm_probability_per_hour,
        wrong_statements=_wrong_statements(outcome.evidence),
        interference=_interference(outcome),
        noticed=tuple(noticed_sizes(outcome.evidence)),
        assumed=_assumed(outcome),
        receivers=receivers,
        signals=tuple(_signals(outcome)),
        sources=tuple(_sources(outcome)),
        methods=tuple(one.method() for one in of_detectors(outcome.evidence)),
        inputs=tuple(note.file() for note in notes),
        settings=settings.model_dump(mode="json"),
        versions=versions(),
    )


@dataclass(frozen=True, kw_only=True)
class _Ended:
    """What ended before it should and when, why the word is no stronger for it, and what to do."""

    what: str
    when: str
    reason: str
    remedy: str


def _interrupted(outcome: Outcome) -> _Ended:
    """Say when the user ended the run."""
    read_s = max((r.reception.examined_s for r in outcome.receivers), default=0.0)
    whole_s = max((r.reception.source.duration_s for r in outcome.receivers), default=0.0)
    when = f"after {read_s:.1f} of {whole_s:.1f} s"
    return _Ended(what="Interrupted", when=when, reason=f"it ended {when}", remedy="the same command, run to its end")


def _cut(outcome: Outcome, notes: Sequence[InputNote]) -> _Ended | None:
    """Say which input ended before it should, the first of several receivers'; None if none did."""
    cut = {note.path: note.of_kind(RemarkKind.CUT) for note in notes if note.of_kind(RemarkKind.CUT)}
    if not cut:
        return None
    path, when = next(iter(cut)), "where it ends"
    for r in sorted((r.reception for r in outcome.receivers), key=lambda r: r.examined_s, reverse=True):
        own = [one.path for one in (r.source, *(() if r.samples is None else r.samples.others)) if one.path in cut]
        if own:
            path, when = own[0], f"after {r.examined_s:.1f} s of {r.source.name}"
    remedy = "the whole input, once its recorder or its copy has finished"
    return _Ended(what="An input ended", when=when, reason=f"{path}: {cut[path][0]}", remedy=remedy)


def versions() -> dict[str, str]:
    """What matters for doing the same again: of detectors those of other packages."""
    names = ("skyproof", "numpy", "scipy", "numba")
    own = {name: importlib.metadata.version(name) for name in names} | {"python": machine.python_version()}
    return own | {f"detector {name}": package for name, package in of_others().items()}


# ---------------------------------------------------------------------- words


def _assumed(outcome: Outcome) -> str | None:
    """Return under what word and labels hold, in the order of the windows; None where nothing is assumed."""
    words = ("authentic", "spoofed", "attack")
    found = (e for e in outcome.evidence if e.says in words or stands_beside(e))
    assumed = dict.fromkeys(words for e in found for words in explain(e).assumptions)
    if not assumed:
        return None
    said = f"Assumed: {'; '.join(assumed)}."
    if not any(s.label == "authentic" for s in outcome.decision.labels):
        return said
    alone = "The time of a receiver that is attacked alone at its true place is vouched for by its own past only."
    return f"{said} {alone}"


def _interference(outcome: Outcome) -> InterferenceResult:
    """Return what interfered with the receivers, and which were weak from the first epoch on."""
    decision = outcome.decision
    weak_starts = tuple(
        WeakCarrier(
            receiver=weak.receiver,
            carrier=weak.carrier,
            since_gpst=iso(weak.from_gpst, DIGITS),
            cn0_dbhz=weak.cn0_dbhz,
            open_sky_dbhz=weak.least_dbhz,
        )
        for e in outcome.evidence
        for weak in e.weak_start
    )
    if decision.interference is None:
        return InterferenceResult(state="not_tested", weak_starts=weak_starts)
    spells = tuple(
        InterferenceSpell(
            receiver=spell.receiver,
            carriers=spell.carriers,
            since_gpst=iso(spell.since_gpst, DIGITS),
            until_gpst=None if spell.until_gpst is None else iso(spell.until_gpst, DIGITS),
            fall_db=spell.fall_db,
            fall_sigma_db=spell.sigma_db,
            level_db=spell.level_db,
            lost_signals=spell.lost,
            signs=spell.signs,
            may_also_be=("shade",) if spell.may_be_shade else (),
        )
        for spell in decision.interference
    )
    return InterferenceResult(state="present" if spells else "none", spells=spells, weak_starts=weak_starts)


def _wrong_statements(evidence: Sequence[Finding]) -> tuple[DoubtfulStatement, ...]:
    """What else would explain failed tests: each kind of thing about each statement once, by how many tests it does."""
    count = Counter((cause.code, cause.about, cause.words) for e in evidence for cause in e.wrong_statements)
    value = {(cause.code, cause.about, cause.words): cause.value for e in evidence for cause in e.wrong_statements}
    return tuple(
        DoubtfulStatement(code=code, about=about, words=words, value=value[code, about, words])
        for (code, about, words), _ in count.most_common()
    )


def _summary(outcome: Outcome) -> str:
    decision = outcome.decision
    left = _unexplained(decision.unexplained)
    if decision.verdict == "authentic":
        n = len({s.ref.signal.sat for s in decision.labels if s.label == "authentic"})
        sign = (f". {left}" if left else "; no sign of spoofing.") + _without_fix(outcome) + _alone(outcome)
        return f"The signals of {n} satellites come from the sky{sign}{_repeated(outcome)}{_kept(outcome, ' The')}"
    if decision.verdict in ("suspect", "no_attack_seen"):
        said = _explanation(outcome).reason or ""
        rest = f" {left}" if left and left.rstrip(".") not in said else ""
        passed = "" if decision.verdict == "suspect" else "every test that this input allows passed; "
        return f"{passed}{said}.{rest}{_without_fix(outcome)}{_repeated(outcome)}"
    return _attack_words(outcome) + (f" {left}" if left else "") + _without_fix(outcome) + _repeated(outcome)


def _attack_words(outcome: Outcome) -> str:
    decision = outcome.decision
    since = _since(decision)
    if decision.sources:
        sats = {s.signal.sat for source in decision.sources for s in source.signals}
        n = _least_transmitters(decision.sources)
        by = "one transmitter" if n == 1 else f"{n} transmitters" if n else "a second sky beside the true one"
        if n < len([source for source in decision.sources if source.one_antenna]):
            by += " or more"
        if n == 1 and len(decision.sources) == 1:
            by += _direction_words(_seen_from(decision.sources[0], outcome))
            by += _distance_words(outcome.bearings.get(decision.sources[0].name))
        were = "satellite was" if len(sats) == 1 else "satellites were"
        return f"{since}{len(sats)} {were} imitated by {by}{_kept(outcome, '; the')}"
    if decision.skies:
        return (
            f"{since}two or more skies are received, each consistent with a position and time of its own; "
            "which of them is true is not decided."
        )
    return f"{since}signals are received that no true sky gives; which of them are true is not decided."


def _least_transmitters(sources: Sequence[FalseSource]) -> int:
    """How many there are at least: signals of different kinds are told apart from true ones by themselves, and may come
    from one transmitter all the same."""
    kinds = Counter(
        kind for source in sources if source.one_antenna for kind in {ref.signal.kind for ref in source.signals}
    )
    return max(kinds.values(), default=0)


_EXPLAINS: dict[Kind, str] = {
    "double": "beside another one of its satellite: an echo or a false signal would explain it",
    "rival": "earlier or stronger than a true one of its satellite: a false signal would explain it",
    "misfit": "not fitting what the others show: a fault, an echo alone or a false signal would explain it",
    "echo": "later and weaker than a true one of its satellite: an echo would explain it",
    "untested": "without a comparison that tells: received by one receiver only, too shortly, or too much alike",
}


def _unexplained(left: Sequence[Unexplained]) -> str:
    """How many signals stay unknown, how strong, and what would explain them; empty if there are none."""
    words_of_kinds = []
    for kind, words in _EXPLAINS.items():
        own = [u for u in left if u.kind == kind]
        if not own:
            continue
        over = [u.over_db for u in own if u.over_db is not None and np.isfinite(u.over_db)]
        levels = [u.cn0_dbhz for u in own if np.isfinite(u.cn0_dbhz)]
        strong = f"up to {max(levels):.0f} dB-Hz" if levels else "of unknown strength"
        if over:
            strong += f", {abs(max(over)):.0f} dB {'above' if max(over) > 0.0 else 'below'} the other"
        words_of_kinds.append(f"{len(own)} {words} ({strong})")
    if not words_of_kinds:
        return ""
    n = len(left)
    return f"{n} further signal{'s stay' if n > 1 else ' stays'} unexplained: {'; '.join(words_of_kinds)}."


def _without_fix(outcome: Outcome) -> str:
    """For how long the word is of receivers that nobody could have misled, as they had no fix."""
    together: dict[str, list[str]] = {}
    for receiver, seconds in outcome.decision.without_fix_s:
        together.setdefault(f"{seconds:.0f}", []).append(receiver)
    return "".join(
        f" For {seconds} s {' and '.join(receivers)} received too few signals for a position."
        for seconds, receivers in together.items()
    )


def _alone(outcome: Outcome) -> str:
    """For how long the word is not of receivers that were recorded without the others."""
    return "".join(
        f" Nothing is said of {seconds:.0f} s in which {receiver} was recorded and another receiver was not."
        for receiver, seconds in outcome.decision.alone_s
    )


MOST_NOTED = 2


def _noted(outcome: Outcome) -> str:
    """What stands beside the verdict, whatever it is: each sentence once, what names signals first."""
    noted: dict[tuple[Any, ...], Finding] = {}
    for e in outcome.evidence:
        if stands_beside(e):
            key = (e.detector, e.code, *sorted({ref.receiver for ref in e.subject}))
            noted.setdefault(key, e)
    in_order = sorted(noted.values(), key=lambda e: e.says == "attack")
    said = list(dict.fromkeys(explain(e).sentence for e in in_order))
    more = f" {len(said) - MOST_NOTED} more such moments stand in the evidence." if len(said) > MOST_NOTED else ""
    return "".join(f" {text[:1].upper()}{text[1:]}." for text in said[:MOST_NOTED]) + more


def _repeated(outcome: Outcome) -> str:
    """Late copies of a whole sky, named for what they are."""
    words = []
    for r in outcome.receivers:
        name = r.reception.source.name
        late = {s.ref.signal.sat for s in outcome.decision.labels if s.ref.receiver == name and s.label == "multipath"}
        if late:
            words.append(f"{len(late)} satellites in {name}")
    if not words:
        return ""
    return (
        f" The signals of {' and '.join(words)} are received again, late and weaker: a repeater or a reflector, which "
        "shows no other place."
    )


_UNSEEN: dict[Need, str] = {
    Need.NAVIGATION: "any false position and time: without orbits none was computed",
    Need.SETS: "a false position: too few satellites to hold their ranges against each other",
    Need.CCAF: "a second signal within a chip of the true one, which measurements without samples do not show",
}
"""Attacks that pass unseen where records are lacking."""

UNRANGED = "any false place and time that goes on from fix to fix: the log holds no ranges to hold it against"
RANGES = "the receiver's measurements with ranges (UBX-RXM-RAWX, SBF MeasEpoch, RTCM MSM7)"
"""What a log of fixes and C/N0 alone does not show, and what would."""

GIVEN = (Need.NAVIGATION, Need.TWO_RECEIVERS, Need.SETS, Need.ARRAY_PHASES, Need.NAV_STATE, Need.SPIN_ARMS)
"""Records that users can bring, the easiest first; the others are the receiver's own affair."""
MOST_CURES = 2
PREDICTS = (
    'where the receiver is or how it moves, in a platform file: that it stands (motion = "static"), its surveyed '
    "position, its oscillator, or an inertial unit"
)


@dataclass(frozen=True, kw_only=True)
class _Explanation:
    """Why the word is no stronger, and what belongs to that, as the document's keys have it."""

    reason: str | None
    may_also_be: tuple[CauseName, ...] = ()
    not_excluded: tuple[str, ...] = ()
    remedy: str | None = None


def _explanation(outcome: Outcome) -> _Explanation:
    decision = outcome.decision
    left = _unexplained(decision.unexplained).rstrip(".")
    if decision.suspicion is not None:
        found = decision.suspicion
        words = None if found.finding is None else explain(found.finding)
        to_do = (words and words.remedy) or _cure(outcome) or "a longer recording"
        causes: Any = tuple(str(cause) for cause in found.may_also_be)
        return _Explanation(reason=words.sentence if words else left, may_also_be=causes, remedy=to_do)
    question = decision.open
    if question is None:
        return _Explanation(reason=None)
    about = f"which signals of {', '.join(question.receivers)} are true"
    why = left or "none of the tests that this input allows could decide"
    remedy = _cure(outcome) or ("a longer recording" if left else None)
    if question.finding is not None:
        words = explain(question.finding)
        why, remedy = words.sentence, words.remedy or _cure(outcome) or None
        why += f"; the same holds for {', '.join(question.also)}" if question.also else ""
        if remedy is not None and question.distance_m is not None:
            distance_m, sigma_m = question.distance_m
            remedy += (
                f"; these signals come from the sky if the antennas stand {distance_m:.1f} ± {sigma_m:.1f} m apart"
            )
    if decision.verdict == "spoofed":
        return _Explanation(reason=f"{about}: {why}", remedy=remedy)
    return _Explanation(reason=f"it is not shown {about}: {why}", not_excluded=_not_excluded(outcome), remedy=remedy)


def _not_excluded(outcome: Outcome) -> tuple[str, ...]:
    """Attacks that the tests of a run in which all passed would not see, by what was received and what was lacking."""
    ran = {e.detector for e in outcome.evidence if e.p_value is not None}
    lacking = {need for e in outcome.evidence if e.detector not in ran for need in e.lacking}
    found = [words for need, words in _UNSEEN.items() if need in lacking]
    if _unranged(outcome):
        found = [UNRANGED, _UNSEEN[Need.CCAF]]
    receivers = [r for r in outcome.receivers if r.reception.left_out is None]
    by_directions = not {Need.ARRAY_PHASES, Need.SPIN_ARMS} <= lacking
    if len(receivers) > 1:
        found.append("a false sky that reaches one of the receivers alone")
    elif not by_directions:
        found.append("a consistent false sky from the first moment on, which one antenna cannot tell from a true one")
    idle = {e.detector for e in outcome.evidence} - ran - {e.detector for e in outcome.evidence if e.lacking}
    found += [f"what {', '.join(sorted(idle))} would show, with enough to test"] if idle else []
    return (*found, "a takeover that draws position and time off by less than the tests can see")


def why_untested(outcome: Outcome) -> str | None:
    """Why no test at all could run, and what to give, in words; None if any did."""
    if outcome.decision.verdict == "spoofed" or any(e.p_value is not None for e in outcome.evidence):
        return None
    receptions = [r.reception for r in outcome.receivers]
    reasons: list[str] = [
        f"{r.source.path or r.source.name}: {r.left_out}" for r in receptions if r.left_out is not None
    ]
    if len(reasons) < len(receptions):
        names = [r.source.path or r.source.name for r in receptions if r.left_out is None]
        reasons.append(
            f"{', '.join(names)}: no test could run on what was received; give {_cure(outcome) or 'a longer recording'}"
        )
    remarks = [words for r in receptions for words in (*r.source.remarks, *r.remarks)]
    return "; ".join([*reasons, *(words for words in remarks if not words.startswith("left out: "))])


def _cure(outcome: Outcome) -> str:
    """What the user could bring that was lacking; of skies one of which is true, first what says where he is."""
    lacking = {need for e in outcome.evidence for need in e.lacking}
    remedies = (explain(e).remedy for e in outcome.evidence if e.says in ("spoofed", "attack"))
    said = [remedy for remedy in remedies if remedy is not None]
    cures = [*dict.fromkeys(said), *(NEEDS[need] for need in GIVEN if need in lacking)]
    if _unranged(outcome):
        cures.insert(0, RANGES)
    if outcome.decision.skies and Need.NAVIGATION not in lacking:
        cures.insert(0, PREDICTS)
    return ", or ".join(cures[:MOST_CURES])


def _unranged(outcome: Outcome) -> bool:
    """Whether no receiver gave ranges."""
    sources = [r.reception.source for r in outcome.receivers]
    return all(isinstance(source, ObservedFile) and not source.ranged for source in sources)


def _left_out(outcome: Outcome) -> str:
    """Which receivers had no part in the decision, where others had."""
    receptions = [r.reception for r in outcome.receivers if r.reception.left_out is not None]
    if len(receptions) == len(outcome.receivers):
        return ""
    words = "".join(
        f" {r.source.name} holds the same noise as {r.same_as}: one antenna or one file recorded twice; taken as one "
        "receiver."
        for r in receptions
        if r.same_as is not None
    )
    names = [r.source.name for r in receptions if r.same_as is None]
    if names:
        words += f" Without {' and '.join(names)}, which gave no measurements (the remarks on the inputs say why)."
    return words


def _since(decision: Decision) -> str:
    onset = decision.onset
    if onset is None:
        return ""
    clock = clock_words(iso(onset.seen if onset.earliest is None else onset.gpst, 0))
    if onset.from_start:
        return f"From the start on, {clock}, "
    return f"From {clock} on, " if onset.earliest is not None else f"Seen since {clock}, begun then or earlier: "


def _kept(outcome: Outcome, begin: str) -> str:
    """How far the trusted positions can be relied on: the largest 95 % horizontal radius of the last fixes."""
    radii = []
    for r in outcome.receivers:
        if (track := r.tracks.get("trusted")) is not None:
            east, north, _ = _sigmas_enu_m(track.last)
            radii.append(radius_95_m(east, north))
    if not radii:
        return "." if begin.startswith(";") else ""
    return f"{begin} true position is known to within {max(radii):.1f} m horizontally (95 %)."


# ---------------------------------------------------------------------- parts


def _receiver(r: ReceiverOutcome) -> ReceiverResult:
    source, own = r.reception.source, own_words_of(r.reception)
    o = r.reception.observations
    start = source.start_gpst if o is None or o.gpst.size == 0 else _start(o)
    return ReceiverResult(
        name=source.name,
        input=source.path or source.name,
        start_gpst=None if start is None else iso(start, DIGITS),
        duration_s=r.reception.examined_s,
        trusted_fix=_position(r.tracks.get("trusted")),
        false_fix=_position(r.tracks.get("false")),
        unprotected_fix=_position(r.tracks.get("unprotected")),
        own_fix=own_fix_of(own.fixes, r.tracks.get("trusted")),
        own_states=own_states_of(own.states),
    )


def _start(o: ObservationLog) -> np.datetime64:
    start: np.datetime64 = o.gpst[0] - timedelta_from_s(float(o.elapsed_s[0]))
    return start


def _position(track: Track | None) -> Position | None:
    if track is None:
        return None
    fix = track.last
    place = place_of(fix.position_ecef_m[0])
    east, north, up = _sigmas_enu_m(fix)
    horizontal, vertical = (float(level) if np.isfinite(level) else None for level in fix.protection_m[0])
    return Position(
        gpst=iso(fix.gpst[0], DIGITS),
        lat_deg=place.lat_deg,
        lon_deg=place.lon_deg,
        height_m=place.height_m,
        sigma_east_m=east,
        sigma_north_m=north,
        sigma_up_m=up,
        horizontal_protection_m=horizontal,
        vertical_protection_m=vertical,
    )


def place_of(ecef_m: Reals) -> Place:
    """A point on the Earth in degrees."""
    lat, lon, height = geodetic_from_ecef(ecef_m)
    return Place(lat_deg=float(np.degrees(lat)), lon_deg=float(np.degrees(lon)), height_m=float(height))


def _sigmas_enu_m(fix: Fix) -> tuple[float, float, float]:
    lat, lon, _ = geodetic_from_ecef(fix.position_ecef_m[0])
    rot = rot_enu_ecef(lat, lon)
    variances = np.diag(rot @ fix.covariance_m2[0, :3, :3] @ rot.T)
    east, north, up = (float(s) for s in np.sqrt(variances))
    return east, north, up


def _signals(outcome: Outcome) -> list[Signal]:
    sources = {
        ref: source.name for source in (*outcome.decision.sources, *outcome.decision.skies) for ref in source.signals
    }
    by_receiver = {r.reception.source.name: r.reception.observations for r in outcome.receivers}
    signals = []
    for s in outcome.decision.labels:
        o = by_receiver[s.ref.receiver]
        assert o is not None
        signals.append(_signal(s, o, outcome.decision.labels, None if s.label == "authentic" else sources.get(s.ref)))
    return signals


def _signal(s: LabelledSignal, o: ObservationLog, labels: Sequence[LabelledSignal], source: str | None) -> Signal:
    column = o.signals.index(s.ref.signal)
    rows = s.first_epoch, s.last_epoch + 1
    return Signal(
        receiver=s.ref.receiver,
        sat=s.ref.signal.sat,
        band=s.ref.signal.band,
        code=s.ref.signal.code,
        copy=s.ref.signal.copy,
        label=s.label,
        source=source,
        from_gpst=iso(o.gpst[s.first_epoch], DIGITS),
        to_gpst=iso(o.gpst[s.last_epoch], DIGITS),
        cn0_dbhz=_mean(o.series("cn0_dbhz", column, *rows)),
        doppler_hz=_mean(o.series("doppler_hz", column, *rows)),
        delay_to_authentic_m=_delay_m(s, o, labels),
        because=tuple(Because(detector=name, p_value=p) for name, p in s.because),
    )


def _mean(values: Reals) -> float | None:
    """Of what is known; None where nothing is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _delay_m(s: LabelledSignal, o: ObservationLog, labels: Sequence[LabelledSignal]) -> float | None:
    """Mean code delay behind the authentic signal of the same transmission, over the epochs that both have."""
    if s.label == "authentic":
        return 0.0
    delays = []
    for other in labels:
        sent = other.ref.signal.transmission == s.ref.signal.transmission
        same = sent and other.ref.receiver == s.ref.receiver
        if same and other.label == "authentic":
            first = max(s.first_epoch, other.first_epoch)
            rows = first, max(min(s.last_epoch, other.last_epoch) + 1, first)
            a, b = o.signals.index(s.ref.signal), o.signals.index(other.ref.signal)
            delays.append(o.series("pseudorange_m", a, *rows) - o.series("pseudorange_m", b, *rows))
    return _mean(np.concatenate(delays)) if delays else None


def _sources(outcome: Outcome) -> list[SourceModel]:
    models = []
    for source in (*outcome.decision.sources, *outcome.decision.skies):
        shown = [r.tracks[source.name] for r in outcome.receivers if source.name in r.tracks]
        places = [track.last.position_ecef_m[0] for track in shown]
        models.append(
            SourceModel(
                name=source.name,
                kind=_kind(source, outcome.decision),
                sats=tuple(sorted({ref.signal.sat for ref in source.signals})),
                **_seen_from(source, outcome),
                stands=_stands(outcome.bearings.get(source.name)),
                shows=place_of(places[0]) if places else None,
                shows_gpst=iso(shown[0].last.gpst[0], DIGITS) if shown else None,
                time_offset_s=_time_offset_s(source.name, outcome),
            )
        )
    return models


def _stands(bearing: Bearing | None) -> SourcePlace | None:
    """Where a source's rays meet."""
    if bearing is None or bearing.meets is None:
        return None
    place = place_of(bearing.meets.position_ecef_m)
    lat, lon, _ = geodetic_from_ecef(bearing.meets.position_ecef_m)
    up = rot_enu_ecef(lat, lon)[2]
    major_m, minor_m, azimuth_deg = ellipse_95(bearing.meets)
    return SourcePlace(
        lat_deg=place.lat_deg,
        lon_deg=place.lon_deg,
        height_m=place.height_m,
        sigma_up_m=float(np.sqrt(up @ bearing.meets.covariance_m2 @ up)),
        ellipse_major_m=major_m,
        ellipse_minor_m=minor_m,
        ellipse_azimuth_deg=azimuth_deg,
    )


def _distance_words(bearing: Bearing | None) -> str:
    """How far away the rays meet, if they do."""
    if bearing is None or bearing.meets is None:
        return ""
    away_m = [np.linalg.norm(bearing.meets.position_ecef_m - ray.place_ecef_m) for ray in bearing.last.values()]
    return f", {float(min(away_m)) / 1e3:.2g} km away at last"


def _seen_from(source: FalseSource, outcome: Outcome) -> dict[str, Any]:
    """From where a source's signals come, by the window that shows it best: what windows share does not average."""
    signals = frozenset(source.signals)
    shown = [e.directions for e in outcome.evidence if e.directions and signals.issuperset(e.subject)]
    best = min(shown, key=lambda directions: directions[0].sigma_rad, default=())
    directions = tuple(_source_direction(one) for one in best)
    keys = dict.fromkeys(("azimuth_deg", "elevation_deg", "direction_sigma_deg"))
    if len(directions) != 1:
        return {**keys, "directions": directions}
    (only,) = directions
    body = "body_" if only.frame == "body" else ""
    angles = {f"{body}azimuth_deg": only.azimuth_deg, f"{body}elevation_deg": only.elevation_deg}
    return {**keys, **angles, "direction_sigma_deg": float(np.degrees(best[0].sigma_rad)), "directions": directions}


def _direction_words(seen: dict[str, Any]) -> str:
    """Where a source is seen, if that is one direction; empty else."""
    for body, whose in (("", ""), ("body_", " of the body")):
        azimuth_deg, elevation_deg = seen.get(f"{body}azimuth_deg"), seen.get(f"{body}elevation_deg")
        if azimuth_deg is not None and elevation_deg is not None:
            return (
                f" at azimuth {azimuth_deg:.0f}, elevation {elevation_deg:.0f} degrees{whose} "
                f"(one sigma {seen['direction_sigma_deg']:.1f})"
            )
    return ""


def _source_direction(direction: Direction) -> SourceDirection:
    along, up = np.sqrt(np.diag(direction.covariance_rad2))
    return SourceDirection(
        frame="ground" if direction.frame == "enu" else "body",
        azimuth_deg=float(np.degrees(direction.azimuth_rad)),
        elevation_deg=float(np.degrees(direction.elevation_rad)),
        along_sigma_deg=float(np.degrees(along)),
        up_sigma_deg=float(np.degrees(up)),
        correlation=float(np.clip(direction.covariance_rad2[0, 1] / (along * up), -1.0, 1.0)),
    )


def _kind(source: FalseSource, decision: Decision) -> str:
    if source in decision.skies:
        return "a consistent sky; whether the true one is not decided"
    return (
        "one antenna" if source.one_antenna else "a false sky beside the true one; from how many antennas is not known"
    )


def _time_offset_s(name: str, outcome: Outcome) -> float | None:
    """How late the signals of a source are, by the first receiver that shows it: its clock bias from them minus that
    from authentic ones; while it is open which those are, from the sky that arrives first.
    """
    for r in outcome.receivers:
        trusted, shown = r.tracks.get("trusted"), r.shown
        if name not in shown or (trusted is None and len(shown) < 2):
            continue
        reference = [trusted] if trusted is not None else list(shown.values())
        offsets = [_median_difference_s(shown[name], other) for other in reference]
        known = [offset for offset in offsets if offset is not None]
        if known:
            return max(known) if trusted is None else known[0]
    return None


def _median_difference_s(a: Track, b: Track) -> float | None:
    difference = a.clock_bias_s - b.clock_bias_s
    difference = difference[np.isfinite(difference)]
    return float(np.median(difference)) if difference.size else None
