"""The outcome of a run as the verdict document, in words that are never stronger than the evidence."""

import importlib.metadata
import platform as machine
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from skyproof.app.common.settings import Settings
from skyproof.app.protect.explanation import WordReason, explain_word
from skyproof.app.protect.methods import count_by_detector
from skyproof.app.protect.noticed import list_noticed_sizes
from skyproof.app.protect.outcome import DIGITS, InputNote, Outcome, ReceiverOutcome
from skyproof.app.protect.own_words import compare_receiver_fix, list_receiver_states, select_receiver_words
from skyproof.app.protect.positions import KINDS, Track, place_of, sigmas_enu_m
from skyproof.app.protect.sources import list_sources
from skyproof.app.protect.summary import summarize
from skyproof.arrays import Reals
from skyproof.detectors.entries import list_foreign
from skyproof.explain import explain, stands_beside
from skyproof.fusion.decide import WindowWord, find_worst_word
from skyproof.fusion.labels import LabelledSignal
from skyproof.gnss.time import format_iso, timedelta_from_s
from skyproof.records import CauseName, Finding, ObservationLog
from skyproof.remarks import RemarkKind
from skyproof.verdict import (
    VERDICT_FORMAT,
    Because,
    DoubtfulStatement,
    InterferenceResult,
    InterferenceSpell,
    NullResult,
    Position,
    ReceiverResult,
    Signal,
    Verdict,
    WeakCarrier,
    WindowResult,
)

__all__ = ["document", "list_versions"]


def document(outcome: Outcome, notes: Sequence[InputNote], settings: Settings, *, interrupted: bool = False) -> Verdict:
    """Make the verdict document of an outcome."""
    decision = outcome.decision
    windows = tuple(_window(row) for row in decision.windows)
    receivers = tuple(_receiver(r, windows) for r in outcome.receivers)
    onset = decision.onset
    word, why = decision.verdict, explain_word(outcome)
    summary = summarize(outcome, why)
    ended = _describe_interruption(outcome) if interrupted else _describe_cut(outcome, notes)
    if ended is not None:
        summary = f"{ended.what} {ended.when}; up to then: {summary}"
        if word == "authentic":  # an attack can begin after what was read
            word, why = "no_attack_seen", WordReason(reason=ended.reason, remedy=ended.remedy)
        if word == "no_attack_seen":
            why = replace(why, not_excluded=(f"any attack {ended.when}", *why.not_excluded))
    return Verdict(
        format=VERDICT_FORMAT,
        verdict=word,
        summary=summary,
        reason=why.reason,
        may_also_be=why.may_also_be,
        not_excluded=why.not_excluded,
        remedy=why.remedy,
        since_gpst=None if onset is None else format_iso(onset.gpst, DIGITS),
        since_sigma_s=None if onset is None else onset.sigma_s,
        since_earliest_gpst=None if onset is None or onset.earliest is None else format_iso(onset.earliest, DIGITS),
        since_latest_gpst=None if onset is None else format_iso(onset.seen, DIGITS),
        until_gpst=None if decision.until is None else format_iso(decision.until, DIGITS),
        false_alarm_probability_per_hour=settings.false_alarm_probability_per_hour,
        wrong_statements=_count_wrong_statements(outcome.evidence),
        interference=_interference(outcome),
        windows=windows,
        noticed=tuple(list_noticed_sizes(outcome.evidence)),
        assumed=_list_assumptions(outcome),
        receivers=receivers,
        signals=tuple(_signals(outcome)),
        sources=tuple(list_sources(outcome)),
        methods=tuple(row.method() for row in count_by_detector(outcome.evidence)),
        inputs=tuple(note.file() for note in notes),
        settings=settings.model_dump(mode="json"),
        versions=list_versions(),
    )


@dataclass(frozen=True, kw_only=True)
class _Ended:
    """What ended before it should and when, why the word is no stronger for it, and what to do."""

    what: str
    when: str
    reason: str
    remedy: str


