"""What `skyproof inspect` shows on a terminal: one screen, pictures in blocks of text."""

import math
import shlex
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from skyproof import app
from skyproof.cli.screen import print_table, table, words

if TYPE_CHECKING:  # they take a second to load, which help and errors need not wait for
    from skyproof.app.inspect import Inspection
    from skyproof.app.inspect.guess import Guess, Proposal
    from skyproof.formats.raw import SampleLayout

__all__ = ["show_guess", "show_inspection"]

_BLOCKS = " ▁▂▃▄▅▆▇█"
_LABEL = 12  # columns before the values
_WIDEST = 120
_SPECTRUM_ROWS = 4
_FEW_LEVELS = 4
_NOTES = 6


def show_inspection(console: Console, inspection: "Inspection") -> None:
    """One recording on one screen."""
    width = min(console.width, _WIDEST)
    console.print(words(inspection.samples.path or inspection.samples.name, style="bold"), soft_wrap=True)
    console.print(words(inspection.summary))
    console.print()
    console.print(_facts(inspection))
    console.print()
    console.print(_tabulate_measured(inspection, width - _LABEL - 1))
    if inspection.satellites:
        console.print()
        print_table(console, _satellites(inspection, width))
    notes = [remark for remark in inspection.remarks if remark not in inspection.front_end.remarks]
    if notes:
        console.print()
    for remark in notes[:_NOTES]:
        console.print(Padding(words(f"· {remark}", style="yellow"), (0, 0, 0, 2)))
    if len(notes) > _NOTES:
        console.print(words(f"  · and {len(notes) - _NOTES} more: --json has all", style="yellow"))
    console.print()
    if inspection.sidecar is not None:
        console.print(words(f"Written: {inspection.sidecar}", style="green"), soft_wrap=True)
    elif inspection.proposals:
        _show_sidecar(console, inspection)
    console.print(words(inspection.advice, style="bold"))


def _show_sidecar(console: Console, inspection: "Inspection") -> None:
    """What states how to read the file, and how to have it written."""
    path = Path(inspection.samples.path or inspection.samples.name)
    console.print(words(f"`receive` and `protect` need this beside it, as {path.with_suffix('.toml').name}:"))
    for line in app.inspect.write_sidecar_lines(inspection):
        console.print(words(f"  {line}", style="dim"), soft_wrap=True)
    write = f"Not written; this writes it: skyproof inspect {shlex.quote(str(path))} --write {inspection.taken + 1}"
    console.print(words(write, style="green"), soft_wrap=True)


def show_guess(console: Console, found: "Guess") -> None:
    """What was tried on a file that nothing describes, and what is needed."""
    console.print(words(str(found.path), style="bold"), soft_wrap=True)
    console.print()
    print_table(console, _proposals(found.proposals))
    console.print()
    console.print(words(found.summary[0].upper() + found.summary[1:], style="bold"))


# --- facts


def _grid() -> Table:
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(min_width=_LABEL - 2, style="dim", no_wrap=True)
    return grid


def _facts(inspection: "Inspection") -> Table:
    """How it is read, and where that comes from."""
    samples, sources = inspection.samples, inspection.sources
    kind = "real" if inspection.front_end.real else "complex"
    numbers = samples.format if inspection.layout is None else describe_numbers(inspection.layout)
    start = "unknown" if samples.start_gpst is None else f"{str(samples.start_gpst)[:19].replace('T', ' ')} GPS time"
    rows = [
        ("format", f"{kind}, {numbers}", "encoding"),
        ("rate", f"{_engineering(samples.rate_hz)}Hz", "rate_hz"),
        ("carrier", f"{samples.centre_hz / 1e6:.12g} MHz at {_engineering(samples.if_hz)}Hz", "if_hz"),
        ("start", start, "start_gpst"),
        ("duration", f"{_long(samples.duration_s)} ({samples.n_samples:,} samples)".replace(",", " "), "duration"),
    ]
    grid = _grid()
    grid.add_column()
    grid.add_column(style="dim")
    for name, value, key in rows:
        grid.add_row(name, value, sources.get(key, ""))
    if inspection.proposals:
        grid.add_row("guessed", *_describe_guess(inspection))
    return grid


def _describe_guess(inspection: "Inspection") -> tuple[str, str]:
    taken = inspection.proposals[inspection.taken]
    others = [
        proposal
        for number, proposal in enumerate(inspection.proposals)
        if number != inspection.taken and proposal.satellites
    ]
    rival = max(others, key=lambda proposal: proposal.power, default=None)
    listed = f"{len(taken.satellites)} satellites; p-value 10^{taken.log10_chance:.0f} under noise alone"
    if rival is None:
        return listed, "no other reading shows any"
    less_db = 10.0 * math.log10(taken.power / rival.power) if taken.power and rival.power else math.inf
    return listed, f"next: {describe_numbers(rival.layout)}, {rival.layout.kind}, {less_db:.1f} dB less"


