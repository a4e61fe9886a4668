"""The report: a verdict and its pictures as one small page that needs no network and no script.

The same verdict and pictures give the same bytes: the page knows no clock and no chance. Everything that came from
outside is escaped, and the page forbids its reader's browser to load anything.
"""

import json
from typing import Any

from skyproof.records import LABELS
from skyproof.report import evidence, methods, summary
from skyproof.report.figures import Pictures, map_figures, signal_figures
from skyproof.report.positions import away_m, away_words
from skyproof.report.template import environment
from skyproof.report.words import distance_words, in_minutes, leap_words, p_value_words, place_words
from skyproof.verdict import CAUSES, Position, ReceiverResult, Signal, Verdict, word_shown

__all__ = ["report_html"]

_SAME_M = 0.05  # is 0.0 m in words
MOST_WINDOWS = 40  # rows of the word over time
MOST_OPEN = 80  # signals whose tables are unfolded at first


def report_html(verdict: Verdict, pictures: Pictures) -> str:
    """The whole page. Draws and words only: every number in it is the verdict's or the pictures' own."""
    page = environment().get_template("page.html.j2")
    return page.render(
        verdict=verdict,
        word=word_shown(verdict.verdict),
        scope=summary.scope(verdict),
        facts=summary.facts(verdict),
        explained=summary.explained(verdict),
        how_sure=summary.how_sure(verdict),
        positions=_positions(verdict),
        own=_own(verdict),
        windows=_windows(verdict),
        more_windows=max(len(verdict.windows) - MOST_WINDOWS, 0),
        maps=map_figures(pictures, minutes=in_minutes(verdict)),
        minutes=in_minutes(verdict),
        leap=_leap(verdict),
        labels=[label for label in LABELS if any(s.label == label for s in verdict.signals)],
        signals=signal_figures(verdict, pictures),
        ran=evidence.ran(verdict, pictures.findings),
        not_run=[(m, methods.title(m.detector)) for m in verdict.methods if not m.ran],
        tables=_tables(verdict),
        day=_day(verdict),
        settings=_lines(verdict.settings),
    )


def _positions(verdict: Verdict) -> list[tuple[ReceiverResult, str, Position, str]]:
    """Receiver, kind, fix, and how far from the last one that may be used."""
    rows = []
    for receiver in verdict.receivers:
        for kind, fix in receiver.fixes:
            away = "" if receiver.usable == (kind, fix) else away_words(receiver, fix)
            rows.append((receiver, kind, fix, "the same" if away and away_m(receiver, fix) < _SAME_M else away))
    return rows


def _windows(verdict: Verdict) -> list[tuple[str, str, str, str, str]]:
    """Receiver, word, from when and to when, and what else may explain it."""
    return [
        (w.receiver, word_shown(w.word), w.from_gpst, w.to_gpst, ", or ".join(CAUSES[cause] for cause in w.may_also_be))
        for w in verdict.windows[:MOST_WINDOWS]
    ]


def _own(verdict: Verdict) -> list[tuple[str, str, str, str, str]]:
    """Receiver, what it is about, what the receiver says of it, from when and to when."""
    rows: list[tuple[str, str, str, str, str]] = []
    for r in verdict.receivers:
        rows += [
            (r.name, s.subject, f"{s.state}{' (alarm)' if s.alarm else ''}", s.since_gpst, s.until_gpst)
            for s in r.own_states
        ]
        if (fix := r.own_fix) is not None:
            place = place_words(fix.lat_deg, fix.lon_deg, 7, minutes=in_minutes(verdict))
            stated = "" if fix.horizontal_sigma_m is None else f" ± {distance_words(fix.horizontal_sigma_m)}"
            rows.append((r.name, "its last position", f"{place}, {fix.height_m:.1f} m{stated}", fix.gpst, ""))
            if fix.from_trusted_m is not None and fix.most_from_trusted_m is not None:
                away = (
                    f"{distance_words(fix.from_trusted_m)} at last, {distance_words(fix.most_from_trusted_m)} at most"
                )
                rows.append((r.name, "from the trusted position", away, fix.most_from_trusted_gpst or fix.gpst, ""))
    return rows


def _tables(verdict: Verdict) -> list[tuple[str, str, bool, list[tuple[Signal, str]]]]:
    """Receiver, count of its labels, whether it is unfolded, and its signals, each with why."""
    tables: list[tuple[str, str, bool, list[tuple[Signal, str]]]] = []
    rows_before = 0
    for receiver in verdict.receivers:
        own = [s for s in verdict.signals if s.receiver == receiver.name]
        if own:
            rows_before += len(own)
            opened = not tables or rows_before <= MOST_OPEN
            tables.append((receiver.name, summary.counts(own), opened, [(s, _why(s)) for s in own]))
    return tables


def _leap(verdict: Verdict) -> str:
    """What GPS time is in UTC, when it begins; empty if no time is known."""
    starts = [receiver.start_gpst for receiver in verdict.receivers if receiver.start_gpst is not None]
    return leap_words(min(starts)) if starts else ""


def _day(verdict: Verdict) -> str:
    """The date of all that was received; empty if there are several, or none is known."""
    instants = [instant for s in verdict.signals for instant in (s.from_gpst, s.to_gpst)]
    days = {instant[:10] for instant in instants if instant is not None}
    return days.pop() if len(days) == 1 and None not in instants else ""


def _why(signal: Signal) -> str:
    if not signal.because:
        return "no evidence"
    return "; ".join(
        methods.reason(b.detector, signal.label) + (f" ({p_value_words(b.p_value)})" if b.p_value is not None else "")
        for b in signal.because
    )


def _lines(settings: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as dotted names and JSON values, in their order."""
    lines: list[tuple[str, str]] = []
    for key, value in settings.items():
        if isinstance(value, dict) and value:
            lines += _lines(value, f"{prefix}{key}.")
        else:
            lines.append((f"{prefix}{key}", json.dumps(value, ensure_ascii=False)))
    return lines
