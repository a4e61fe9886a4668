"""The report: a verdict and its pictures as one small page that needs no network and no script.

The same verdict and pictures give the same bytes: the page knows no clock and no chance. Everything that came from
outside is escaped, and the page forbids its reader's browser to load anything.
"""

import json
from typing import Any

from skyproof.records import LABELS
from skyproof.report import evidence, methods, summary
from skyproof.report.figures import Pictures, draw_map_figures, draw_signal_figures
from skyproof.report.positions import away_m, describe_distance
from skyproof.report.template import load_environment
from skyproof.report.words import distance_words, leap_words, p_value_words, place_words, uses_minutes
from skyproof.verdict import CAUSES, Position, ReceiverResult, Signal, Verdict, write_word

__all__ = ["write_report_html"]

_SAME_M = 0.05  # is 0.0 m in words
MOST_WINDOWS = 40  # rows of the word over time
MOST_OPEN = 80  # signals whose tables are unfolded at first


def write_report_html(verdict: Verdict, pictures: Pictures) -> str:
    """Write the whole page. It computes nothing: every number is the verdict's or the pictures' own."""
    page = load_environment().get_template("page.html.j2")
    return page.render(
        verdict=verdict,
        word=write_word(verdict.verdict),
        scope=summary.scope(verdict),
        facts=summary.list_facts(verdict),
        explained=summary.list_explanations(verdict),
        how_sure=summary.describe_certainty(verdict),
        positions=_list_positions(verdict),
        own=_list_receiver_words(verdict),
        windows=_list_windows(verdict),
        more_windows=max(len(verdict.windows) - MOST_WINDOWS, 0),
        maps=draw_map_figures(pictures, minutes=uses_minutes(verdict)),
        minutes=uses_minutes(verdict),
        leap=_describe_leap(verdict),
        labels=[label for label in LABELS if any(s.label == label for s in verdict.signals)],
        signals=draw_signal_figures(verdict, pictures),
        ran=evidence.describe_methods(verdict, pictures.findings),
        not_run=[(m, methods.title(m.detector)) for m in verdict.methods if not m.ran],
        tables=_list_signals(verdict),
        day=_common_day(verdict),
        settings=_list_settings(verdict.settings),
    )


def _list_positions(verdict: Verdict) -> list[tuple[ReceiverResult, str, Position, str]]:
    """List receiver, kind, fix, and how far it is from the last usable one."""
    rows = []
    for receiver in verdict.receivers:
        for kind, fix in receiver.fixes:
            away = "" if receiver.usable == (kind, fix) else describe_distance(receiver, fix)
            rows.append((receiver, kind, fix, "the same" if away and away_m(receiver, fix) < _SAME_M else away))
    return rows


def _list_windows(verdict: Verdict) -> list[tuple[str, str, str, str, str]]:
    """List receiver, word, from when and to when, and what else may explain it."""
    return [
        (w.receiver, write_word(w.word), w.from_gpst, w.to_gpst, ", or ".join(CAUSES[cause] for cause in w.may_also_be))
        for w in verdict.windows[:MOST_WINDOWS]
    ]


def _list_receiver_words(verdict: Verdict) -> list[tuple[str, str, str, str, str]]:
    """List what receivers say of themselves: receiver, subject, statement, from when and to when."""
    rows: list[tuple[str, str, str, str, str]] = []
    for r in verdict.receivers:
        rows += [
            (r.name, s.subject, f"{s.state}{' (alarm)' if s.alarm else ''}", s.since_gpst, s.until_gpst)
            for s in r.own_states
        ]
        if (fix := r.own_fix) is not None:
            place = place_words(fix.lat_deg, fix.lon_deg, 7, minutes=uses_minutes(verdict))
            stated = "" if fix.horizontal_sigma_m is None else f" ± {distance_words(fix.horizontal_sigma_m)}"
            rows.append((r.name, "its last position", f"{place}, {fix.height_m:.1f} m{stated}", fix.gpst, ""))
            if fix.from_trusted_m is not None and fix.most_from_trusted_m is not None:
                away = (
                    f"{distance_words(fix.from_trusted_m)} at last, {distance_words(fix.most_from_trusted_m)} at most"
                )
                rows.append((r.name, "from the trusted position", away, fix.most_from_trusted_gpst or fix.gpst, ""))
    return rows


def _list_signals(verdict: Verdict) -> list[tuple[str, str, bool, list[tuple[Signal, str]]]]:
    """List receivers with the count of their labels, whether they unfold, and signals with reasons."""
    tables: list[tuple[str, str, bool, list[tuple[Signal, str]]]] = []
    rows_before = 0
    for receiver in verdict.receivers:
        signals_of_receiver = [s for s in verdict.signals if s.receiver == receiver.name]
        if signals_of_receiver:
            rows_before += len(signals_of_receiver)
            opened = not tables or rows_before <= MOST_OPEN
            tables.append(
                (
                    receiver.name,
                    summary.count_labels(signals_of_receiver),
                    opened,
                    [(s, _why(s)) for s in signals_of_receiver],
                )
            )
    return tables


def _describe_leap(verdict: Verdict) -> str:
    """State how GPS time differs from UTC, when the run begins; empty if no time is known."""
    starts = [receiver.start_gpst for receiver in verdict.receivers if receiver.start_gpst is not None]
    return leap_words(min(starts)) if starts else ""


def _common_day(verdict: Verdict) -> str:
    """Return the date of all that was received; empty if there are several, or none is known."""
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


def _list_settings(settings: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """List nested settings as dotted names and JSON values, in their order."""
    lines: list[tuple[str, str]] = []
    for key, value in settings.items():
        if isinstance(value, dict) and value:
            lines += _list_settings(value, f"{prefix}{key}.")
        else:
            lines.append((f"{prefix}{key}", json.dumps(value, ensure_ascii=False)))
    return lines
