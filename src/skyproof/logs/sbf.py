"""SBF, the protocol of Septentrio receivers: measurements, broadcast frames, fixes, levels, states.

mosaic-X5 reference guide 4.14.0, chapter 4; AsteRx SB3 Pro reference guide 4.10.1.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skyproof.arrays import Booleans, Integers, Octets, Reals
from skyproof.compiled import compiled
from skyproof.gnss.constants import SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import GEOSTATIONARY
from skyproof.gnss.lnav import check_words
from skyproof.gnss.signals import carrier_hz_of, rinex_signal
from skyproof.gnss.time import GPS_EPOCH_NS
from skyproof.logs.content import FRAME_BITS, BroadcastFrames, LogPiece, MessageKind, ReceiverStates, report_untimed
from skyproof.logs.frames import Frames, Protocol, read_blocks, read_field
from skyproof.logs.locks import CarrierLocks
from skyproof.logs.rows import SignalRows, observations_from_rows
from skyproof.records import FrontEndLevels, ReceiverFixes, SignalId
from skyproof.remarks import Remark, RemarkKind

__all__ = ["BLOCKS", "SbfReader"]

BLOCKS: Final = {
    4007: "PVTGeodetic",
    4014: "ReceiverStatus",
    4017: "GPSRawCA",
    4018: "GPSRawL2C",
    4019: "GPSRawL5",
    4022: "GALRawFNAV",
    4023: "GALRawINAV",
    4026: "GLORawCA",
    4027: "MeasEpoch",
    4047: "BDSRaw",
    4050: "ExtSensorMeas",
    4066: "QZSRawL1CA",
    4067: "QZSRawL2C",
    4068: "QZSRawL5",
    4092: "RFStatus",
    4219: "BDSRawB2a",
    4245: "GALAuthStatus",
}
"""Names of the blocks that are looked for."""

_SIGNALS: Final = {
    0: ("G", "1C"),
    1: ("G", "1W"),
    2: ("G", "2W"),
    3: ("G", "2L"),
    4: ("G", "5Q"),
    5: ("G", "1L"),
    6: ("J", "1C"),
    7: ("J", "2L"),
    8: ("R", "1C"),
    9: ("R", "1P"),
    10: ("R", "2P"),
    11: ("R", "2C"),
    12: ("R", "3Q"),
    13: ("C", "1P"),
    14: ("C", "5P"),
    15: ("I", "5A"),
    17: ("E", "1C"),
    19: ("E", "6C"),
    20: ("E", "5Q"),
    21: ("E", "7Q"),
    22: ("E", "8Q"),
    24: ("S", "1C"),
    25: ("S", "5I"),
    26: ("J", "5Q"),
    28: ("C", "2I"),
    29: ("C", "7I"),
    30: ("C", "6I"),
    32: ("J", "1L"),
    33: ("J", "1Z"),
    34: ("C", "7D"),
    38: ("J", "1E"),
    39: ("J", "5P"),
}
"""System and RINEX name of each signal number (4.1.10)."""
_RANGES: Final = (
    (1, 37, "G", 0),
    (38, 61, "R", 37),
    (63, 68, "R", 38),
    (71, 106, "E", 70),
    (120, 140, "S", 100),
    (141, 180, "C", 140),
    (181, 190, "J", 180),
    (191, 197, "I", 190),
    (198, 215, "S", 157),
    (216, 222, "I", 208),
    (223, 245, "C", 182),
)
"""First and last number of a range of satellites, system, and what is taken off (4.1.9)."""
_FRAME_KINDS: Final[dict[int, tuple[MessageKind, int]]] = {
    4017: ("LNAV", 10),
    4018: ("CNAV", 10),
    4019: ("CNAV", 10),
    4022: ("FNAV", 8),
    4023: ("INAV", 8),
    4026: ("GLONASS", 3),
    4047: ("D1", 10),
    4066: ("LNAV", 10),
    4067: ("CNAV", 10),
    4068: ("CNAV", 10),
    4219: ("BCNAV2", 18),
}
_NO_WEEK, _NO_TOW_MS = 65_535, 4_294_967_295
_NO_FLOAT: Final = -2e10
_NO_SHORT: Final = 65_535
_WEEK_NS: Final = 604_800_000_000_000
_HEADER: Final = 14  # octets to the first field behind the time
_ELSEWHERE: Final = 31  # signal numbers from 32 on stand in ObsInfo
_CHAINS: Final = {
    0: "L1",
    1: "G1",
    2: "E6",
    3: "L2",
    4: "G2",
    5: "L5",
    6: "E5b",
    7: "E5",
    8: "L1G1",
    9: "L2G2",
    11: "B1",
    12: "B3",
    14: "E6B3",
}
"""Bands of each front end of ReceiverStatus (4.2.15)."""
_SCRAMBLED: Final = 0x80
_INAUTHENTIC, _MISLEADING = 2, 1
_INTERFERED: Final = (2, 8)  # a band whose interference is mitigated, or is not

_TYPE1: Final = np.dtype(
    [
        ("channel", "u1"),
        ("type", "u1"),
        ("sv", "u1"),
        ("misc", "u1"),
        ("code_lsb", "<u4"),
        ("doppler", "<i4"),
        ("carrier_lsb", "<u2"),
        ("carrier_msb", "i1"),
        ("cn0", "u1"),
        ("lock_s", "<u2"),
        ("info", "u1"),
        ("count", "u1"),
    ]
)
_TYPE2: Final = np.dtype(
    [
        ("type", "u1"),
        ("lock_s", "u1"),
        ("cn0", "u1"),
        ("offsets", "u1"),
        ("carrier_msb", "i1"),
        ("info", "u1"),
        ("code_lsb", "<u2"),
        ("carrier_lsb", "<u2"),
        ("doppler_lsb", "<u2"),
    ]
)


class SbfReader:
    """Read SBF blocks, stretch by stretch (`LogReader`).

    Blocks before the receiver knows the time are left out; of measurements they are counted, and so are epochs that
    the receiver scrambled for want of a permission.
    """

    def __init__(self, source: str) -> None:
        """Begin a log; `source` names the receiver."""
        self._source = source
        self._numbers: dict[int, int] = {}  # by satellite and signal number
        self._names: list[SignalId] = []
        self._slots: dict[str, int] = {}
        self._locks = CarrierLocks()

    def read(self, frames: Frames) -> LogPiece:
        """Read the blocks of a stretch."""
        begin, length = frames.select(Protocol.SBF)
        octets = frames.octets
        long_enough = length >= _HEADER
        begin, length = begin[long_enough], length[long_enough]
        number = read_field(octets, begin, 4, "<u2").astype(np.int64) & 0x1FFF
        tow_ms = read_field(octets, begin, 8, "<u4").astype(np.int64)
        week = read_field(octets, begin, 12, "<u2").astype(np.int64)
        timed = (tow_ms != _NO_TOW_MS) & (week != _NO_WEEK) & (tow_ms < 604_800_000)
        instant_ns = GPS_EPOCH_NS + np.where(timed, week, 0) * _WEEK_NS + np.where(timed, tow_ms, 0) * 1_000_000
        messages = Counter(
            {BLOCKS.get(value, f"SBF {value}"): int((number == value).sum()) for value in np.unique(number).tolist()}
        )

        def blocks(kind: int, least: int) -> tuple[Integers, Integers, Integers]:
            """Return first octet, size and instant of the timed blocks of a kind that have `least` octets."""
            rows = np.flatnonzero((number == kind) & timed & (length >= least))
            return begin[rows], length[rows], instant_ns[rows]

        measured = (number == 4027) & (length >= 20)
        scrambled = measured & (octets[np.where(measured, begin + 17, 0)] & _SCRAMBLED > 0)
        rows = np.flatnonzero(measured & timed & ~scrambled)
        found = self._measurements(octets, begin[rows], length[rows], instant_ns[rows])
        untimed, hidden = int((measured & ~timed).sum()), int(scrambled.sum())
        remarks: list[str] = []
        if untimed:
            remarks.append(report_untimed(untimed))
        if hidden:
            words = f"{hidden} epochs are scrambled by the receiver, which lacks the permission to give them"
            remarks.append(Remark(words, RemarkKind.BEARS))
        return LogPiece(
            observations=None if found is None else observations_from_rows(found, self._source),
            fixes=_fixes(octets, *blocks(4007, 85)),
            levels=_levels(octets, *blocks(4014, 32)),
            states=_states(octets, blocks(4092, 20), blocks(4245, 52)),
            frames=tuple(frame for kind in _FRAME_KINDS for frame in _broadcast(octets, kind, *blocks(kind, 20))),
            messages=dict(messages),
            remarks=tuple(remarks),
        )

    # ------------------------------------------------------------------ measurements

    def _measurements(
        self, octets: Octets, begin: Integers, length: Integers, instant_ns: Integers
    ) -> SignalRows | None:
        """Return the rows of MeasEpoch."""
        first, second, owner, of_first = _sub_blocks(octets, begin, length)
        if not first.size:
            return None
        ones = read_blocks(octets, first, _TYPE1)
        twos = read_blocks(octets, second, _TYPE2)
        epoch_ns = instant_ns[owner]
        number = _signal_number(ones["type"], ones["info"])
        fdma = (number >= 8) & (number <= 11)
        slot = np.where(fdma, (ones["info"] >> 3).astype(np.int64) - 8, 0)
        code_m = 1e-3 * ((ones["misc"] & 15).astype(np.float64) * 2.0**32 + ones["code_lsb"])
        code_m = np.where((ones["misc"] & 15 == 0) & (ones["code_lsb"] == 0), np.nan, code_m)
        doppler_hz = np.where(ones["doppler"] == -(2**31), np.nan, 1e-4 * ones["doppler"])
        signal = self._signals_of(ones["sv"], number, slot)
        carrier_hz = self._carriers_hz()[signal]
        second_number = _signal_number(twos["type"], twos["info"])
        second_signal = self._signals_of(ones["sv"][of_first], second_number, slot[of_first])
        second_hz = self._carriers_hz()[second_signal]
        msb = (twos["offsets"] & 7).astype(np.int64)
        msb = np.where(msb > 3, msb - 8, msb)
        more_m = 1e-3 * (msb * 65_536.0 + twos["code_lsb"])
        second_m = np.where((msb == -4) & (twos["code_lsb"] == 0), np.nan, code_m[of_first] + more_m)
        msb = (twos["offsets"] >> 3).astype(np.int64)
        msb = np.where(msb > 15, msb - 32, msb)
        more_hz = 1e-4 * (msb * 65_536.0 + twos["doppler_lsb"])
        scaled_hz = doppler_hz[of_first] * second_hz / carrier_hz[of_first]
        second_doppler_hz = np.where((msb == -16) & (twos["doppler_lsb"] == 0), np.nan, scaled_hz + more_hz)
        lock_s = np.concatenate([ones["lock_s"].astype(np.int64), twos["lock_s"].astype(np.int64)])
        unknown_lock = np.concatenate([ones["lock_s"] == _NO_SHORT, twos["lock_s"] == 255])
        longest_s = np.repeat([_NO_SHORT - 1, 254], [ones.size, twos.size])
        ranges_m = np.concatenate([code_m, second_m])
        signals = np.concatenate([signal, second_signal])
        carriers = np.concatenate(
            [
                _carrier_cyc(ones, code_m, carrier_hz),
                _carrier_cyc(twos, second_m, second_hz),
            ]
        )
        epochs = np.concatenate([epoch_ns, epoch_ns[of_first]])
        antenna = np.concatenate([ones["type"] >> 5, twos["type"] >> 5])
        cn0_dbhz = np.concatenate([_cn0_dbhz(ones["cn0"], number), _cn0_dbhz(twos["cn0"], second_number)])
        half_open = np.concatenate([ones["info"] & 4 > 0, twos["info"] & 4 > 0])
        block = np.concatenate([owner, owner[of_first]])
        kept = np.flatnonzero((signals >= 0) & (antenna == 0))
        kept = kept[np.argsort(block[kept], kind="stable")]
        carriers = np.where(unknown_lock, np.nan, carriers)
        half_open &= np.isfinite(carriers)
        none = np.full(kept.size, np.nan)
        return SignalRows(
            signals=tuple(self._names),
            frequency_numbers=self._slots,
            instant_ns=epochs[kept],
            signal=signals[kept],
            pseudorange_m=ranges_m[kept],
            carrier_cyc=carriers[kept],
            doppler_hz=np.concatenate([doppler_hz, second_doppler_hz])[kept],
            cn0_dbhz=cn0_dbhz[kept],
            pseudorange_sigma_m=none,
            carrier_sigma_cyc=none,
            doppler_sigma_hz=none,
            slipped=self._locks.slips(
                epochs[kept],
                signals[kept],
                1000 * lock_s[kept],
                np.isfinite(carriers[kept]),
                half_open[kept],
                longest_ms=1000 * longest_s[kept],
                step_ms=1000,
            ),
            half_cycle_open=half_open[kept],
        )

    def _signals_of(self, sv: Octets, number: Integers, slot: Integers) -> Integers:
        """Return the index of each signal in `_names`, made when it is seen first; -1 for what is not read."""
        key = sv.astype(np.int64) << 8 | number
        counts = np.bincount(key, minlength=1)
        index = np.full(counts.size, -1, np.int64)
        for value in np.flatnonzero(counts).tolist():
            name = _signal_of(value >> 8, value & 0xFF)
            if name is None:
                continue
            if value not in self._numbers:
                self._numbers[value] = len(self._names)
                self._names.append(name)
            index[value] = self._numbers[value]
            if name.sat[0] == "R" and 8 <= value & 0xFF <= 11:
                self._slots[name.sat] = int(slot[key == value][-1])
        return np.asarray(index[key])

    def _carriers_hz(self) -> Reals:
        """Return the carrier of each name, and NaN behind the last for the index -1."""
        carriers = [carrier_hz_of(name.band, self._slots.get(name.sat)) for name in self._names]
        return np.array([*carriers, np.nan])


def _sub_blocks(octets: Octets, begin: Integers, length: Integers) -> tuple[Integers, Integers, Integers, Integers]:
    """Return where the sub-blocks of MeasEpoch begin: of type 1, of type 2, the block of each of type 1, and the one of
    type 1 that each of type 2 belongs to."""
    room = int(length.sum()) // _TYPE2.itemsize + 1
    found = np.empty((4, room), np.int64)
    n_first, n_second = _walk(octets, begin, length, _TYPE1.itemsize, _TYPE2.itemsize, found)
    return found[0, :n_first].copy(), found[1, :n_second].copy(), found[2, :n_first].copy(), found[3, :n_second].copy()


@compiled
def _walk(
    octets: Octets, begin: Integers, length: Integers, least_1: int, least_2: int, found: Integers
) -> tuple[int, int]:
    """Fill `found` as `_sub_blocks` returns it; blocks and sub-blocks that end too early are left."""
    n_first, n_second = 0, 0
    for block in range(begin.size):
        at, end = begin[block] + 20, begin[block] + length[block]
        size_1, size_2 = octets[begin[block] + 15], octets[begin[block] + 16]
        if size_1 < least_1:
            continue
        for _ in range(octets[begin[block] + 14]):
            if at + size_1 > end:
                break
            found[0, n_first], found[2, n_first] = at, block
            count = octets[at + 19]
            at += size_1
            for _ in range(count):
                if size_2 < least_2 or at + size_2 > end:
                    break
                found[1, n_second], found[3, n_second] = at, n_first
                n_second += 1
                at += size_2
            n_first += 1
    return n_first, n_second


def _signal_number(kind: Octets, info: Octets) -> Integers:
    number = (kind & 31).astype(np.int64)
    return np.where(number == _ELSEWHERE, (info >> 3).astype(np.int64) + 32, number)


def _carrier_cyc(cells: NDArray[Any], code_m: Reals, carrier_hz: Reals) -> Reals:
    """Return carrier phases, which the blocks give as what they are more than the code in cycles."""
    more_cyc = 1e-3 * (cells["carrier_msb"] * 65_536.0 + cells["carrier_lsb"])
    unknown = (cells["carrier_msb"] == -128) & (cells["carrier_lsb"] == 0)
    return np.where(unknown, np.nan, code_m * carrier_hz / SPEED_OF_LIGHT_M_S + more_cyc)


def _cn0_dbhz(steps: Octets, number: Integers) -> Reals:
    """Convert steps of a quarter decibel to C/N0; they count from 10 dB-Hz, but from 0 for P codes of GPS."""
    level = 0.25 * steps + np.where((number == 1) | (number == 2), 0.0, 10.0)
    return np.where(steps == 255, np.nan, level)


def _signal_of(sv: int, number: int) -> SignalId | None:
    """Return the signal of a satellite and a signal number; None for what has no name here."""
    sat = _sat_of(sv)
    system, attribute = _SIGNALS.get(number, ("", ""))
    if sat is None or sat[0] != system:
        return None
    kind = rinex_signal(system, attribute)
    return None if kind is None else SignalId(sat, *kind)


def _sat_of(sv: int) -> str | None:
    return next((f"{system}{sv - off:02d}" for low, high, system, off in _RANGES if low <= sv <= high), None)


# ---------------------------------------------------------------------- fixes, levels, states


def _fixes(octets: Octets, begin: Integers, size: Integers, instant_ns: Integers) -> ReceiverFixes | None:
    """Return the fixes of PVTGeodetic."""
    mode, error = octets[begin + 14] & 15, octets[begin + 15]
    lat_rad, lon_rad, height_m = (read_field(octets, begin, at, "<f8") for at in (16, 24, 32))
    good = (mode > 0) & (error == 0) & (lat_rad > _NO_FLOAT) & (lon_rad > _NO_FLOAT) & (height_m > _NO_FLOAT)
    rows = begin[good]
    if not rows.size:
        return None

    def number(at: int, kind: str) -> Reals:
        values = read_field(octets, rows, at, kind).astype(np.float64)
        return np.where(values > _NO_FLOAT, values, np.nan)

    def accuracy_m(at: int) -> Reals:
        """Return one sigma: newer blocks give twice that, in centimetres."""
        values = np.full(rows.size, _NO_SHORT, np.float64)
        newer = size[good] >= 94
        values[newer] = read_field(octets, rows[newer], at, "<u2")
        return np.where(values == _NO_SHORT, np.nan, 0.5e-2 * values)

    return ReceiverFixes.from_geodetic(
        instant_ns[good].astype("datetime64[ns]"),
        lat_rad[good],
        lon_rad[good],
        height_m[good],
        velocity_enu_m_s=np.stack([number(48, "<f4"), number(44, "<f4"), number(52, "<f4")], axis=-1),
        horizontal_sigma_m=accuracy_m(90),
        vertical_sigma_m=accuracy_m(92),
        clock_bias_s=1e-3 * number(60, "<f8"),
        clock_drift=1e-6 * number(68, "<f4"),
        satellites=np.where(octets[rows + 74] == 255, -1, octets[rows + 74]).astype(np.int64),
    )


def _groups(
    octets: Octets, begin: Integers, length: Integers, count_at: int, first_at: int
) -> tuple[Integers, Integers]:
    """Return the first octet of each sub-block of plain groups, and the block that it is of."""
    count, size = octets[begin + count_at].astype(np.int64), octets[begin + count_at + 1].astype(np.int64)
    count = np.where(size > 0, np.minimum(count, (length - first_at) // np.maximum(size, 1)), 0)
    owner = np.repeat(np.arange(begin.size), count)
    index = np.arange(owner.size) - np.repeat(np.cumsum(count) - count, count)
    return begin[owner] + first_at + index * size[owner], owner


def _levels(octets: Octets, begin: Integers, length: Integers, instant_ns: Integers) -> FrontEndLevels | None:
    """Return the gains of ReceiverStatus."""
    at, owner = _groups(octets, begin, length, 28, 32)
    gain = octets[at + 1].view(np.int8)
    known = gain != -128
    at, owner, gain = at[known], owner[known], gain[known]
    if not at.size:
        return None
    none = np.full(at.size, np.nan)
    share = octets[at + 2] / 100.0  # variance of the samples, of the target value
    return FrontEndLevels(
        gpst=instant_ns[owner].astype("datetime64[ns]"),
        band=np.array([_CHAINS.get(k, str(k)) for k in (octets[at] & 31).tolist()]),
        agc_db=gain.astype(np.float64),
        agc_share=none,
        noise_db=10.0 * np.log10(np.where(share > 0.0, share, np.nan)),
        jamming_share=none,
    )


def _states(
    octets: Octets, status: tuple[Integers, Integers, Integers], authentic: tuple[Integers, Integers, Integers]
) -> ReceiverStates | None:
    """Return what RFStatus says of jamming and spoofing, and GALAuthStatus of authentication."""
    begin, length, instant_ns = status
    flags = octets[begin + 16]
    parts: list[tuple[Integers, str, NDArray[np.str_], Booleans]] = []
    false = (flags & (_INAUTHENTIC | _MISLEADING)) > 0
    words = np.where(flags & _INAUTHENTIC > 0, "not authentic", np.where(false, "misleading", "none"))
    parts.append((instant_ns, "spoofing", words, false))
    at, owner = _groups(octets, begin, length, 14, 20)
    mode = octets[at + 6] & 15
    bands = np.zeros(begin.size, np.int64)
    np.add.at(bands, owner[np.isin(mode, _INTERFERED)], 1)
    parts.append((instant_ns, "jamming", np.where(bands > 0, "interference", "none"), bands > 0))
    begin, _, instant_ns = authentic
    active, good = (read_field(octets, begin, k, "<u8") for k in (20, 28))
    failed = active & ~good
    words = np.where(active == 0, "not available", np.where(failed > 0, "failed", "passed"))
    parts.append((instant_ns, "authentication", words, failed > 0))
    times = np.concatenate([part[0] for part in parts])
    if not times.size:
        return None
    order = np.argsort(times, kind="stable")
    return ReceiverStates(
        gpst=times[order].astype("datetime64[ns]"),
        subject=np.concatenate([np.full(part[0].size, part[1], "U14") for part in parts])[order],
        state=np.concatenate([part[2] for part in parts])[order],
        alarm=np.concatenate([part[3] for part in parts])[order],
    )


# ---------------------------------------------------------------------- broadcast frames


def _broadcast(
    octets: Octets, kind: int, begin: Integers, length: Integers, instant_ns: Integers
) -> Iterator[BroadcastFrames]:
    """Give the frames of one kind of block that passed the receiver's check, by kind of message."""
    message, n_words = _FRAME_KINDS[kind]
    good = (octets[begin + 15] == 1) & (length >= 20 + 4 * n_words)
    begin, instant_ns = begin[good], instant_ns[good]
    if not begin.size:
        return
    sats = [_sat_of(int(sv)) or "" for sv in octets[begin + 14]]
    numbers = octets[begin + 17] & 31
    signals = [_SIGNALS.get(int(number), ("", "")) for number in numbers]
    kinds = [rinex_signal(system, name) if system else None for system, name in signals]
    words = octets[(begin[:, None] + 20) + np.arange(4 * n_words)].reshape(-1, n_words, 4)[:, :, ::-1]
    bits = np.unpackbits(words, axis=2).reshape(begin.size, -1)
    if message == "LNAV":
        bits, whole = _lnav_source(bits)
    elif message == "INAV":  # the six bits that end the even page are left out
        bits = np.hstack([bits[:, :114], np.zeros((begin.size, 6), np.uint8), bits[:, 114:234]])
        whole = np.ones(begin.size, np.bool_)
    else:
        bits, whole = bits[:, : FRAME_BITS[message]], np.ones(begin.size, np.bool_)
    second = np.array([message == "D1" and sat in GEOSTATIONARY for sat in sats])
    known = np.array([bool(sat) and name is not None for sat, name in zip(sats, kinds, strict=True)]) & whole
    usable: tuple[tuple[MessageKind, Booleans], ...] = ((message, known & ~second), ("D2", known & second))
    for name, chosen in usable:
        rows = np.flatnonzero(chosen)
        if rows.size:
            yield BroadcastFrames(
                kind=name,
                gpst=instant_ns[rows].astype("datetime64[ns]"),
                until_gpst=instant_ns[rows].astype("datetime64[ns]"),
                since_gpst=instant_ns[rows].astype("datetime64[ns]"),
                sat=np.array([sats[k] for k in rows]),
                band=np.array([(kinds[k] or ("", ""))[0] for k in rows]),
                code=np.array([(kinds[k] or ("", ""))[1] for k in rows]),
                bits=np.packbits(bits[rows], axis=1),
            )


def _lnav_source(bits: Octets) -> tuple[Octets, Booleans]:
    """Return the 240 source bits of subframes of 300, and where they hold: by their parity, or as data put upright."""
    sent = bits[:, :300].astype(np.int8)
    upright = sent ^ (1 - sent[:, :1])
    data, holds = check_words(upright)
    plain = sent.reshape(-1, 10, 30)[:, :, :24]
    by_parity = holds.all(axis=1, keepdims=True)
    source = np.where(by_parity, data.reshape(-1, 240), plain.reshape(-1, 240))
    begins = (source[:, :8] == np.array([1, 0, 0, 0, 1, 0, 1, 1])).all(axis=1)
    return source.astype(np.uint8), begins
