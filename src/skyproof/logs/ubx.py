"""UBX, the protocol of u-blox receivers, from M4 to X20: measurements, broadcast frames, fixes, levels, states.

u-blox interface descriptions: M8 (UBX-13003221), F9 HPG 1.32 (UBX-22008968), M10 SPG 5.10 (UBX-21035062), X20 HPG 2.00
(UBXDOC-963802114-12901); LEA-6 (GPS.G6-SW-10018) for RXM-RAW and RXM-SFRB.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers, Octets, Reals
from skyproof.gnss.signals import rinex_signal
from skyproof.gnss.time import GPS_EPOCH_NS
from skyproof.logs.content import FRAME_BITS, BroadcastFrames, LogPiece, MessageKind, ReceiverStates, report_untimed
from skyproof.logs.frames import Frames, Protocol, read_blocks, read_field
from skyproof.logs.locks import NEVER, CarrierLocks
from skyproof.logs.rows import SignalRows, observations_from_rows
from skyproof.records import FrontEndLevels, ReceiverFixes, SignalId

__all__ = ["MESSAGES", "RAWX_CELL", "SIGNAL_NUMBERS", "UbxReader"]

MESSAGES: Final = {
    0x0103: "NAV-STATUS",
    0x0107: "NAV-PVT",
    0x0122: "NAV-CLOCK",
    0x0135: "NAV-SAT",
    0x0210: "RXM-RAW",
    0x0211: "RXM-SFRB",
    0x0213: "RXM-SFRBX",
    0x0215: "RXM-RAWX",
    0x0A09: "MON-HW",
    0x0A38: "MON-RF",
    0x0D01: "TIM-TP",
    0x2709: "SEC-SIG",
}
"""Names of the messages that are looked for, by class and number."""

_SYSTEMS: Final = "GSEC-JRI"  # by gnssId; 4 is IMES, which no satellite sends
_ATTRIBUTES: Final = {
    "G": {0: "1C", 3: "2L", 4: "2S", 6: "5I", 7: "5Q"},
    "S": {0: "1C"},
    "E": {0: "1C", 1: "1B", 3: "5I", 4: "5Q", 5: "7I", 6: "7Q", 8: "6B", 9: "6C", 10: "6A"},
    "C": {0: "2I", 1: "2I", 2: "7I", 3: "7I", 4: "6I", 10: "6I", 5: "1P", 6: "1D", 7: "5P", 8: "5D"},
    "J": {0: "1C", 1: "1Z", 4: "2S", 5: "2L", 8: "5I", 9: "5Q", 12: "1E"},
    "R": {0: "1C", 2: "2C"},
    "I": {0: "5A"},
}
"""What RINEX calls each sigId: F9 HPG 1.32, 1.5.4; M10 SPG 5.10, 1.5.4."""
SIGNAL_NUMBERS: Final = {
    (letter, attribute): (_SYSTEMS.index(letter), number)
    for letter, attributes in _ATTRIBUTES.items()
    for number, attribute in sorted(attributes.items(), reverse=True)
}
"""gnssId and sigId of each system's signal, by what RINEX calls it."""
_FRAME_KINDS: Final[dict[tuple[str, int], MessageKind]] = {
    ("G", 0): "LNAV",
    ("J", 0): "LNAV",
    ("G", 3): "CNAV",
    ("G", 4): "CNAV",
    ("G", 6): "CNAV",
    ("J", 4): "CNAV",
    ("J", 5): "CNAV",
    ("J", 8): "CNAV",
    ("E", 1): "INAV",
    ("E", 5): "INAV",
    ("E", 3): "FNAV",
    ("C", 0): "D1",
    ("C", 1): "D2",
    ("C", 2): "D1",
    ("C", 3): "D2",
    ("C", 4): "D1",
    ("C", 10): "D2",
    ("C", 6): "BCNAV1",
    ("C", 8): "BCNAV2",
    ("R", 0): "GLONASS",
    ("R", 2): "GLONASS",
}
_FIRST_WEEK, _LAST_WEEK = 1042, 11_500  # 1999-12-26 to the year 2200
"""A receiver that does not know the time yet counts from a week of its own, 0 for one. None logged before 2000."""
_NS: Final = 1_000_000_000
_WEEK_NS: Final = 604_800 * _NS
_JAMMING: Final = ("unknown", "none", "warning", "critical")
_CHAINS: Final = ("L1", "L2L5", "3")  # of the blocks of MON-RF; MON-HW has the first
_SPOOFING: Final = ("unknown", "none", "indicated", "several indications", "affirmed")