def describe_numbers(layout: "SampleLayout") -> str:
    """The numbers in words."""
    packing = layout.packing
    order = layout.byte_order if packing.orders_bytes else layout.bit_order if packing.orders_bits else ""
    words = [
        layout.encoding,
        f"{layout.bits} bit",
        order,
        f"after {layout.header_bytes} bytes" * bool(layout.header_bytes),
    ]
    words += ["Q first" * layout.swap_iq, "conjugate" * layout.conjugate]
    return ", ".join(filter(None, words))


def _proposals(proposals: "Sequence[Proposal]") -> Table:
    rows = table("", "kind", "numbers", "rate MHz", "satellites", "p-value, noise alone", numbers=3)
    for number, proposal in enumerate(proposals, 1):
        found = (
            f"{proposal.layout.rate_hz / 1e6:.10g}",
            str(len(proposal.satellites)),
            f"10^{proposal.log10_chance:.0f}",
        )
        rows.add_row(
            str(number),
            proposal.layout.kind,
            describe_numbers(proposal.layout),
            *(found if proposal.satellites else ("?", "0", "")),
        )
    return rows


# --- measurements


def _tabulate_measured(inspection: "Inspection", width: int) -> Table:
    front, survey = inspection.front_end, inspection.survey
    grid = _grid()
    grid.add_column(max_width=width)
    grid.add_row("levels", _levels(inspection, width))
    dc = [offset / rms if rms > 0.0 else 0.0 for offset, rms in zip(front.dc, front.rms, strict=True)]
    balance = (
        f"DC {dc[0]:+.3f} rms"
        if front.real
        else (
            f"DC {dc[0]:+.3f}, {dc[1]:+.3f} rms · "
            f"I/Q {front.gain_imbalance_db:+.2f} dB, {front.phase_imbalance_deg:+.1f}°"
        )
    )
    extremes = f" · {front.extreme_share:.1%} at the extremes" if front.levels.size > 2 else ""
    grid.add_row("", f"{balance}{extremes}")
    for label, line in _spectrum(inspection, width):
        grid.add_row(label, line)
    grid.add_row("gaps", _gaps(inspection))
    grid.add_row("oscillator", _oscillator(inspection))
    if math.isfinite(survey.clock_minus_lo_ppm):
        off = f"{survey.clock_minus_lo_ppm:+.3f} ± {survey.clock_minus_lo_sigma_ppm:.3f} ppm"
        grid.add_row("clock", f"{off} against the oscillator")
    return grid


def _levels(inspection: "Inspection", width: int) -> str:
    values, shares = inspection.front_end.levels, inspection.front_end.level_shares
    if values.size <= _FEW_LEVELS:
        return "   ".join(f"{value:+g} {share:.1%}" for value, share in zip(values, shares, strict=True))
    parts = _split(values.size, min(width - 24, 64, values.size))
    pooled = [sum(shares[part]) / (part.stop - part.start) for part in parts]
    bars = "".join(_BLOCKS[math.ceil(8 * share / max(pooled) - 1e-9)] for share in pooled)
    return f"{values[0]:.4g} {bars} {values[-1]:.4g}   rms {inspection.front_end.rms[0]:.3g}"


def _spectrum(inspection: "Inspection", width: int) -> Iterator[tuple[str, Text]]:
    """Rows of blocks, marks of lines above, frequencies below."""
    front = inspection.front_end
    columns = min(width - 8, 96)
    parts = _split(front.frequency_hz.size, columns)
    reference = max(front.floor)
    mean_db = [_db(sum(front.floor[part]) / (part.stop - part.start), reference) for part in parts]
    starts = [part.start for part in parts]
    step_hz = float(front.frequency_hz[1] - front.frequency_hz[0])
    marks = [(" ", "")] * columns
    for line in front.lines:  # a line stands out of its column, which else shows the floor
        at = min(max(round((line.frequency_hz - front.frequency_hz[0]) / step_hz), 0), front.frequency_hz.size - 1)
        column = bisect_right(starts, at) - 1
        peak_db = _db(max(front.density[max(at - 2, 0) : at + 3]), reference)
        mean_db[column] = max(mean_db[column], peak_db)
        if line.hurts or marks[column][0] == " ":
            marks[column] = ("▾", "bold red" if line.hurts else "yellow")
    high_db = max(mean_db) + 0.5
    span_db = min(max(high_db - min(mean_db) + 1.0, 6.0), 40.0)
    heights = [min(max((value - high_db) / span_db + 1.0, 0.0), 1.0) * 8 * _SPECTRUM_ROWS for value in mean_db]
    if front.lines:
        yield "", Text.assemble(*marks)
    for row in range(_SPECTRUM_ROWS - 1, -1, -1):
        text = words("".join(_BLOCKS[min(max(math.ceil(height - 8 * row), 0), 8)] for height in heights), style="cyan")
        if row in (0, _SPECTRUM_ROWS - 1):
            text.append(f" {high_db - span_db * (row == 0):+.0f} dB", style="dim")
        yield "spectrum" if row == _SPECTRUM_ROWS - 1 else "", text
    yield "", words(_axis(float(front.frequency_hz[0]), float(front.frequency_hz[-1]) + step_hz, columns), style="dim")
    yield "lines", words(_lines(inspection))


