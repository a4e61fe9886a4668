"""Arguments in, words out: one function a command.

Results go to standard output, everything else to standard error. Exit codes: 0 it ran to its end; with --exit-code
0 authentic, 1 spoofed, 3 undecided; 2 an error, told in one line; 130 interrupted, with what was decided so far.
"""

import sys
import traceback
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, CycloptsError, Parameter
from rich import progress as rich_progress
from rich.console import Console
from rich.table import Table
from rich.text import Text

from skyproof.app.demo import demo as run_demo
from skyproof.app.inspect import Inspection, document_json
from skyproof.app.inspect import inspect as run_inspect
from skyproof.app.progress import Progress, Stage
from skyproof.app.protect import ProtectResult
from skyproof.app.protect import protect as run_protect
from skyproof.app.receive import receive as run_receive
from skyproof.app.settings import Settings
from skyproof.errors import SkyproofError
from skyproof.formats.verdict import verdict_json
from skyproof.report.words import instant_words
from skyproof.verdict import Position, Verdict

__all__ = ["app", "main"]

EXIT_CODES = {"authentic": 0, "spoofed": 1, "undecided": 3}
ERROR, INTERRUPTED = 2, 130
STYLES = {"authentic": "bold blue", "trusted": "blue", "spoofed": "bold dark_orange", "false": "dark_orange"}
AFTER_DEMO = "Example, with the recordings that `skyproof demo --out demo` makes:\n\n"

app = App(
    name="skyproof",
    help="Tells true satellite-navigation signals from false ones, and gives the true position and time back.",
    help_epilogue="Try it: `skyproof demo --out demo`",
    version=lambda: version("skyproof"),
    default_parameter=Parameter(negative=(), show_default=False),
    suppress_keyboard_interrupt=False,
)


def _setting(name: str) -> Parameter:
    """The help of an option that is a setting: its description and default, from where they are defined."""
    field = Settings.model_fields[name]
    default = "the end" if field.default is None else f"{field.default:g}"
    return Parameter(help=f"{field.description} Default: {default}.")


Nav = Annotated[Path | None, Parameter(help="RINEX navigation file; without it the signals' own messages are used.")]
Json = Annotated[bool, Parameter(name="--json", help="Print verdict.json on standard output, and nothing else there.")]
# `main` looks for --debug itself, since it is to work for errors in the options as well; here it is for the help.
Debug = Annotated[bool, Parameter(help="Show the traceback of an error.")]


@app.command(
    help_epilogue=AFTER_DEMO + "skyproof protect demo/bow.bin demo/stern.bin --nav demo/broadcast.rnx --out out"
)
def protect(
    inputs: Annotated[list[Path], Parameter(name="INPUT", help="Recordings, one a receiver, each with its sidecar.")],
    /,
    *,
    out: Annotated[Path, Parameter(help="Folder for the verdict, the report, fixes and all other files.")],
    nav: Nav = None,
    platform: Annotated[Path | None, Parameter(help="Platform file: settings in its table [protect].")] = None,
    false_alarm_probability_per_hour: Annotated[float | None, _setting("false_alarm_probability_per_hour")] = None,
    antenna_separation_m: Annotated[float | None, _setting("antenna_separation_m")] = None,
    start_s: Annotated[float | None, _setting("start_s")] = None,
    duration_s: Annotated[float | None, _setting("duration_s")] = None,
    json: Json = False,
    exit_code: Annotated[bool, Parameter(help="Exit with 0 authentic, 1 spoofed, 3 undecided.")] = False,
    debug: Debug = False,
) -> int:
    """Say whether signals in recordings are spoofed, since when and which, and give the position to be trusted."""
    result = run_protect(
        inputs,
        nav=nav,
        platform=platform,
        out=out,
        false_alarm_probability_per_hour=false_alarm_probability_per_hour,
        antenna_separation_m=antenna_separation_m,
        start_s=start_s,
        duration_s=duration_s,
        progress=_progress(),
    )
    _tell(result, as_json=json)
    if result.interrupted:
        return INTERRUPTED
    return EXIT_CODES[result.verdict.verdict] if exit_code else 0