_CODE_SIGMA_M: Final = 0.01 * 2.0 ** np.arange(16)
_CARRIER_SIGMA_CYC: Final = np.array([np.nan, *(0.004 * np.arange(1, 15)), np.nan])
_DOPPLER_SIGMA_HZ: Final = 0.002 * 2.0 ** np.arange(16)
"""By the steps that RXM-RAWX states; of the carrier 0 and 15 state nothing."""

RAWX_CELL: Final = np.dtype(
    [
        ("code_m", "<f8"),
        ("carrier_cyc", "<f8"),
        ("doppler_hz", "<f4"),
        ("gnss", "u1"),
        ("sv", "u1"),
        ("signal", "u1"),
        ("slot", "u1"),
        ("lock_ms", "<u2"),
        ("cn0_dbhz", "u1"),
        ("code_sigma", "u1"),
        ("carrier_sigma", "u1"),
        ("doppler_sigma", "u1"),
        ("tracking", "u1"),
        ("reserved", "u1"),
    ]
)
_RAW: Final = np.dtype(
    [
        ("carrier_cyc", "<f8"),
        ("code_m", "<f8"),
        ("doppler_hz", "<f4"),
        ("sv", "u1"),
        ("quality", "i1"),
        ("cn0_dbhz", "i1"),
        ("lost", "u1"),
    ]
)


Payloads = Callable[[int, int], tuple[Integers, Integers]]
"""First octet and size of the payloads of a message that have so many octets at least."""


_ONE_EPOCH_NS: Final = 20_000_000  # messages of one epoch differ by what the clock is off; 25 epochs a second are most
_LONGEST_LOCK_MS: Final = 64_000  # lock times count to 64.5 s