def _lines(inspection: "Inspection") -> str:
    lines = inspection.front_end.lines
    hurting = [line for line in lines if line.hurts]
    if not lines:
        return "none"
    at = ", ".join(f"{line.frequency_hz / 1e3:+.1f} kHz ({line.loss_db:.2f} dB)" for line in hurting[:1])
    left = len(lines) - len(hurting)
    words = [f"{len(hurting)} notched: {at}{' …' if len(hurting) > 1 else ''}"] if hurting else []
    words += [f"{left} harmless (less than 0.05 dB each)"] if left else []
    return "; ".join(words)


def _db(power: float, reference: float) -> float:
    return 10.0 * math.log10(max(power / reference, 1e-12))


def _split(n: int, parts: int) -> list[slice]:
    """0 to n in `parts` runs of all but the same length."""
    edges = [n * number // parts for number in range(parts + 1)]
    return [slice(first, last) for first, last in pairwise(edges)]


def _axis(low_hz: float, high_hz: float, columns: int) -> str:
    low, high = low_hz / 1e6, high_hz / 1e6
    marks = [f"{low:.2f}", f"{(low + high) / 2:.2f}", f"{high:.2f}"]
    first = max((columns - len(marks[1])) // 2 - len(marks[0]), 1)
    second = max(columns - len(marks[0]) - first - len(marks[1]) - len(marks[2]), 1)
    return f"{marks[0]}{' ' * first}{marks[1]}{' ' * second}{marks[2]} MHz"


def _gaps(inspection: "Inspection") -> str:
    gaps, known = inspection.survey.gaps, inspection.samples.gaps
    examined_s = min(inspection.samples.duration_s, 0.5)
    if not inspection.satellites:
        return "not known without signals"
    if not gaps and not known:
        return f"none in the first {_long(examined_s)}"
    at = [f"{gap.at_sample / inspection.samples.rate_hz * 1e3:.1f} ms" for gap in gaps] or [
        str(gap.at_sample) for gap in known
    ]
    return f"{len(at)}, at {', '.join(at[:4])}{' …' if len(at) > 4 else ''}"


def _oscillator(inspection: "Inspection") -> str:
    error = inspection.oscillator
    if not math.isfinite(error.doppler_hz):
        return "not known without signals"
    ppm = 1e6 / inspection.samples.centre_hz
    off_ppm = 0.0 - round(error.doppler_hz * ppm, 1)  # a slow oscillator makes signals appear high
    seen = f"signals appear {error.doppler_hz:+.0f} ± {error.sigma_hz:.0f} Hz off"
    return f"{off_ppm:+.1f} ± {error.sigma_hz * ppm:.1f} ppm ({seen})"


def _satellites(inspection: "Inspection", width: int) -> Table:
    rows = table("satellite", "", "C/N0 dB-Hz", "Doppler Hz", "code chips", "peaks", numbers=4)
    longest = max(8, min(width - 58, 40))
    for satellite in inspection.satellites:
        share = min(max((satellite.cn0_dbhz - 30.0) / 25.0, 0.02), 1.0)
        bar = words("━" * max(1, round(share * longest)), style="cyan")
        peaks = words(str(satellite.peaks), style="bold red" if satellite.peaks > 1 else "")
        rows.add_row(
            satellite.sat,
            bar,
            f"{satellite.cn0_dbhz:.1f}",
            f"{satellite.doppler_hz:+.0f}",
            f"{satellite.code_phase_chips:.1f}",
            peaks,
        )
    return rows


# --- numbers


def _engineering(value_hz: float) -> str:
    for unit, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value_hz) >= unit:
            return f"{value_hz / unit:.10g} {letter}"
    return f"{value_hz:g} "


def _long(duration_s: float) -> str:
    return f"{duration_s:.1f} s" if duration_s >= 1.0 else f"{duration_s * 1e3:.0f} ms"
