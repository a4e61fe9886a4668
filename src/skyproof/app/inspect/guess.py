"""Guess how to read a recording that nothing describes, and rank the ways by what a search finds.

The statistics of the bytes show their meaning. What repeats in them shows how many samples a code period takes and
where the carrier lies. A search for satellites shows whether all that is right. The file's name and a WAV header are
hints, which are tried and not believed.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from skyproof.app.inspect.policy import POLICY
from skyproof.errors import InputError, NotEnoughData
from skyproof.formats.byte_io import FileBytes, measure_size
from skyproof.formats.layout import Chunk, Kind, PackedSamples, Packing
from skyproof.formats.names import NameHints, read_hints
from skyproof.formats.raw import SampleLayout
from skyproof.formats.readings import list_likely_packings, measure_header
from skyproof.formats.signatures import WavHeader, identify_other, read_head, read_wav_header
from skyproof.gnss.constants import L1_HZ
from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS
from skyproof.receiver.acquisition import Peak, Searcher, SearchSettings
from skyproof.recording.interleaving import InterleavedSignal, turns
from skyproof.recording.repetition import LEAST_SAMPLES, Repetition, choose_length, find_repetition

__all__ = ["Guess", "Proposal", "guess"]


_STATISTICS_BYTES: Final = 1 << 20  # of the file's bytes
_FIRST_LENGTH, _SECOND_LENGTH, _LOOKED_AGAIN = 1 << 19, 1 << 21, 3  # samples, and in how many readings
_MOST_READINGS: Final = 6
_NICE_HZ: Final = 100e6  # a clock whose whole parts are usual rates
_PERIODS: Final = 10
_STEP_HZ: Final = 500.0
_MOST_WIDE: Final = 3  # searches over all carriers, which take as long as ten others

USUAL_RATES_HZ: Final = (
    2.046e6,
    2.048e6,
    2.4e6,
    2.5e6,
    2.56e6,
    2.6e6,
    2.8e6,
    3e6,
    3.2e6,
    4e6,
    4.092e6,
    5e6,
    5.456e6,
    5.714e6,
    6e6,
    6.25e6,
    6.5e6,
    8e6,
    8.1838e6,
    8.184e6,
    10e6,
    10.23e6,
    12e6,
    12.5e6,
    16e6,
    16.3676e6,
    16.368e6,
    16.369e6,
    20e6,
    20.46e6,
    24e6,
    25e6,
    26e6,
    30.72e6,
    32e6,
    38.192e6,
    40e6,
    40.96e6,
    50e6,
    53e6,
    56e6,
    58e6,
    61.44e6,
    99.375e6,
)
"""Sample rates of front ends and of public recordings."""
USUAL_IFS_HZ: Final = (
    0.0,
    0.42e6,
    1.364e6,
    1.405e6,
    2.046e6,
    2.556e6,
    3e6,
    4.092e6,
    4.123968e6,
    4.1304e6,
    4.1343e6,
    4.309e6,
    6e6,
    6.5e6,
    9.548e6,
    10e6,
    13.55e6,
    14.58e6,
    15e6,
    20e6,
)
_TRIED_BLIND: Final = (4e6, 2.048e6, 16.368e6, 2.6e6)
"""Rates for recordings in which nothing repeats clearly enough, the most usual first."""


@dataclass(frozen=True)
class Woven:
    """Interleaved channels.

    turn : number of samples, read as one channel, until the first channel comes again.
    """

    channels: int
    kind: Kind
    turn: int
    words: str


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """One way to read the file.

    sources : where each key of the layout comes from, in words.
    round_rate : whether the rate is one that people choose; another one is as exact as it could be measured.
    satellites : found by the search, by name, with C/N0. power : of all signals found, over the noise.
    log10_chance : decimal logarithm of the probability that noise alone makes so much in all that was tried; 0 if
        nothing was found.
    woven : the channels that the file seems to interleave, by which no reading as one channel is right; None for one
        channel, and in all but the best proposal. peaks : what the search found, Dopplers off `layout.if_hz`.
    """

    layout: SampleLayout
    sources: dict[str, str]
    round_rate: bool = True
    satellites: dict[str, float] = field(default_factory=dict)
    log10_chance: float = 0.0
    power: float = 0.0
    woven: "Woven | None" = None
    peaks: tuple[Peak, ...] = ()

    @property
    def interleaved(self) -> str:
        """Name the channels that the file seems to interleave; empty if there is one."""
        return "" if self.woven is None else self.woven.words

    @property
    def convincing(self) -> bool:
        return self.log10_chance < math.log10(POLICY.convincing_probability) and self.woven is None

    def document(self) -> dict[str, Any]:
        """Return the proposal as `--json` prints it."""
        layout = self.layout
        return {
            "layout": {
                key: getattr(layout, key) for key in type(layout).model_fields if key in layout.model_fields_set
            },
            "sources": self.sources,
            "satellites": [{"sat": sat, "cn0_dbhz": cn0} for sat, cn0 in self.satellites.items()],
            "log10_chance": self.log10_chance,
            "interleaved": self.interleaved or None,
            "convincing": self.convincing,
        }


def _describe_numbers(layout: SampleLayout) -> str:
    if layout.encoding == "sign":
        return "signs of one bit"
    words = {"int": "whole numbers", "float": "floats"}.get(layout.encoding, f"{layout.encoding} numbers")
    return f"{words} of {layout.bits} bits"


@dataclass(frozen=True, kw_only=True)
class Guess:
    """What a file may be. proposals : the best first. tried : how many readings, rates and carriers were searched."""

    path: Path
    proposals: tuple[Proposal, ...]
    tried: int
    start_utc: np.datetime64 | None

    @property
    def convincing(self) -> bool:
        return bool(self.proposals) and self.proposals[0].convincing

    @property
    def summary(self) -> str:
        """Describe what to do where nothing convincing was found."""
        best = self.proposals[0].layout
        if woven := self.proposals[0].woven:
            return (
                f"it seems to interleave {woven.words}, and reading it as one channel mixes them. State their number: "
                f"`skyproof inspect {self.path} --channels {woven.channels} "
                f"--rate-hz {best.rate_hz / woven.turn:.10g} --kind {woven.kind} --encoding {best.encoding} "
                f"--bits {best.bits}{_write_order_option(best)}`, with --if-hz if L1 is not at zero; then write it "
                "into the sidecar (channels, rate_hz, kind, encoding, bits)"
            )
        numbers = " or ".join(
            dict.fromkeys(
                f"{proposal.layout.kind} {_describe_numbers(proposal.layout)}" for proposal in self.proposals[:4]
            )
        )
        return (
            f"nothing states how to read it, and no {GPS_L1_CA.name} signal was found for certain in the {self.tried} "
            f"ways tried; by its bytes it holds {numbers}. Give what you know of the recorder, at least the rate: "
            f"`skyproof inspect {self.path} --rate-hz RATE --kind {best.kind} --encoding {best.encoding} "
            f"--bits {best.bits}`, with --if-hz if L1 is not at zero"
        )


def guess(path: str | Path) -> Guess:
    """Guess how to read a recording.

    Raises
    ------
    InputError : the file cannot be read, is empty, or is something else than a recording; the message says what.
    NotEnoughData : too few bytes to say anything.
    """
    path = Path(path)
    size = measure_size(path)
    if size == 0:
        raise InputError(f"{path} is empty; check the recorder or the copy")
    head = read_head(path)
    if known := identify_other(head):
        raise InputError(f"{path} looks like {known[0]}; {known[1]}")
    hints, wav = read_hints(path.name), read_wav_header(head)
    if head[:4] == b"RIFF" and wav is None:
        raise InputError(
            f"{path} is a RIFF file whose samples cannot be read; convert it to PCM WAV with 1 or 2 channels"
        )
    octets = FileBytes(path)
    looks = list(_iterate_looks(octets, hints, wav))
    if not looks:
        raise NotEnoughData(
            f"{path}: {size} bytes are too few to find out how to read them; give a longer recording, or its rate, "
            "kind, encoding and bits (`skyproof inspect --help`)"
        )
    looks.sort(key=lambda look: look.order)
    trials = _Trials()
    proposals = [trials.search(look) for look in [look for look in looks if look.repeats][:_MOST_READINGS]]
    if not trials.certain:
        clear = math.log10(POLICY.clear_probability)
        doubtful = [look for look in looks if look.repetition.log10_chance > clear][:_LOOKED_AGAIN]
        again = [replace(look, repetition=_measure_repetition(look.samples, _SECOND_LENGTH)) for look in doubtful]
        proposals += [trials.search(look) for look in again if look.repeats]
    if not any(proposal.satellites for proposal in proposals):
        proposals += [trials.search(look) for look in _try_usual_rates(looks)]
    ranked = sorted(proposals, key=lambda proposal: (-proposal.power, proposal.log10_chance))
    if ranked and ranked[0].convincing:
        ranked[0] = replace(ranked[0], woven=_find_interleaved(octets, ranked[0]))
    return Guess(
        path=path,
        proposals=tuple(_drop_repeats(ranked))[:_MOST_READINGS],
        tried=trials.count,
        start_utc=hints.start_utc,
    )


def _write_order_option(layout: SampleLayout) -> str:
    """Return the option that states the order of bits or bytes, if it is not the default."""
    if layout.packing.orders_bits and layout.bit_order != "msb-first":
        return f" --bit-order {layout.bit_order}"
    return f" --byte-order {layout.byte_order}" if layout.packing.orders_bytes and layout.byte_order == "big" else ""


def _find_interleaved(octets: FileBytes, proposal: Proposal) -> Woven | None:
    """Find the channels that a file interleaves; None if it has one."""
    layout = proposal.layout
    samples = _open_samples(octets, layout.header_bytes, layout.packing)
    planes = samples.read(0, min(samples.n_samples, math.ceil(_PERIODS * GPS_L1_CA.period_s * layout.rate_hz)))
    planes -= planes.mean(axis=1, keepdims=True)
    signals = [
        InterleavedSignal(
            sat=peak.sat, carrier_hz=layout.if_hz + peak.doppler_hz, delay_s=peak.delay_s, cn0_dbhz=peak.cn0_dbhz
        )
        for peak in proposal.peaks
    ]
    turn = turns(planes, layout.rate_hz, signals, real=layout.kind == "real")
    if turn.one_channel:
        return None
    if layout.kind == "complex":
        kind: Kind = "real" if turn.mirrored else "complex"
        channels = turn.samples * (2 if turn.mirrored else 1)
        return Woven(channels, kind, turn.samples, f"{channels} {kind} channels")
    if turn.samples == 2 or turn.samples % 2:
        return Woven(turn.samples, "real", turn.samples, f"{turn.samples} real channels")
    # real channels of zero intermediate frequency would hold nothing
    spacing_hz = layout.rate_hz / turn.samples
    at_zero = abs(math.remainder(layout.if_hz, spacing_hz)) < 0.5 * GPS_L1_CA.chip_rate_hz
    or_real = "" if at_zero else f" or {turn.samples} real ones"
    pairs = turn.samples // 2
    return Woven(pairs, "complex", turn.samples, f"{pairs} complex channels{or_real}")


def _drop_repeats(proposals: Sequence[Proposal]) -> Iterator[Proposal]:
    seen = set()
    for proposal in proposals:
        key = (proposal.layout.packing, proposal.layout.rate_hz if proposal.satellites else 0.0)
        if key not in seen:
            seen.add(key)
            yield proposal


# --- looks: readings of the bytes, and what repeats in them


@dataclass(frozen=True, eq=False, kw_only=True)
class _Look:
    """The bytes, read in one way. rank : of its packing among those that fit, 0 for the most probable."""

    octets: FileBytes
    packing: Packing
    header_bytes: int
    rank: int
    repetition: Repetition
    hints: NameHints
    wav: WavHeader | None
    rate_hz: float | None = None
    """Taken in place of the rate by repetition."""

    @property
    def samples(self) -> PackedSamples:
        return _open_samples(self.octets, self.header_bytes, self.packing)

    @property
    def stated_rates(self) -> dict[str, float]:
        """Return the stated sample rates, Hz, by what states them."""
        stated = {"the file's name": self.hints.rate_hz, "the WAV header": self.wav.rate_hz if self.wav else None}
        return {source: rate for source, rate in stated.items() if rate is not None}

    @property
    def repeats(self) -> bool:
        return self.repetition.log10_chance < math.log10(POLICY.repeats_probability)

    @property
    def order(self) -> tuple[bool, float]:
        """Return the key by which looks are sorted: contradicted or imaged ones last, else by repetition."""
        return self._contradicted or self.imaged, -self.repetition.strength

    @property
    def imaged(self) -> bool:
        """Test whether each signal shows twice, as real samples do that are read as complex ones."""
        return self.repeats and self.repetition.mirrored_share > POLICY.imaged_share

    @property
    def _contradicted(self) -> bool:
        return self.hints.kind is not None and self.hints.kind != self.packing.kind

    @property
    def real(self) -> bool:
        return self.packing.kind == "real"


def _iterate_looks(octets: FileBytes, hints: NameHints, wav: WavHeader | None) -> Iterator[_Look]:
    header = wav.header_bytes if wav else measure_header(octets[: 4 * _STATISTICS_BYTES])
    if octets.size - header < LEAST_SAMPLES // 4:
        return
    if wav:
        kinds = ("complex",) if wav.channels == 2 else ("real",)
        packings = [(Packing(kind=kind, encoding=wav.encoding, bits=wav.bits), 0) for kind in kinds]  # type: ignore[arg-type]
    else:
        middle = header + (octets.size - header) // 2 // 48 * 48  # where numbers of any length begin
        body = octets[middle : middle + _STATISTICS_BYTES] if octets.size > 2 * _STATISTICS_BYTES else octets[header:]
        packings = [
            (candidate.packing, candidate.header_bytes)
            for candidate in list_likely_packings(np.ascontiguousarray(body))
        ]
    for rank, (packing, skip) in enumerate(packings):
        # a header that was found by statistics may end on Q, which then seems to be I
        n_starts = packing.numbers if header and not wav and not packing.orders_bits else 1
        for begin in (header + skip + number * packing.bits // 8 for number in range(n_starts)):
            samples = _open_samples(octets, begin, packing)
            if samples.n_samples >= LEAST_SAMPLES:
                yield _Look(
                    octets=octets,
                    packing=packing,
                    header_bytes=begin,
                    rank=rank,
                    hints=hints,
                    wav=wav,
                    repetition=_measure_repetition(samples, _FIRST_LENGTH),
                )


def _open_samples(octets: FileBytes, begin: int, packing: Packing) -> PackedSamples:
    return PackedSamples(octets, packing, [Chunk(begin, max(octets.size - begin, 0) * 8 // packing.frame_bits)])


def _measure_repetition(samples: PackedSamples, most: int) -> Repetition:
    """Measure what repeats in at most so many samples."""
    planes = samples.read(0, choose_length(samples.n_samples, most))
    return find_repetition(planes[0] if samples.packing.kind == "real" else planes[0] + np.complex64(1j) * planes[1])


def _try_usual_rates(looks: Sequence[_Look]) -> Iterator[_Look]:
    """Yield the likeliest readings at stated or usual rates, where no search confirms a repetition."""
    likely = sorted(looks, key=lambda look: (look._contradicted, look.rank))[:2]
    for look in likely:
        for rate_hz in [rate for rate in look.stated_rates.values() if rate >= 1e6] or _TRIED_BLIND:
            yield replace(look, rate_hz=rate_hz)


# --- trials


class _Trials:
    """Searches for satellites, and how many of them were made."""

    def __init__(self) -> None:
        self.count = 0
        self.wide = 0
        self.certain = False

    def search(self, look: _Look) -> Proposal:
        """Search one reading at its rate, around the carriers that are plausible, then around the one measured."""
        rate_hz, rate_source = _choose_rate(look)
        measured_hz = look.repetition.carrier_cycles * rate_hz if look.rate_hz is None else None
        carriers = _list_carriers(look, rate_hz, measured_hz)
        found = self._search_carriers(look, rate_hz, carriers, POLICY.near_hz)
        few = len(found) < POLICY.fix_satellites
        if measured_hz is not None and few and not self.certain and self.wide < _MOST_WIDE:
            self.wide += 1
            found = max(found, self._search_carriers(look, rate_hz, [round(measured_hz, -3)], POLICY.wide_hz), key=len)
        if_hz, if_source = _choose_if(look, rate_hz, measured_hz, carriers, [hz for hz, _ in found.values()])
        cn0s = {sat: peak.cn0_dbhz for sat, (_, peak) in sorted(found.items())}
        log10_chance = sum(math.log10(max(peak.p_value, 1e-300)) for _, peak in found.values())
        self.certain = self.certain or len(found) >= POLICY.fix_satellites
        far = not look.real and abs(if_hz) > 0.25 * rate_hz
        unlikely = look.imaged * POLICY.image_costs_share + far * POLICY.far_carrier_costs_share
        return Proposal(
            layout=_build_layout(look, rate_hz, if_hz),
            sources=_name_sources(look, rate_source, if_source),
            round_rate=rate_hz in USUAL_RATES_HZ or rate_hz % 1e3 == 0.0 or rate_hz in look.stated_rates.values(),
            satellites=cn0s,
            log10_chance=min(0.0, log10_chance + math.log10(max(self.count, 1))) if found else 0.0,
            power=sum(10.0 ** (float(cn0) / 10.0) for cn0 in cn0s.values()) * (1.0 - unlikely),
            peaks=tuple(replace(peak, doppler_hz=hz - if_hz) for _, (hz, peak) in sorted(found.items())),
        )

    def _search_carriers(
        self, look: _Look, rate_hz: float, carriers: Sequence[float], reach_hz: float
    ) -> dict[str, tuple[float, Peak]]:
        """Search the strongest signal of each satellite, and its carrier, in the band of the samples."""
        samples = look.samples
        n_periods = math.floor(samples.n_samples / rate_hz / GPS_L1_CA.period_s + 1e-6)
        inside = [hz for hz in carriers if _holds_main_lobe(look, rate_hz, hz)]
        if n_periods < 2 or not inside:
            return {}
        self.count += 1
        centre_hz = inside[0]
        steps = np.arange(-math.ceil(reach_hz / _STEP_HZ), math.ceil(reach_hz / _STEP_HZ) + 1)
        grids = [steps + round((hz - centre_hz) / _STEP_HZ) for hz in inside]
        dopplers_hz = np.unique(np.concatenate(grids)).astype(np.float64) * _STEP_HZ
        settings = SearchSettings(
            false_alarm_probability=POLICY.alarm_probability, n_sums=min(_PERIODS, n_periods), max_peaks=1
        )
        searcher = Searcher(GPS_L1_CA, rate_hz, settings)
        planes = samples.read(0, searcher.n_samples)
        planes -= planes.mean(axis=1, keepdims=True)
        peaks = searcher.search(planes, centre_hz, {sat: dopplers_hz for sat in GPS_SATS}, {})
        strongest: dict[str, tuple[float, Peak]] = {}
        for peak in sorted(peaks, key=lambda peak: peak.cn0_dbhz):
            strongest[peak.sat] = (centre_hz + peak.doppler_hz, peak)
        return strongest


def _holds_main_lobe(look: _Look, rate_hz: float, carrier_hz: float) -> bool:
    """Test whether the samples' band has half the main lobe on either side of the carrier."""
    room_hz = 0.5 * GPS_L1_CA.chip_rate_hz
    if look.real:
        return room_hz < abs(carrier_hz) < 0.5 * rate_hz - room_hz
    return abs(carrier_hz) < 0.5 * rate_hz - room_hz


