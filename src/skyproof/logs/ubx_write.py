"""Measurements as a u-blox receiver logs them: RXM-RAWX, RXM-SFRBX with GPS messages, and NAV-PVT.

u-blox F9 HPG 1.32 interface description (UBX-22008968), 3.15 and 3.17. What one receiver tracks: one signal of each
transmission.
"""

import struct
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from skyproof.gnss.ephemeris import Ephemeris
from skyproof.gnss.frames import geodetic_from_ecef, rot_enu_ecef
from skyproof.gnss.lnav import SUBFRAME_S, check_words, encode_subframes
from skyproof.gnss.signals import frequency_number_of, rinex_attribute
from skyproof.gnss.time import GPS_EPOCH, leap_seconds, seconds_between, utc_from_gpst, week_and_tow
from skyproof.logs.ubx import SIGNAL_NUMBERS
from skyproof.records import NavigationData, Observations, ReceiverFixes

__all__ = ["ubx_frame", "ubx_log"]

_LATE_S: Final = 0.1  # after which a subframe has arrived in full: its travel, and what the receiver's clock may be off
_LONGEST_LOCK_MS: Final = 64_500
_RAWX_CELL: Final = struct.Struct("<ddfBBBBHBBBBBB")
_CODE, _CARRIER, _HALF = 1, 2, 4


def ubx_frame(message_class: int, message_id: int, payload: bytes) -> bytes:
    """Return a UBX frame with its Fletcher checksum."""
    body = bytes([message_class, message_id]) + len(payload).to_bytes(2, "little") + payload
    sums = np.cumsum(np.frombuffer(body, np.uint8).astype(np.int64))
    return b"\xb5\x62" + body + bytes([int(sums[-1]) & 0xFF, int(sums.sum()) & 0xFF])


def ubx_log(
    observations: Observations, navigation: NavigationData | None = None, fixes: ReceiverFixes | None = None
) -> Iterator[bytes]:
    """Return the frames of each epoch in turn.

    Levels are rounded to whole decibels and deviations to the steps of RXM-RAWX; a number for the lock counts from the
    last slip. Each GPS satellite's subframes come with the first epoch after they have arrived.

    navigation : whose GPS orbits the messages are made of; none without it.
    fixes : at epochs of the same labels, for NAV-PVT.

    Raises ValueError if two signals of a transmission are measured at one epoch, or one has no number in UBX.
    """
    o = observations
    numbers = [_number_of(s.sat, s.band, s.code) for s in o.signals]
    _require_one_each(o, numbers)
    slots = [_slot_of(s.sat, s.band, float(hz)) for s, hz in zip(o.signals, o.carrier_hz, strict=True)]
    lock_ms = _locks_ms(o)
    at = {} if fixes is None else {gpst: k for k, gpst in enumerate(fixes.gpst.tolist())}
    sent: dict[str, int] = {}
    for k in range(o.gpst.size):
        frames = [_rawx(o, k, numbers, slots, lock_ms)]
        if navigation is not None:
            frames += _subframes(o, k, navigation, sent)
        if fixes is not None and (row := at.get(o.gpst[k].astype("M8[ns]").item())) is not None:
            frames.append(_pvt(fixes, row))
        yield b"".join(frames)


def _number_of(sat: str, band: str, code: str) -> tuple[int, int, int]:
    """Return gnssId, svId and sigId of a signal."""
    attribute = rinex_attribute(sat, band, code)
    number = SIGNAL_NUMBERS.get((sat[0], attribute or ""))
    if number is None:
        raise ValueError(f"{sat} {band} {code} has no number in UBX")
    return (*number[:1], int(sat[1:]) + (100 if sat[0] == "S" else 0), number[1])


def _require_one_each(o: Observations, numbers: Sequence[tuple[int, int, int]]) -> None:
    for number in {number for number in numbers if numbers.count(number) > 1}:
        columns = [k for k, other in enumerate(numbers) if other == number]
        if (np.isfinite(o.pseudorange_m[:, columns]).sum(axis=1) > 1).any():
            raise ValueError(f"two signals of {o.signals[columns[0]].sat} are measured at one epoch; log one")


def _slot_of(sat: str, band: str, carrier_hz: float) -> int:
    number = frequency_number_of(band, carrier_hz) if sat[0] == "R" else None
    return 0 if number is None else number + 7


def _locks_ms(o: Observations) -> np.ndarray[tuple[int, ...], np.dtype[np.int64]]:
    """Return for how long each carrier has been followed, (n_epochs, n_signals)."""
    lock_ms = np.zeros(o.status.shape, np.int64)
    carrier, slipped = np.isfinite(o.carrier_cyc), o.slipped
    step_ms = np.diff(o.elapsed_s, prepend=o.elapsed_s[:1]) * 1e3
    for k in range(1, o.gpst.size):
        goes_on = carrier[k] & carrier[k - 1] & ~slipped[k]
        lock_ms[k] = np.where(goes_on, lock_ms[k - 1] + round(float(step_ms[k])), 0)
    return np.minimum(lock_ms, _LONGEST_LOCK_MS)