@app.command(help_epilogue=AFTER_DEMO + "skyproof inspect demo/bow.bin")
def inspect(
    file: Annotated[Path, Parameter(help="A recording; raw samples with a sidecar, or with the options below.")],
    /,
    *,
    sidecar: Annotated[Path | None, Parameter(help="How to read raw samples; else NAME.toml beside NAME.bin.")] = None,
    rate_hz: Annotated[float | None, Parameter(help="Samples a second; this and the next as in a sidecar.")] = None,
    kind: Annotated[Literal["real", "complex"] | None, Parameter(help="Real or complex samples.")] = None,
    encoding: Annotated[
        Literal["int", "float", "sign", "sign-magnitude", "offset-binary"] | None, Parameter(help="Of the numbers.")
    ] = None,
    bits: Annotated[int | None, Parameter(help="Of one number.")] = None,
    centre_hz: Annotated[float | None, Parameter(help="The radio frequency that lies at the next one.")] = None,
    if_hz: Annotated[float | None, Parameter(help="Where that lies in the samples.")] = None,
    bit_order: Annotated[
        Literal["msb-first", "lsb-first"] | None, Parameter(help="Where in its byte the first number lies.")
    ] = None,
    byte_order: Annotated[Literal["little", "big"] | None, Parameter(help="Of numbers of several bytes.")] = None,
    header_bytes: Annotated[int | None, Parameter(help="Bytes to skip at the start.")] = None,
    swap_iq: Annotated[bool | None, Parameter(help="Q comes before I.")] = None,
    conjugate: Annotated[bool | None, Parameter(help="The spectrum is inverted.")] = None,
    start_gpst: Annotated[str | None, Parameter(help="GPS time of the first sample: 2022-01-01T21:45:58.")] = None,
    json: Annotated[bool, Parameter(name="--json", help="Print one JSON document, and nothing else there.")] = False,
    debug: Debug = False,
) -> int:
    """Say what is in a recording, and whether it is usable: levels, lines, satellites, lost samples, oscillator."""
    layout = {
        "rate_hz": rate_hz, "kind": kind, "encoding": encoding, "bits": bits, "centre_hz": centre_hz, "if_hz": if_hz,
        "bit_order": bit_order, "byte_order": byte_order, "header_bytes": header_bytes, "swap_iq": swap_iq,
        "conjugate": conjugate, "start_gpst": start_gpst,
    }  # fmt: skip
    inspections = run_inspect(file, sidecar=sidecar, layout=layout)
    if json:
        sys.stdout.write(document_json(inspections))
        return 0
    for inspection in inspections:
        _print_inspection(inspection)
    return 0


@app.command(help_epilogue=AFTER_DEMO + "skyproof receive demo/bow.bin --nav demo/broadcast.rnx --out out")
def receive(
    files: Annotated[list[Path], Parameter(name="FILE", help="Recordings, one a receiver, each with its sidecar.")],
    /,
    *,
    out: Annotated[Path, Parameter(help="Folder for RINEX observations and navigation data.")],
    nav: Nav = None,
    debug: Debug = False,
) -> int:
    """Track every signal in recordings and write RINEX observations and navigation data, without judging them."""
    result = run_receive(files, out=out, nav=nav, progress=_progress())
    console = Console()
    for reception in result.receptions:
        console.print(Text(f"{reception.samples.name}: {reception.n_signals} signals"))
        for remark in reception.remarks:
            console.print(Text(f"  {remark}", style="dim"))
    if result.folder is not None:
        _print_path("files in", result.folder)
    return INTERRUPTED if result.interrupted else 0