def _describe_interruption(outcome: Outcome) -> _Ended:
    """State when the user ended the run."""
    read_s = max((r.reception.examined_s for r in outcome.receivers), default=0.0)
    whole_s = max((r.reception.source.duration_s for r in outcome.receivers), default=0.0)
    when = f"after {read_s:.1f} of {whole_s:.1f} s"
    return _Ended(
        what="Interrupted", when=when, reason=f"the run ended {when}", remedy="the same command, run to its end"
    )


def _describe_cut(outcome: Outcome, notes: Sequence[InputNote]) -> _Ended | None:
    """State which input ended before it should, the first of several receivers'; None if none did."""
    cut = {note.path: note.of_kind(RemarkKind.CUT) for note in notes if note.of_kind(RemarkKind.CUT)}
    if not cut:
        return None
    path, when = next(iter(cut)), "where it ends"
    for r in sorted((r.reception for r in outcome.receivers), key=lambda r: r.examined_s, reverse=True):
        cut_parts = [
            part.path for part in (r.source, *(() if r.samples is None else r.samples.others)) if part.path in cut
        ]
        if cut_parts:
            path, when = cut_parts[0], f"after {r.examined_s:.1f} s of {r.source.name}"
    remedy = "the whole input, once its recorder or its copy has finished"
    return _Ended(what="An input ended", when=when, reason=f"{path}: {cut[path][0]}", remedy=remedy)


def list_versions() -> dict[str, str]:
    """List the versions that matter for doing the same again; of detectors those of other packages."""
    names = ("skyproof", "numpy", "scipy", "numba")
    packages = {name: importlib.metadata.version(name) for name in names} | {"python": machine.python_version()}
    return packages | {f"detector {name}": package for name, package in list_foreign().items()}


def _list_assumptions(outcome: Outcome) -> str | None:
    """State the assumptions under which word and labels hold; None where nothing is assumed."""
    words = ("authentic", "spoofed", "attack")
    found = (e for e in outcome.evidence if e.says in words or stands_beside(e))
    assumed = dict.fromkeys(words for e in found for words in explain(e).assumptions)
    if outcome.rest is not None and any(r.has_rest_fixes for r in outcome.receivers):
        n = outcome.rest.faults
        one = "one satellite" if n == 1 else f"{n} satellites"
        assumed[f"of the signals that are not named as false, those of {one} at most are false as well"] = None
    if any(r.has_fixes_behind_null for r in outcome.receivers):
        assumed["what is received behind a null comes from the sky, not from a further transmitter"] = None
    if not assumed:
        return None
    sentence = f"Assumed: {'; '.join(assumed)}."
    if not any(s.label == "authentic" for s in outcome.decision.labels):
        return sentence
    alone = "The time of a receiver that is attacked alone at its true place is checked against its own history only."
    return f"{sentence} {alone}"


def _interference(outcome: Outcome) -> InterferenceResult:
    """Return what interfered with the receivers, and which were weak from the first epoch on."""
    decision = outcome.decision
    weak_starts = tuple(
        WeakCarrier(
            receiver=weak.receiver,
            carrier=weak.carrier,
            since_gpst=format_iso(weak.from_gpst, DIGITS),
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
            since_gpst=format_iso(spell.since_gpst, DIGITS),
            until_gpst=None if spell.until_gpst is None else format_iso(spell.until_gpst, DIGITS),
            fall_db=spell.fall_db,
            fall_sigma_db=spell.sigma_db,
            level_db=spell.level_db,
            jammer_to_noise_db=None if spell.jammer is None else spell.jammer.db,
            jammer_to_noise_low_db=None if spell.jammer is None else spell.jammer.low_db,
            jammer_to_noise_high_db=None if spell.jammer is None else spell.jammer.high_db,
            lost_signals=spell.lost,
            signs=spell.signs,
            may_also_be=("shade",) if spell.may_be_shade else (),
        )
        for spell in decision.interference
    )
    return InterferenceResult(state="present" if spells else "none", spells=spells, weak_starts=weak_starts)