def _choose_rate(look: _Look) -> tuple[float, str]:
    """Choose the rate, stated or usual, that what repeats agrees with, and name its source."""
    stated = look.stated_rates
    if look.rate_hz is not None:
        source = next((source for source, rate in stated.items() if rate == look.rate_hz), "guessed: a usual rate")
        return look.rate_hz, source
    measured_hz = look.repetition.period_samples / GPS_L1_CA.period_s
    within_hz = max(4.0 * look.repetition.period_sigma / GPS_L1_CA.period_s, 1e-6 * measured_hz)
    for source, rate_hz in stated.items():
        if abs(rate_hz - measured_hz) < within_hz:
            return rate_hz, f"{source}; code period agrees"
    usual = [*USUAL_RATES_HZ, round(measured_hz, -3), round(_NICE_HZ / round(_NICE_HZ / measured_hz))]
    nearest_hz = min(usual, key=lambda rate_hz: abs(rate_hz - measured_hz))
    if abs(nearest_hz - measured_hz) < within_hz:
        return nearest_hz, "measured: code period"
    return round(measured_hz, -1), "measured: code period"


def _list_carriers(look: _Look, rate_hz: float, measured_hz: float | None) -> list[float]:
    """List the carriers to search: stated or usual ones near the one measured."""
    stated = [] if look.hints.if_hz is None else [_fold_frequency(look, look.hints.if_hz, rate_hz)]
    likely = list(dict.fromkeys([*stated, *_list_usual_ifs(look, rate_hz)]))
    if measured_hz is None:
        return likely[: len(stated) + 2] if look.real else likely[: max(1, len(stated))]
    apart: list[float] = []
    for hz in likely:
        if abs(hz - measured_hz) < POLICY.carrier_off_hz and all(abs(hz - other) > POLICY.near_hz for other in apart):
            apart.append(hz)
    return sorted(apart, key=lambda hz: abs(hz - measured_hz))[:2] or [round(measured_hz, -4)]