@app.command(help_epilogue="Example:\n\nskyproof demo --out demo")
def demo(
    *,
    out: Annotated[
        Path, Parameter(help="Folder for the recordings and the results.", show_default=True)
    ] = Path("skyproof-demo"),
    json: Json = False,
    open_report: Annotated[bool, Parameter(name="--open", help="Open the report in the browser.")] = False,
    debug: Debug = False,
) -> int:
    """Simulate two receivers near a meaconer, which rebroadcasts the sky of another place, and protect them."""
    result = run_demo(out, progress=_progress())
    _tell(result, as_json=json)
    if open_report and result.folder is not None:
        webbrowser.open((result.folder / "report.html").resolve().as_uri())
    return INTERRUPTED if result.interrupted else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line (without the program's name) and return its exit code; never raises."""
    tokens = list(sys.argv[1:] if argv is None else argv)
    try:
        result = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        return result if isinstance(result, int) else 0
    except KeyboardInterrupt:
        _complain("interrupted before anything was decided")
        return INTERRUPTED
    except Exception as error:
        if "--debug" in tokens:
            traceback.print_exc()
        _complain(_words_of(error))
        return ERROR


def _words_of(error: Exception) -> str:
    if isinstance(error, SkyproofError):
        return str(error)
    if isinstance(error, CycloptsError):
        command = " ".join(("skyproof", *(error.command_chain or ())))
        return f"{error} For help: {command} --help"
    return (
        f"unexpected {type(error).__name__}: {error}. This is a fault of skyproof, not of the input: run the command "
        "again with --debug and report what it prints"
    )


def _complain(text: str) -> None:
    print(f"skyproof: {' '.join(text.split())}", file=sys.stderr)


# What a person reads


def _tell(result: ProtectResult, *, as_json: bool) -> None:
    if result.interrupted:
        _complain("interrupted: this is what was decided so far")
    if as_json:
        sys.stdout.write(verdict_json(result.verdict))
    else:
        _print_summary(result.verdict)
        if result.folder is not None:
            _print_path("report:", result.folder / "report.html")


def _print_path(words: str, path: Path) -> None:
    """A path on one line however long it is, so that it can be copied."""
    Console().print(Text(f"{words} {path}"), soft_wrap=True)


def _print_summary(verdict: Verdict) -> None:
    console = Console()
    console.print(Text(verdict.verdict.upper(), style=STYLES.get(verdict.verdict, "bold")))
    console.print(Text(verdict.summary))
    if verdict.since_gpst is not None:
        sigma = "" if verdict.since_sigma_s is None else f" ± {verdict.since_sigma_s:.2g} s"
        until = "" if verdict.until_gpst is None else f", until {instant_words(verdict.until_gpst)}"
        console.print(Text(f"since {instant_words(verdict.since_gpst)}{sigma} GPS time{until}"))
    if verdict.undecided_because:
        console.print(Text(f"not decided: {verdict.undecided_because}"))
    console.print()
    if (positions := _positions(verdict)).row_count:
        console.print(positions)
        console.print()
    if (signals := _signals(verdict)).row_count:
        console.print(signals)
        console.print()
    if absent := [method.detector for method in verdict.methods if not method.ran]:
        console.print(Text(f"not tested: {', '.join(absent)} (the report says why)"))


def _print_inspection(inspection: Inspection) -> None:
    """One screen: the sentence, the front end, the satellites, what is wrong."""
    console = Console()
    samples, front = inspection.samples, inspection.front_end
    console.print(Text(samples.name, style="bold"))
    console.print(Text(inspection.summary))
    console.print(Text(
        f"{'real' if front.real else 'complex'} samples, {samples.rate_hz / 1e6:g} MHz, "
        f"{samples.centre_hz / 1e6:g} MHz at {samples.if_hz / 1e6:g} MHz; "
        f"band {front.band_hz[0] / 1e6:.2f} to {front.band_hz[1] / 1e6:.2f} MHz", style="dim",
    ))  # fmt: skip
    if inspection.satellites:
        satellites = _table("satellite", "C/N0 dB-Hz", "Doppler Hz", "code phase chips", "signals", numbers=4)
        for one in inspection.satellites:
            satellites.add_row(one.sat, f"{one.cn0_dbhz:.1f}", f"{one.doppler_hz:+.0f}", f"{one.code_phase_chips:.1f}",
                               str(one.peaks))  # fmt: skip
        console.print(satellites)
    for remark in inspection.remarks:
        console.print(Text(f"- {remark}"))


def _table(*headings: str, numbers: int = 0) -> Table:
    """A table without lines; its last `numbers` columns hold numbers."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for index, heading in enumerate(headings):
        number = index >= len(headings) - numbers
        table.add_column(heading, justify="right" if number else "left", no_wrap=number)
    return table


def _positions(verdict: Verdict) -> Table:
    table = _table("receiver", "position", "latitude °", "longitude °", "height m", "± E/N/U m", numbers=4)
    for receiver in verdict.receivers:
        kinds: tuple[tuple[str, Position | None], ...] = (
            ("trusted", receiver.trusted_fix),
            ("false", receiver.false_fix),
            ("unprotected", receiver.unprotected_fix),
        )
        for kind, fix in kinds:
            if fix is not None:
                sigmas = f"{fix.sigma_east_m:.1f}/{fix.sigma_north_m:.1f}/{fix.sigma_up_m:.1f}"
                table.add_row(Text(receiver.name), Text(kind, style=STYLES.get(kind, "")), f"{fix.lat_deg:.7f}",
                              f"{fix.lon_deg:.7f}", f"{fix.height_m:.1f}", sigmas)  # fmt: skip
    return table


def _signals(verdict: Verdict) -> Table:
    table = _table("receiver", "signals", "label", "satellites")
    for receiver in verdict.receivers:
        for label in ("authentic", "spoofed", "multipath", "unknown"):
            own = {(s.sat, s.band, s.code, s.copy) for s in verdict.signals
                   if s.receiver == receiver.name and s.label == label}  # fmt: skip
            if own:
                sats = sorted({signal[0] for signal in own})
                table.add_row(Text(receiver.name), str(len(own)), Text(label, style=STYLES.get(label, "")),
                              Text(" ".join(sats)))  # fmt: skip
    return table


# Progress


def _progress() -> Progress:
    """Bars for a person at a terminal, lines for a log."""
    console = Console(stderr=True)
    return _Bars(console) if console.is_terminal else _Lines()


class _Lines:
    """Progress as one line a stage."""

    def advance(self, to: float) -> None:
        pass

    def say(self, text: str) -> None:
        _complain(text)

    @contextmanager
    def stage(self, name: str, total: float) -> Iterator[Stage]:
        self.say(name)
        yield self


class _Bar:
    def __init__(self, bars: rich_progress.Progress, task: rich_progress.TaskID) -> None:
        self._bars, self._task = bars, task

    def advance(self, to: float) -> None:
        self._bars.update(self._task, completed=to)


class _Bars:
    """Progress as bars with the time left, gone when the work is done."""

    def __init__(self, console: Console) -> None:
        self._bars = rich_progress.Progress(
            rich_progress.TextColumn("{task.description}", markup=False),
            rich_progress.BarColumn(),
            rich_progress.TaskProgressColumn(),
            rich_progress.TimeRemainingColumn(),
            console=console,
            transient=True,
        )

    def say(self, text: str) -> None:
        self._bars.console.print(Text(f"skyproof: {text}"), soft_wrap=True)

    @contextmanager
    def stage(self, name: str, total: float) -> Iterator[Stage]:
        if not self._bars.tasks:
            self._bars.start()
        task = self._bars.add_task(name, total=total)
        try:
            yield _Bar(self._bars, task)
        finally:
            self._bars.remove_task(task)
            if not self._bars.tasks:
                self._bars.stop()
