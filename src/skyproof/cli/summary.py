"""The verdict as a person reads it at a terminal."""

from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from skyproof.cli.screen import complain, print_document, print_path, print_table, table, words
from skyproof.formats.verdict import write_verdict_json
from skyproof.gnss.time import format_utc
from skyproof.report.summary import list_explanations
from skyproof.report.what_now import what_now
from skyproof.report.words import angle_words, leap_words, uses_minutes
from skyproof.verdict import Verdict, list_possible_places, write_word

if TYPE_CHECKING:
    from skyproof.app.protect import ProtectResult

__all__ = ["print_result"]

STYLES = {
    "authentic": "bold blue",
    "trusted": "blue",
    "consistent": "cyan",
    "suspect": "bold yellow",
    "spoofed": "bold dark_orange",
    "false": "dark_orange",
}


def print_result(result: "ProtectResult", *, as_json: bool, incomplete: bool = False) -> None:
    """Print the verdict, as JSON or in words, and where the report is; not all files are there if `incomplete`."""
    if result.interrupted:
        complain("interrupted: this is what was decided so far")
    if as_json:
        for input_file in result.verdict.inputs:
            for remark in (*input_file.cut, *input_file.left_out):
                complain(f"{input_file.path}: {remark}")
        print_document(write_verdict_json(result.verdict))
    else:
        _print_summary(result.verdict)
        report = None if result.folder is None else result.folder / "report.html"
        if report is not None and (report.exists() or not incomplete):
            print_path("report:", report)


def _print_summary(verdict: Verdict) -> None:
    console = Console()
    console.print(words(write_word(verdict.verdict).upper(), style=STYLES.get(verdict.verdict, "bold")))
    for advice, reason in what_now(verdict):
        console.print(words(f"{advice}: {reason}", style="bold"))
    console.print()
    console.print(words(verdict.summary))
    if verdict.since_gpst is not None:
        console.print(words(verdict.onset_words))
    for heading, text in list_explanations(verdict):
        console.print(words(f"{heading} {text}"))
    starts = [receiver.start_gpst for receiver in verdict.receivers if receiver.start_gpst is not None]
    if starts:
        console.print(words(f"Clock times in sentences are GPS time: {leap_words(starts[0])}", style="dim"))
    console.print()
    if (positions := _positions(verdict)).row_count:
        print_table(console, positions)
        console.print()
    if (signals := _signals(verdict)).row_count:
        print_table(console, signals)
        console.print()
    if absent := [method.detector for method in verdict.methods if not method.ran]:
        console.print(words(f"Tests that could not run: {', '.join(absent)} (the report says why)"))


def _positions(verdict: Verdict) -> Table:
    unit = "" if uses_minutes(verdict) else " °"
    rows = table(
        "receiver",
        "position",
        f"latitude{unit}",
        f"longitude{unit}",
        "height m",
        "± E/N/U m",
        "hidden m",
        "GPS time",
        "UTC",
        numbers=7,
    )
    for receiver in verdict.receivers:
        for kind, fix in receiver.fixes:
            rows.add_row(
                words(receiver.name),
                words(kind, style=STYLES.get(kind, "")),
                *_write_angles(verdict, fix.lat_deg, fix.lon_deg),
                f"{fix.height_m:.1f}",
                f"{fix.sigma_east_m:.1f}/{fix.sigma_north_m:.1f}/{fix.sigma_up_m:.1f}",
                "" if fix.hidden_m is None else f"{fix.hidden_m:.0f}",
                *_write_clocks(fix.gpst),
            )
    for names, source, place in list_possible_places(verdict):
        rows.add_row(
            words(names),
            words(source.name),
            *_write_angles(verdict, place.lat_deg, place.lon_deg),
            f"{place.height_m:.1f}",
            "",
            "",
            *_write_clocks(source.shows_gpst),
        )
    return rows


def _write_angles(verdict: Verdict, lat_deg: float, lon_deg: float) -> tuple[str, str]:
    """Write latitude and longitude as the run's setting has them."""
    if uses_minutes(verdict):
        return angle_words(lat_deg, lon_deg, 7, minutes=True)
    return f"{lat_deg:.7f}", f"{lon_deg:.7f}"


def _write_clocks(gpst: str | None) -> tuple[str, str]:
    """Write hours, minutes and seconds by GPS time and by UTC."""
    return ("", "") if gpst is None else (gpst[11:19], format_utc(gpst)[11:19])


def _signals(verdict: Verdict) -> Table:
    rows = table("receiver", "signals", "label", "satellites")
    for receiver in verdict.receivers:
        for label in ("authentic", "spoofed", "multipath", "unknown"):
            receiver_signals = {
                (s.sat, s.band, s.code, s.copy)
                for s in verdict.signals
                if s.receiver == receiver.name and s.label == label
            }
            if receiver_signals:
                sats = sorted({signal[0] for signal in receiver_signals})
                rows.add_row(
                    words(receiver.name),
                    str(len(receiver_signals)),
                    words(label, style=STYLES.get(label, "")),
                    words(" ".join(sats)),
                )
    return rows