def _count_wrong_statements(evidence: Sequence[Finding]) -> tuple[DoubtfulStatement, ...]:
    """Count the statements of the user that would explain failed tests, the most frequent first."""
    count = Counter((cause.code, cause.about, cause.words) for e in evidence for cause in e.wrong_statements)
    value = {(cause.code, cause.about, cause.words): cause.value for e in evidence for cause in e.wrong_statements}
    return tuple(
        DoubtfulStatement(code=code, about=about, words=words, value=value[code, about, words])
        for (code, about, words), _ in count.most_common()
    )


def _window(word: WindowWord) -> WindowResult:
    return WindowResult(
        receiver=word.receiver,
        word=word.word,
        from_gpst=format_iso(word.start_gpst, DIGITS),
        to_gpst=format_iso(word.end_gpst, DIGITS),
        may_also_be=cast("tuple[CauseName, ...]", word.causes),
    )


def _receiver(r: ReceiverOutcome, windows: Sequence[WindowResult]) -> ReceiverResult:
    source, receiver_words = r.reception.source, select_receiver_words(r.reception)
    o = r.reception.observations
    start = source.start_gpst if o is None or o.gpst.size == 0 else _start(o)
    return ReceiverResult(
        name=source.name,
        word=find_worst_word(window.word for window in windows if window.receiver == source.name),
        input=source.path or source.name,
        start_gpst=None if start is None else format_iso(start, DIGITS),
        duration_s=r.reception.examined_s,
        **{f"{kind}_fix": _position(r.tracks.get(kind)) for kind in KINDS},
        behind_null=_describe_null(r),
        own_fix=compare_receiver_fix(receiver_words.fixes, r.tracks.get("trusted")),
        own_states=list_receiver_states(receiver_words.states),
    )


def _describe_null(r: ReceiverOutcome) -> NullResult | None:
    """Describe what was found behind a null."""
    if r.positions is None or (behind := r.positions.behind_null) is None:
        return None
    track = r.tracks.get("consistent")
    fixed = np.flatnonzero(behind.epochs)
    gpst = [format_iso(track.gpst[row], DIGITS) for row in fixed[[0, -1]]] if track is not None and fixed.size else None
    return NullResult(
        source_to_noise_db=10.0 * float(np.log10(behind.source_to_noise)),
        word=behind.word,
        from_gpst=None if gpst is None else gpst[0],
        to_gpst=None if gpst is None else gpst[1],
        seconds=behind.seconds,
        cn0_cost_db=behind.cost_db,
    )


def _start(o: ObservationLog) -> np.datetime64:
    start: np.datetime64 = o.gpst[0] - timedelta_from_s(float(o.elapsed_s[0]))
    return start


def _position(track: Track | None) -> Position | None:
    if track is None:
        return None
    fix = track.last
    place = place_of(fix.position_ecef_m[0])
    east, north, up = sigmas_enu_m(fix)
    horizontal, vertical = (float(level) if np.isfinite(level) else None for level in fix.protection_m[0])
    return Position(
        gpst=format_iso(fix.gpst[0], DIGITS),
        lat_deg=place.lat_deg,
        lon_deg=place.lon_deg,
        height_m=place.height_m,
        sigma_east_m=east,
        sigma_north_m=north,
        sigma_up_m=up,
        horizontal_protection_m=horizontal,
        vertical_protection_m=vertical,
        hidden_m=float(fix.hidden_m[0]) if np.isfinite(fix.hidden_m[0]) else None,
    )


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
        from_gpst=format_iso(o.gpst[s.first_epoch], DIGITS),
        to_gpst=format_iso(o.gpst[s.last_epoch], DIGITS),
        cn0_dbhz=_average(o.series("cn0_dbhz", column, *rows)),
        doppler_hz=_average(o.series("doppler_hz", column, *rows)),
        delay_to_authentic_m=_average_delay_m(s, o, labels),
        because=tuple(Because(detector=name, p_value=p) for name, p in s.because),
    )


def _average(values: Reals) -> float | None:
    """Average the values that are known; None where none is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else None


def _average_delay_m(s: LabelledSignal, o: ObservationLog, labels: Sequence[LabelledSignal]) -> float | None:
    """Average the code delay behind the authentic signal of the same transmission, over common epochs."""
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
    return _average(np.concatenate(delays)) if delays else None