def _list_usual_ifs(look: _Look, rate_hz: float) -> list[float]:
    """List usual intermediate frequencies, the likeliest first; of real samples as folded by sampling."""
    if look.real:
        return [0.25 * rate_hz, *(_fold_frequency(look, hz, rate_hz) for hz in USUAL_IFS_HZ)]
    return [sign * hz for hz in USUAL_IFS_HZ if hz < 0.5 * rate_hz for sign in (1.0, -1.0)]


def _fold_frequency(look: _Look, hz: float, rate_hz: float) -> float:
    folded = math.remainder(hz, rate_hz)
    return abs(folded) if look.real else folded


def _choose_if(
    look: _Look, rate_hz: float, measured_hz: float | None, carriers: Sequence[float], found_hz: Sequence[float]
) -> tuple[float, str]:
    """Choose the intermediate frequency: stated, usual or round, near the middle of the carriers.

    An error of a kilohertz or two is the oscillator's. A frequency that no engineer would choose counts like several.
    """
    if not found_hz:
        if measured_hz is None or not look.repeats:
            return (carriers[0] if carriers else 0.0), "guessed: a usual one"
        return carriers[0], "measured: around what repeats"
    middle_hz = 0.5 * (min(found_hz) + max(found_hz))
    stated_hz = look.hints.if_hz
    choices = [(0.5 if hz else 0.0, hz) for hz in _list_usual_ifs(look, rate_hz)]
    choices += [(4.0, round(middle_hz, -5)), (8.0, round(middle_hz, -4)), (10.0, round(middle_hz, -3))]
    if stated_hz is not None:
        choices.append((-1.0, _fold_frequency(look, stated_hz, rate_hz)))
    _, if_hz = min(choices, key=lambda choice: choice[0] + abs(choice[1] - middle_hz) / 2e3)
    if stated_hz is not None and if_hz == _fold_frequency(look, stated_hz, rate_hz):
        return if_hz, "the file's name; the satellites agree"
    return if_hz + 0.0, "measured: amid the satellites"