class UbxReader:
    """Read UBX frames, stretch by stretch (`LogReader`).

    Epochs before the receiver knows the time are left out and counted. Messages without a time of their own take that
    of the last epoch before them.
    """

    def __init__(self, source: str) -> None:
        """Begin a log; `source` names the receiver."""
        self._source = source
        self._signals: dict[int, int] = {}  # number of each signal, by what the log calls it
        self._names: list[SignalId] = []
        self._slots: dict[str, int] = {}
        self._last_ns: int | None = None
        self._locks = CarrierLocks()

    def read(self, frames: Frames) -> LogPiece:
        """Read the frames of a stretch."""
        begin, length = frames.select(Protocol.UBX)
        octets = frames.octets
        kind = octets[begin + 2].astype(np.int64) << 8 | octets[begin + 3]
        chosen = {number: np.flatnonzero(kind == number) for number in np.unique(kind).tolist()}
        messages = Counter({MESSAGES.get(number, f"0x{number:04X}"): which.size for number, which in chosen.items()})
        at = {number: (begin[which] + 6, length[which] - 8) for number, which in chosen.items()}

        def payloads(number: int, least: int) -> tuple[Integers, Integers]:
            """Return first octet and size of the payloads of a message that have `least` octets."""
            first, size = at.get(number, (np.empty(0, np.int64),) * 2)
            return first[size >= least], size[size >= least]

        rows, untimed, timed = self._measurements(octets, payloads)
        pvt, _ = payloads(0x0107, 84)
        fixes, fix_times = self._fixes(octets, pvt, payloads(0x0122, 20)[0])
        clock = _Timeline.of([*timed, (pvt, fix_times)], self._last_ns)
        piece = LogPiece(
            observations=None if rows is None else observations_from_rows(rows, self._source),
            fixes=fixes,
            levels=_levels(octets, payloads, clock),
            states=_states(octets, payloads, clock),
            frames=_broadcast(octets, payloads, clock),
            messages=dict(messages),
            remarks=(report_untimed(untimed),) if untimed else (),
        )
        self._last_ns = clock.last_ns
        return piece

    # ------------------------------------------------------------------ measurements

    def _measurements(
        self, octets: Octets, payloads: Payloads
    ) -> tuple[SignalRows | None, int, list[tuple[Integers, Integers]]]:
        """Return the rows of RXM-RAWX and RXM-RAW, how many epochs have no time, and when frames stand (octet, ns)."""
        first, size = payloads(0x0215, 16)
        tow_s = read_field(octets, first, 0, "<f8")
        week = read_field(octets, first, 8, "<u2").astype(np.int64)
        counts = np.minimum(octets[first + 11].astype(np.int64), (size - 16) // RAWX_CELL.itemsize)
        old, old_size = payloads(0x0210, 8)
        old_tow_s = read_field(octets, old, 0, "<i4") / 1e3
        old_week = read_field(octets, old, 4, "<i2").astype(np.int64)
        old_counts = np.minimum(octets[old + 6].astype(np.int64), (old_size - 8) // _RAW.itemsize)
        new_ns, known = _instants_ns(week, tow_s)
        old_ns, old_known = _instants_ns(old_week, old_tow_s)
        untimed = int((~known & (counts > 0)).sum() + (~old_known & (old_counts > 0)).sum())
        timed = [(first[known], new_ns[known]), (old[old_known], old_ns[old_known])]
        cells = _blocks(octets, first[known], counts[known], 16, RAWX_CELL)
        epochs = np.repeat(new_ns[known], counts[known])
        if old.size:
            older = _blocks(octets, old[old_known], old_counts[old_known], 8, _RAW)
            cells = np.concatenate([cells, _as_rawx(older)])
            epochs = np.concatenate([epochs, np.repeat(old_ns[old_known], old_counts[old_known])])
        if not cells.size:
            return None, untimed, timed
        return self._rows(cells, epochs), untimed, timed

    def _rows(self, cells: NDArray[Any], epochs: Integers) -> SignalRows:
        known = cells["gnss"] < len(_SYSTEMS)
        if not known.all():
            cells, epochs = cells[known], epochs[known]
        key = cells["gnss"].astype(np.int64) << 16 | cells["sv"].astype(np.int64) << 8 | cells["signal"]
        counts = np.bincount(key)
        distinct, numbers = np.flatnonzero(counts), np.full(counts.size, -1, np.int64)
        numbers[distinct] = [self._number_of(value) for value in distinct.tolist()]
        signal = numbers[key]
        glonass = cells[cells["gnss"] == _SYSTEMS.index("R")]
        for sv in np.flatnonzero(np.bincount(glonass["sv"], minlength=1)).tolist():
            slot = int(glonass["slot"][glonass["sv"] == sv][-1])
            if slot <= 13:
                self._slots[f"R{sv:02d}"] = slot - 7
        kept = signal >= 0
        if not kept.all():
            cells, epochs, signal = cells[kept], epochs[kept], signal[kept]
        code, carrier, half = (cells["tracking"] & bit > 0 for bit in (1, 2, 4))
        carrier_cyc = np.where(carrier, cells["carrier_cyc"], np.nan)
        half_open = carrier & ~half
        slipped = self._locks.slips(
            epochs,
            signal,
            cells["lock_ms"].astype(np.int64),
            carrier,
            half_open,
            longest_ms=np.full(epochs.size, _LONGEST_LOCK_MS),
            step_ms=1,
        )
        with np.errstate(invalid="ignore"):  # a damaged number may be a signalling NaN
            doppler_hz = cells["doppler_hz"].astype(np.float64)
        steps = {name: cells[name] & 0x0F for name in ("code_sigma", "carrier_sigma", "doppler_sigma")}
        # Receivers that do not state the deviations write zero for all of them, which as a number is less than noise.
        stated = (steps["code_sigma"] > 0) | (steps["carrier_sigma"] > 0) | (steps["doppler_sigma"] > 0)
        return SignalRows(
            signals=tuple(self._names),
            frequency_numbers=self._slots,
            instant_ns=epochs,
            signal=signal,
            pseudorange_m=np.where(code, cells["code_m"], np.nan),
            carrier_cyc=carrier_cyc,
            doppler_hz=np.where(code | carrier, doppler_hz, np.nan),
            cn0_dbhz=np.where(cells["cn0_dbhz"] > 0, cells["cn0_dbhz"], np.nan).astype(np.float64),
            pseudorange_sigma_m=np.where(stated, _CODE_SIGMA_M[steps["code_sigma"]], np.nan),
            carrier_sigma_cyc=_CARRIER_SIGMA_CYC[steps["carrier_sigma"]],
            doppler_sigma_hz=np.where(stated, _DOPPLER_SIGMA_HZ[steps["doppler_sigma"]], np.nan),
            slipped=slipped,
            half_cycle_open=half_open,
        )

    def _number_of(self, key: int) -> int:
        """Return the number of a signal, made when it is seen first; -1 for what no satellite sends."""
        if key not in self._signals:
            signal = _signal_of(key >> 16, key >> 8 & 0xFF, key & 0xFF)
            self._signals[key] = -1 if signal is None else len(self._names)
            if signal is not None:
                self._names.append(signal)
        return self._signals[key]

    # ------------------------------------------------------------------ fixes

    def _fixes(self, octets: Octets, pvt: Integers, clocks: Integers) -> tuple[ReceiverFixes | None, Integers]:
        """Return the fixes of NAV-PVT, and the instant of each frame (ns; the least number where it has none)."""
        unknown = NEVER
        if not pvt.size:
            return None, np.empty(0, np.int64)
        year, month = read_field(octets, pvt, 4, "<u2").astype(np.int64), octets[pvt + 6].astype(np.int64)
        day = octets[pvt + 7].astype(np.int64)
        valid = octets[pvt + 11]
        tow_ms = read_field(octets, pvt, 0, "<u4").astype(np.int64)
        dated = (valid & 1 > 0) & (year >= 2000) & (year < 2200) & (month >= 1) & (month <= 12) & (day >= 1)
        dated &= tow_ms < 604_800_000
        days = np.where(dated, (year - 1970) * 12 + month - 1, 0).astype("datetime64[M]").astype("datetime64[D]")
        utc_ns = (days + (np.where(dated, day, 1) - 1)).astype("datetime64[ns]").astype(np.int64)
        # The date is of UTC and the time of week of GPS: the week is the one that puts it nearest to the date's noon.
        week = np.rint((utc_ns + 43_200 * _NS - GPS_EPOCH_NS - tow_ms * 1_000_000) / _WEEK_NS).astype(np.int64)
        instant_ns = np.where(dated, GPS_EPOCH_NS + week * _WEEK_NS + tow_ms * 1_000_000, unknown)
        fix_type, flags = octets[pvt + 20], octets[pvt + 21]
        good = dated & (flags & 1 > 0) & ((fix_type == 2) | (fix_type == 3) | (fix_type == 4))
        rows = pvt[good]
        if not rows.size:
            return None, instant_ns
        lon_rad, lat_rad = (np.radians(read_field(octets, rows, at, "<i4") * 1e-7) for at in (24, 28))
        north_m_s, east_m_s, down_m_s = (read_field(octets, rows, at, "<i4") * 1e-3 for at in (48, 52, 56))
        bias_s, drift = _clock_of(octets, rows, clocks)
        fixes = ReceiverFixes.from_geodetic(
            instant_ns[good].astype("datetime64[ns]"),
            lat_rad,
            lon_rad,
            read_field(octets, rows, 32, "<i4") * 1e-3,
            velocity_enu_m_s=np.stack([east_m_s, north_m_s, -down_m_s], axis=-1),
            horizontal_sigma_m=read_field(octets, rows, 40, "<u4") * 1e-3,
            vertical_sigma_m=read_field(octets, rows, 44, "<u4") * 1e-3,
            clock_bias_s=bias_s,
            clock_drift=drift,
            satellites=octets[rows + 23].astype(np.int64),
        )
        return fixes, instant_ns


@dataclass(frozen=True, eq=False, kw_only=True)
class _Timeline:
    """When the frames of a stretch came: by the last timed frame before each, or the first after it.

    octet, instant_ns : (n,) of the timed frames, in order. last_ns : the latest instant known; None if none is.
    """

    octet: Integers
    instant_ns: Integers
    before_ns: int | None
    last_ns: int | None

    @classmethod
    def of(cls, timed: list[tuple[Integers, Integers]], before_ns: int | None) -> "_Timeline":
        octet = np.concatenate([first for first, _ in timed])
        instant_ns = np.concatenate([instants for _, instants in timed])
        known = instant_ns > NEVER
        octet, instant_ns = octet[known], instant_ns[known]
        order = np.argsort(octet)
        octet, instant_ns = octet[order], instant_ns[order]
        last_ns = int(instant_ns[-1]) if instant_ns.size else before_ns
        return cls(octet=octet, instant_ns=instant_ns, before_ns=before_ns, last_ns=last_ns)

    def at(self, octet: Integers) -> tuple[Integers, Booleans]:
        """Return the instants of the frames that begin at these octets, ns, and which of them are known."""
        known = np.ones(octet.size, np.bool_)
        if not self.instant_ns.size:
            known[:] = self.before_ns is not None
            return np.full(octet.size, self.before_ns or 0, np.int64), known
        place = np.searchsorted(self.octet, octet, side="right") - 1
        first_ns = self.instant_ns[0] if self.before_ns is None else self.before_ns
        return np.where(place >= 0, self.instant_ns[np.maximum(place, 0)], first_ns), known

    def since_ns(self, octet: Integers) -> Integers:
        """Return the instants of the epochs before those of `at`; the least number where there is none."""
        before_ns = NEVER if self.before_ns is None else self.before_ns
        labels_ns = np.concatenate([[NEVER, before_ns], self.instant_ns])
        begins = np.abs(np.diff(labels_ns)) > _ONE_EPOCH_NS
        begin = np.maximum.accumulate(np.where(begins, np.arange(1, labels_ns.size), 1))
        place = np.searchsorted(self.octet, octet, side="right")
        return np.asarray(labels_ns[begin[place] - 1])

    def next_ns(self, octet: Integers) -> Integers:
        """Return the instants of the timed frames after these octets, ns; the least number where there is none."""
        place = np.searchsorted(self.octet, octet, side="right")
        return np.append(self.instant_ns, NEVER)[place]


# ---------------------------------------------------------------------- broadcast frames


def _broadcast(octets: Octets, payloads: Payloads, clock: _Timeline) -> tuple[BroadcastFrames, ...]:
    """Return the frames of RXM-SFRBX and RXM-SFRB, a record a kind of message."""
    found: dict[MessageKind, list[tuple[Integers, SignalId, Octets]]] = {}
    first, size = payloads(0x0213, 8)
    whole = size >= 8 + 4 * octets[first + 4].astype(np.int64)
    first = first[whole]
    key = octets[first].astype(np.int64) << 16 | octets[first + 2].astype(np.int64) << 8 | octets[first + 4]
    for value in np.unique(key).tolist():
        system, number, n_words = value >> 16, value >> 8 & 0xFF, value & 0xFF
        rows = first[key == value]
        kind = _FRAME_KINDS.get((_SYSTEMS[system] if system < len(_SYSTEMS) else "", number))
        if kind is None or n_words != _WORDS[kind]:
            continue
        for sv in np.unique(octets[rows + 1]).tolist():
            signal = _signal_of(system, sv, number)
            if signal is not None:
                of_sat = rows[octets[rows + 1] == sv]
                bits = _frame_bits(kind, _word_bits(octets, of_sat + 8, n_words))
                found.setdefault(kind, []).append((of_sat, signal, bits))
    old, _ = payloads(0x0211, 42)
    for sv in range(1, 33):  # SBAS has numbers of 120 and more
        of_sat = old[octets[old + 1] == sv]
        if of_sat.size:
            bits = _word_bits(octets, of_sat + 2, 10)[:, :, 8:].reshape(of_sat.size, 240)
            found.setdefault("LNAV", []).append((of_sat, SignalId(f"G{sv:02d}"), bits))
    return tuple(frames for kind, parts in sorted(found.items()) for frames in _frames_of(kind, parts, clock))


_WORDS: Final[dict[MessageKind, int]] = {
    "LNAV": 10,
    "CNAV": 10,
    "INAV": 8,
    "FNAV": 8,
    "D1": 10,
    "D2": 10,
    "BCNAV1": 19,
    "BCNAV2": 9,
    "GLONASS": 4,
}


def _word_bits(octets: Octets, first: Integers, n_words: int) -> Octets:
    """Return the bits (n, n_words, 32) of words that begin at these octets, the highest bit first."""
    words = octets[first[:, None] + np.arange(4 * n_words)].reshape(-1, n_words, 4)[:, :, ::-1]
    return np.unpackbits(words, axis=2)


def _frame_bits(kind: MessageKind, bits: Octets) -> Octets:
    """Return the bits (n, FRAME_BITS) of a kind of frame from those of its words (n, n_words, 32)."""
    n = len(bits)
    if kind == "LNAV":  # 24 bits of data and 6 of parity in the low 30; the data stand as before encoding
        return bits[:, :, 2:26].reshape(n, 240)
    if kind in ("D1", "D2"):
        return bits[:, :, 2:].reshape(n, 300)
    if kind == "INAV":
        return bits.reshape(n, 2, 128)[:, :, :120].reshape(n, 240)
    return bits.reshape(n, -1)[:, : FRAME_BITS[kind]]


def _frames_of(
    kind: MessageKind, parts: list[tuple[Integers, SignalId, Octets]], clock: _Timeline
) -> Iterator[BroadcastFrames]:
    """Give the parts as one record, in order of the stream, without those whose time is not known."""
    octet = np.concatenate([first for first, _, _ in parts])
    names = [
        np.concatenate([np.full(first.size, getattr(signal, name)) for first, signal, _ in parts])
        for name in ("sat", "band", "code")
    ]
    bits = np.concatenate([part for _, _, part in parts])
    instant_ns, known = clock.at(octet)
    order = np.argsort(octet, kind="stable")
    order = order[known[order]]
    if not order.size:
        return
    yield BroadcastFrames(
        kind=kind,
        gpst=instant_ns[order].astype("datetime64[ns]"),
        until_gpst=clock.next_ns(octet[order]).astype("datetime64[ns]"),
        since_gpst=clock.since_ns(octet[order]).astype("datetime64[ns]"),
        sat=names[0][order],
        band=names[1][order],
        code=names[2][order],
        bits=np.packbits(bits[order], axis=1),
    )


# ---------------------------------------------------------------------- levels and states


def _levels(octets: Octets, payloads: Payloads, clock: _Timeline) -> FrontEndLevels | None:
    """Return what MON-HW and MON-RF measured in the front end."""
    hardware, _ = payloads(0x0A09, 60)
    blocks, number = _radio_blocks(octets, payloads)
    octet = np.concatenate([hardware, blocks])
    noise_at = np.concatenate([hardware + 16, blocks + 12])
    gain_at = np.concatenate([hardware + 18, blocks + 14])
    jamming_at = np.concatenate([hardware + 45, blocks + 16])
    band = np.concatenate([np.zeros(hardware.size, np.int64), number])
    instant_ns, known = clock.at(octet)
    order = np.argsort(octet, kind="stable")
    order = order[known[order]]
    if not order.size:
        return None
    noise = read_field(octets, noise_at[order], 0, "<u2").astype(np.float64)
    return FrontEndLevels(
        gpst=instant_ns[order].astype("datetime64[ns]"),
        band=np.array(_CHAINS)[np.minimum(band[order], len(_CHAINS) - 1)],
        agc_db=np.full(order.size, np.nan),
        agc_share=read_field(octets, gain_at[order], 0, "<u2") / 8191.0,
        noise_db=20.0 * np.log10(np.where(noise > 0.0, noise, np.nan)),  # the mean amplitude of a millisecond
        jamming_share=octets[jamming_at[order]] / 255.0,
    )


def _radio_blocks(octets: Octets, payloads: Payloads) -> tuple[Integers, Integers]:
    """Return first octet and number of every block of MON-RF."""
    first, size = payloads(0x0A38, 4)
    counts = np.minimum(octets[first + 1].astype(np.int64), (size - 4) // 24)
    index = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    blocks = np.repeat(first, counts) + 4 + 24 * index
    return blocks, octets[blocks].astype(np.int64)


def _states(octets: Octets, payloads: Payloads, clock: _Timeline) -> ReceiverStates | None:
    """Return what NAV-STATUS, MON-HW, MON-RF and SEC-SIG say of jamming and spoofing."""
    status, _ = payloads(0x0103, 16)
    hardware, _ = payloads(0x0A09, 60)
    blocks, _ = _radio_blocks(octets, payloads)
    security, _ = payloads(0x2709, 4)
    version, long_enough = octets[security], payloads(0x2709, 4)[1]
    first_kind, second_kind = security[(version == 1) & (long_enough >= 9)], security[version == 2]
    parts = [
        ("spoofing", status, octets[status + 7] >> 3 & 3),
        ("jamming", hardware, octets[hardware + 22] >> 2 & 3),
        ("jamming", blocks, octets[blocks + 1] & 3),
        ("jamming", first_kind, octets[first_kind + 4] >> 1 & 3),
        ("spoofing", first_kind, octets[first_kind + 8] >> 1 & 7),
        ("jamming", second_kind, octets[second_kind + 1] >> 1 & 3),
        ("spoofing", second_kind, octets[second_kind + 1] >> 4 & 7),
    ]
    octet = np.concatenate([first for _, first, _ in parts])
    subject = np.concatenate([np.full(first.size, name, "U14") for name, first, _ in parts])
    value = np.concatenate([values for _, _, values in parts]).astype(np.int64)
    instant_ns, known = clock.at(octet)
    order = np.argsort(octet, kind="stable")
    order = order[known[order]]
    if not order.size:
        return None
    value, subject = value[order], subject[order]
    words = np.where(
        subject == "jamming",
        np.array(_JAMMING)[np.minimum(value, len(_JAMMING) - 1)],
        np.array(_SPOOFING)[np.minimum(value, len(_SPOOFING) - 1)],
    )
    return ReceiverStates(
        gpst=instant_ns[order].astype("datetime64[ns]"), subject=subject, state=words, alarm=value >= 2
    )


# ---------------------------------------------------------------------- fields


def _signal_of(gnss: int, sv: int, number: int) -> SignalId | None:
    """Return the signal that the log calls so; None for what no satellite sends, or has no place in a constellation."""
    if gnss >= len(_SYSTEMS) or sv == 255:
        return None
    letter = _SYSTEMS[gnss]
    prn = sv - 100 if letter == "S" and sv > 100 else sv
    attribute = _ATTRIBUTES.get(letter, {}).get(number)
    kind = None if attribute is None else rinex_signal(letter, attribute)
    if kind is None or not 1 <= prn <= 99:
        return None
    return SignalId(f"{letter}{prn:02d}", *kind)


def _instants_ns(week: Integers, tow_s: Reals) -> tuple[Integers, Booleans]:
    """Return instants as nanoseconds since 1970, and which of them are known."""
    known = (week >= _FIRST_WEEK) & (week <= _LAST_WEEK) & (tow_s >= 0.0) & (tow_s < 604_801.0)
    whole_s = np.floor(np.where(known, tow_s, 0.0))
    fraction_ns = np.rint((np.where(known, tow_s, 0.0) - whole_s) * _NS).astype(np.int64)
    return GPS_EPOCH_NS + np.where(known, week, 0) * _WEEK_NS + whole_s.astype(np.int64) * _NS + fraction_ns, known


def _blocks(octets: Octets, first: Integers, counts: Integers, header: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the repeated blocks of payloads that begin at these octets, one after the other."""
    index = np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
    return read_blocks(octets, np.repeat(first + header, counts) + dtype.itemsize * index, dtype)


def _as_rawx(cells: NDArray[Any]) -> NDArray[Any]:
    """Return the blocks of RXM-RAW, of GPS and SBAS on L1, as those of RXM-RAWX.

    A phase is good from quality 6 on and a code from 4 on; the indicator of lost lock stands for a lock of no length.
    """
    same = np.zeros(cells.size, RAWX_CELL)
    for name in ("code_m", "carrier_cyc", "doppler_hz"):
        same[name] = cells[name]
    sbas = cells["sv"] >= 120
    same["gnss"], same["sv"] = np.where(sbas, 1, 0), cells["sv"]
    same["cn0_dbhz"] = np.maximum(cells["cn0_dbhz"], 0)
    same["lock_ms"] = np.where(cells["lost"] & 1, 0, np.iinfo(np.uint16).max)
    same["tracking"] = (cells["quality"] >= 4) * 1 + (cells["quality"] >= 6) * 2 + (cells["lost"] & 2 == 0) * 4
    return same


def _clock_of(octets: Octets, fixes: Integers, clocks: Integers) -> tuple[Reals, Reals]:
    """Return clock bias (s) and drift of the fixes, of the NAV-CLOCK of the same time of week; NaN without one."""
    bias_s, drift = np.full(fixes.size, np.nan), np.full(fixes.size, np.nan)
    if clocks.size and fixes.size:
        tow_ms, order = np.unique(read_field(octets, clocks, 0, "<u4"), return_index=True)
        wanted = read_field(octets, fixes, 0, "<u4")
        place = np.minimum(np.searchsorted(tow_ms, wanted), tow_ms.size - 1)
        same = tow_ms[place] == wanted
        chosen = clocks[order[place[same]]]
        bias_s[same] = read_field(octets, chosen, 4, "<i4") * 1e-9
        drift[same] = read_field(octets, chosen, 8, "<i4") * 1e-9
    return bias_s, drift