def _rawx(
    o: Observations,
    k: int,
    numbers: Sequence[tuple[int, int, int]],
    slots: Sequence[int],
    lock_ms: np.ndarray[tuple[int, ...], np.dtype[np.int64]],
) -> bytes:
    week, tow_s = week_and_tow(o.gpst[k])
    code_m, carrier_cyc, doppler_hz = o.pseudorange_m[k], o.carrier_cyc[k], o.doppler_hz[k]
    present = np.flatnonzero(np.isfinite(code_m) | np.isfinite(carrier_cyc))[:255]
    payload = struct.pack("<dHbBBBH", tow_s, week, leap_seconds(o.gpst[k]), present.size, 1, 1, 0)
    for c in present.tolist():
        code, carrier = bool(np.isfinite(code_m[c])), bool(np.isfinite(carrier_cyc[c]))
        gnss, sv, signal = numbers[c]
        level_dbhz = o.cn0_dbhz[k, c]
        payload += _RAWX_CELL.pack(
            code_m[c] if code else 0.0,
            carrier_cyc[c] if carrier else 0.0,
            doppler_hz[c] if np.isfinite(doppler_hz[c]) else 0.0,
            gnss,
            sv,
            signal,
            slots[c],
            int(lock_ms[k, c]),
            round(float(level_dbhz)) if np.isfinite(level_dbhz) else 0,
            _exponent(o.pseudorange_sigma_m[k, c], 0.01),
            int(np.clip(np.nan_to_num(o.carrier_sigma_cyc[k, c] / 0.004, nan=1.0), 1, 14)),
            _exponent(o.doppler_sigma_hz[k, c], 0.002),
            code * _CODE + carrier * _CARRIER + (carrier and not o.half_cycle_open[k, c]) * _HALF,
            0,
        )
    return ubx_frame(0x02, 0x15, payload)


def _exponent(sigma: float, unit: float) -> int:
    """Return the step that states a deviation: the unit times two to its power."""
    return int(np.clip(np.round(np.log2(sigma / unit)), 0, 15)) if np.isfinite(sigma) and sigma > 0.0 else 0


def _subframes(o: Observations, k: int, navigation: NavigationData, sent: dict[str, int]) -> list[bytes]:
    """Return the subframes of GPS satellites that have arrived since the last epoch; `sent` counts those before."""
    since_s = seconds_between(o.gpst[k], GPS_EPOCH)
    arrived = int((since_s - _LATE_S) // SUBFRAME_S)
    seen = np.isfinite(o.pseudorange_m[k])
    sats = sorted({s.sat for s, there in zip(o.signals, seen, strict=True) if there and s.sat[0] == "G"})
    frames = []
    for sat in sats:
        if sent.get(sat) == arrived:
            continue
        ephemeris = navigation.best(sat, o.gpst[k])
        # What came in before the satellite was seen is not known.
        if sat in sent and sent[sat] == arrived - 1 and isinstance(ephemeris, Ephemeris):
            week, tow_s = divmod(SUBFRAME_S * (arrived - 1), 604_800)
            bits = encode_subframes(ephemeris, navigation.ionosphere, navigation.utc, tow_s, week, 1)
            data, _ = check_words(bits)
            words = np.concatenate([data.reshape(10, 24), bits.reshape(10, 30)[:, 24:]], axis=1).astype(np.int64)
            numbers = words @ (1 << np.arange(29, -1, -1))
            head = bytes([0, int(sat[1:]), 0, 0, 10, 0, 2, 0])
            frames.append(ubx_frame(0x02, 0x13, head + numbers.astype("<u4").tobytes()))
        sent[sat] = arrived
    return frames


def _pvt(fixes: ReceiverFixes, row: int) -> bytes:
    """Return NAV-PVT of a fix; what is not known of it is zero."""
    gpst, place_m = fixes.gpst[row], fixes.position_ecef_m[row]
    if not np.isfinite(place_m).all():
        return b""
    lat_rad, lon_rad, height_m = geodetic_from_ecef(place_m)
    east_m_s, north_m_s, up_m_s = np.nan_to_num(rot_enu_ecef(lat_rad, lon_rad) @ fixes.velocity_ecef_m_s[row])
    utc = utc_from_gpst(gpst)
    second = utc.astype("M8[s]")
    date = second.item()
    horizontal_mm, vertical_mm = (
        int(np.clip(np.nan_to_num(1e3 * values[row], nan=0.0), 0, 2**32 - 1))
        for values in (fixes.horizontal_sigma_m, fixes.vertical_sigma_m)
    )
    payload = bytearray(92)
    struct.pack_into("<I", payload, 0, round(float(week_and_tow(gpst)[1]) * 1e3) % 604_800_000)
    struct.pack_into("<HBBBBBB", payload, 4, date.year, date.month, date.day, date.hour, date.minute, date.second, 0x37)
    struct.pack_into("<i", payload, 16, int((utc - second) / np.timedelta64(1, "ns")))
    payload[20], payload[21], payload[23] = 3, 1, int(np.clip(fixes.satellites[row], 0, 255))
    degrees = [round(float(np.degrees(angle)) * 1e7) for angle in (lon_rad, lat_rad)]
    height_mm = round(float(height_m) * 1e3)
    struct.pack_into("<iiiiII", payload, 24, *degrees, height_mm, height_mm, horizontal_mm, vertical_mm)
    north, east, up = (round(float(v) * 1e3) for v in (north_m_s, east_m_s, up_m_s))
    struct.pack_into("<iiii", payload, 48, north, east, -up, round(float(np.hypot(north, east))))
    return ubx_frame(0x01, 0x07, bytes(payload))