def _build_layout(look: _Look, rate_hz: float, if_hz: float) -> SampleLayout:
    packing = look.packing
    keys: dict[str, Any] = {
        "rate_hz": rate_hz,
        "centre_hz": look.hints.centre_hz or L1_HZ,
        "if_hz": if_hz,
        "kind": packing.kind,
        "encoding": packing.encoding,
        "bits": packing.bits,
    }
    if packing.orders_bits:
        keys["bit_order"] = packing.bit_order
    if packing.orders_bytes:
        keys["byte_order"] = packing.byte_order
    if look.header_bytes:
        keys["header_bytes"] = look.header_bytes
    return SampleLayout.model_validate(keys)


def _name_sources(look: _Look, rate_source: str, if_source: str) -> dict[str, str]:
    numbers = "the WAV header" if look.wav else "measured: bytes' statistics"
    sources = {
        "rate_hz": rate_source,
        "centre_hz": "the file's name" if look.hints.centre_hz else "guessed: GPS L1",
        "if_hz": if_source,
        "kind": "the WAV header" if look.wav else "measured: what a search finds",
        "encoding": numbers,
        "bits": numbers,
    }
    if look.packing.orders_bits:
        sources["bit_order"] = "measured: what a search finds"
    if look.packing.orders_bytes:
        sources["byte_order"] = numbers
    if look.header_bytes:
        sources["header_bytes"] = "the WAV header" if look.wav else "measured: where the bytes change"
    return sources
