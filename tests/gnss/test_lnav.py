"""Golden messages: words that G32 sent on 28 August 2025, and the message in the rendered pair of recordings.

The words of G32 were received by a u-blox (rtklibexplorer/GNSS_IMU, data/walk_0827, BSD-3-Clause), written as sent.
"""

import struct
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyproof.formats.rinex_nav import read_nav
from skyproof.gnss.atmosphere import compute_klobuchar_s, compute_troposphere_m
from skyproof.gnss.codes import generate_ca_code
from skyproof.gnss.constants import GPS_PI, SPEED_OF_LIGHT_M_S
from skyproof.gnss.ephemeris import Klobuchar, UtcParameters
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.lnav import (
    decode_how,
    decode_subframe,
    encode_subframes,
    ephemeris_from_subframes,
    find_subframes,
    ionosphere_and_utc,
    quantise,
)
from skyproof.gnss.nominal import NOMINAL_KLOBUCHAR, make_nominal_constellation
from skyproof.gnss.orbits import compute_satellite_state_s
from skyproof.gnss.sky import compute_azimuth_elevation, rotate_to_reception
from skyproof.gnss.time import parse_iso

G32 = {
    1: (
        0x22C14D1C,
        0x2141E958,
        0x14D40024,
        0x07A17A32,
        0x36EC4FCD,
        0x12E87066,
        0x215F00B5,
        0x2B26F355,
        0x3FFFE2DA,
        0x34B641B0,
    ),
    2: (
        0x22C14D1C,
        0x21416AAC,
        0x14FF79EF,
        0x331BE430,
        0x1B411BE4,
        0x3F878114,
        0x1AEDA2DE,
        0x02F16869,
        0x3CB59E1A,
        0x190C9FB8,
    ),
    3: (
        0x22C14D1C,
        0x21418B90,
        0x000196DF,
        0x22287F98,
        0x3FEA49D7,
        0x29A1D142,
        0x087DEB3F,
        0x3EEDB6CA,
        0x3FEA3C66,
        0x14C110EC,
    ),
}
NAVIGATION = make_nominal_constellation(parse_iso("2022-01-01T21:46:00"))
EPHEMERIS = NAVIGATION.ephemerides[4]
UTC = UtcParameters(a0=2.79396772385e-09, a1=7.9936057773e-15, tot=147456.0, wnt=2191, leap_seconds=18)
STREAM = encode_subframes(EPHEMERIS, NOMINAL_KLOBUCHAR, UTC, 596760, 2190, 10)
SUBFRAME = STREAM[:300]


def list_bits(words):
    return np.array([word >> (29 - k) & 1 for word in words for k in range(30)], dtype=np.int8)


def list_subframes(stream):
    return [decode_subframe(stream[start : start + 300]) for start in find_subframes(stream)]


# ---------------------------------------------------------------- what satellites really send


@pytest.mark.parametrize("inverted", [0, 1])
@pytest.mark.parametrize(("number", "tow_s"), [(1, 408660), (2, 408636), (3, 408642)])
def test_real_subframes_hold_and_give_their_time(number, tow_s, inverted):
    bits = list_bits(G32[number]) ^ inverted
    subframe = decode_subframe(bits)
    assert (subframe.id, subframe.tow_s, subframe.inverted) == (number, tow_s, bool(inverted))
    how = decode_how(bits[:60])
    assert (how.id, how.tow_s, how.inverted, how.alert) == (number, tow_s, bool(inverted), False)


def test_real_subframes_make_an_ephemeris():
    eph = ephemeris_from_subframes(*(decode_subframe(list_bits(G32[number])) for number in (1, 2, 3)), "G32", 2400)
    assert (eph.week, eph.toe) == (2381, 410400.0)  # the receiver was in week 2381; its clock showed 408640 s
    assert eph.iode == eph.iodc == 0x53  # figure 20-1: first eight bits of word 3 of subframe 2
    assert eph.health == 0
    assert eph.crs == (0xFDE7 - 0x10000) / 32.0  # the sixteen bits after it


def list_ubx_messages(content):
    """List class, number and payload of each u-blox message in `content`."""
    at = content.find(b"\xb5\x62")
    while 0 <= at <= len(content) - 8:
        length = int.from_bytes(content[at + 4 : at + 6], "little")
        yield content[at + 2], content[at + 3], content[at + 6 : at + 6 + length]
        at = content.find(b"\xb5\x62", at + 8 + length)


def restore_inversion(words):
    """Restore the inversion by D30*, which u-blox takes off the whole word, parity bits included."""
    sent, inverted = [], 0
    for word in words:
        sent.append((word ^ (0x3FFFFFFF * inverted)) & 0x3FFFFFFF)
        inverted = sent[-1] & 1
    return sent


@pytest.mark.shared_data
def test_real_messages_explain_real_pseudoranges(shared_data):
    # Every subframe of a log holds, and the orbits in them fit the receiver's measurements at its surveyed place.
    log = (shared_data / "real" / "imu-gnss-walk" / "gnss_1730.ubx").read_bytes()
    subframes, measured_m, at = {}, {}, None
    for kind, number, payload in list_ubx_messages(log):
        if (kind, number) == (0x02, 0x13) and payload[0] == 0 and payload[2] == 0:  # RXM-SFRBX of GPS L1 C/A
            subframe = decode_subframe(list_bits(restore_inversion(struct.unpack_from("<10I", payload, 8))))
            assert subframe is not None
            subframes.setdefault(payload[1], {})[subframe.id] = subframe
        if (kind, number) == (0x02, 0x15) and at is None:  # RXM-RAWX
            at = struct.unpack_from("<dH", payload)
            for block in range(16, 16 + 32 * payload[11], 32):
                if payload[block + 20] == 0 and payload[block + 22] == 0:
                    measured_m[payload[block + 21]] = struct.unpack_from("<d", payload, block)[0]
    tow_s, week = at
    # First fixed solution of the log's reference (gnss_1730_sf.pos), good to centimetres.
    lat_rad, lon_rad, height_m = np.radians(40.0966916), np.radians(-105.1471665), 1601.435
    rx_m = ecef_from_geodetic(lat_rad, lon_rad, height_m)
    residuals_m = []
    for prn, found in subframes.items():
        if {1, 2, 3} <= found.keys() and prn in measured_m:
            eph = ephemeris_from_subframes(found[1], found[2], found[3], f"G{prn:02d}", week + 100)
            assert eph.week == week
            travel_s = measured_m[prn] / SPEED_OF_LIGHT_M_S
            state = compute_satellite_state_s(eph, week, tow_s - travel_s)
            sat_m = rotate_to_reception(state.position_ecef_m, travel_s)
            az_rad, el_rad = compute_azimuth_elevation(rx_m, sat_m)
            iono_s = compute_klobuchar_s(NOMINAL_KLOBUCHAR, lat_rad, lon_rad, az_rad, el_rad, tow_s)
            clock_s = state.clock_s - eph.tgd
            expected_m = np.linalg.norm(sat_m - rx_m) + compute_troposphere_m(lat_rad, height_m, el_rad)
            residuals_m.append(measured_m[prn] - expected_m - SPEED_OF_LIGHT_M_S * (iono_s - clock_s))
    assert len(residuals_m) >= 4
    assert np.ptp(residuals_m) < 20.0  # beside the receiver's clock there are left: another day's ionosphere, noise


@pytest.fixture(scope="module")
def rendered_subframes(shared_data, authentic_rows):
    """Demodulate subframes of G18 in rx1.bin with the code and carrier of the truth, without our receiver."""
    mine = (authentic_rows["receiver"] == "rx1") & (authentic_rows["prn"] == 18) & (authentic_rows["tow_s"] < 596786)
    rows = {name: column[mine] for name, column in authentic_rows.items()}
    raw = np.memmap(shared_data / "rf" / "meaconing-pair" / "rx1.bin", np.uint8, "r")
    bytes_per_s = 2_600_000 / 4
    sent_s, elapsed_s = rows["tow_s"] - rows["code_delay_s"], rows["receiver_elapsed_s"]
    first_bit = int(sent_s[0] / 0.02) + 1
    sums = np.zeros(3000)
    for k in range(len(sent_s) - 1):
        start, end = (int(np.ceil(elapsed_s[j] * bytes_per_s)) for j in (k, k + 1))
        samples = (1.0 - 2.0 * (raw[start:end] >> 7)) + 1j * (1.0 - 2.0 * (raw[start:end] >> 6 & 1))  # one of four
        t_s, second_s = np.arange(start, end) / bytes_per_s - elapsed_s[k], elapsed_s[k + 1] - elapsed_s[k]
        rate_hz_s = (rows["doppler_hz"][k + 1] - rows["doppler_hz"][k]) / second_s
        phase_cyc = rows["phase_cycles"][k] + rows["doppler_hz"][k] * t_s + rate_hz_s * t_s**2 / 2.0
        send_s = sent_s[k] + (sent_s[k + 1] - sent_s[k]) * t_s / second_s
        code = generate_ca_code(18)[np.floor(send_s * 1.023e6 % 1023).astype(int)]
        bits = np.floor(send_s / 0.02).astype(int) - first_bit
        upright = (samples * np.exp(-2j * np.pi * phase_cyc)).real * code
        sums += np.bincount(bits[bits >= 0], upright[bits >= 0], 3000)
    stream = (sums < 0).astype(np.int8)[: int(sent_s[-1] / 0.02) - first_bit]
    return [
        ((first_bit + start) / 50, decode_subframe(stream[start : start + 300]))
        for start in find_subframes(stream)
        if start + 300 <= stream.size
    ]


@pytest.mark.shared_data
def test_the_message_of_an_independent_program_is_read(shared_data, rendered_subframes):
    # The rendered message was made from the broadcast file by another program: each value must come back.
    assert [(subframe.id, subframe.tow_s) for _, subframe in rendered_subframes] == [
        (k + 1, 596760 + 6 * k) for k in range(4)
    ]
    assert all(sent_s == subframe.tow_s for sent_s, subframe in rendered_subframes)
    subframes = [subframe for _, subframe in rendered_subframes]
    navigation = read_nav(shared_data / "rf" / "brdc0010.22n")
    sent = navigation.best("G18", parse_iso("2022-01-01T21:46:00"))
    received = ephemeris_from_subframes(*subframes[:3], "G18", 2200)
    for name, value in asdict(sent).items():
        if name not in ("sat", "transmission_tow"):
            expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-11, abs=1e-30)
            assert getattr(received, name) == expected, name
    klobuchar, utc = ionosphere_and_utc(subframes[3], 2190)
    np.testing.assert_allclose(klobuchar.alpha, navigation.ionosphere.alpha, rtol=1e-3)  # four digits in the file
    np.testing.assert_allclose(klobuchar.beta, navigation.ionosphere.beta, rtol=1e-3)
    assert (utc.tot, utc.wnt, utc.leap_seconds) == (147456.0, 2191, 18)
    assert utc.a0 == pytest.approx(navigation.utc.a0, rel=1e-9)
    assert utc.a1 == pytest.approx(navigation.utc.a1, rel=1e-9)


# ---------------------------------------------------------------- parity


def test_every_flipped_bit_is_caught():
    assert decode_subframe(SUBFRAME) is not None
    for k in range(300):
        damaged = SUBFRAME.copy()
        damaged[k] ^= 1
        assert decode_subframe(damaged) is None, k


@given(st.integers(0, 9), st.sets(st.integers(0, 29), min_size=2, max_size=3))
def test_two_or_three_flipped_bits_of_a_word_are_caught(word, flips):
    damaged = SUBFRAME.copy()  # the code has distance 4: IS-GPS-200N, 20.3.5
    damaged[[30 * word + k for k in flips]] ^= 1
    assert decode_subframe(damaged) is None


@pytest.mark.parametrize("word", [1, 9])
def test_a_word_without_its_final_zeros_is_no_subframe(word):
    damaged = SUBFRAME.copy()
    damaged[[30 * word + bit - 1 for bit in (23, 25, 28, 30)]] ^= 1  # bit 23 and the parity bits that it is in
    assert decode_subframe(damaged) is None
    assert word == 9 or decode_how(damaged[:60]) is None


def test_each_word_follows_the_equations_of_the_standard():
    # Slow twin of the parity: table 20-XIV bit by bit, over half a minute.
    rng = np.random.default_rng(1)
    eph = replace(EPHEMERIS, **{name: rng.uniform(-1e-7, 1e-7) for name in ("cic", "cis", "cuc", "cus")})
    stream = encode_subframes(eph, None, None, 596760, 2190, 25)
    d29_before, d30_before = 0, 0
    for word in stream.reshape(-1, 30):
        d = [0, *(int(bit) ^ d30_before for bit in word[:24])]
        assert word[24] == (d29_before + sum(d[k] for k in (1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23))) % 2
        assert word[25] == (d30_before + sum(d[k] for k in (2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24))) % 2
        assert word[26] == (d29_before + sum(d[k] for k in (1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22))) % 2
        assert word[27] == (d30_before + sum(d[k] for k in (2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23))) % 2
        d29 = d30_before + sum(d[k] for k in (1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24))
        d30 = d29_before + sum(d[k] for k in (3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24))
        assert (word[28], word[29]) == (d29 % 2, d30 % 2)
        d29_before, d30_before = word[28:]
    assert not stream.reshape(-1, 10, 30)[:, [1, 9], 28:].any()  # 20.3.3.2: words 2 and 10 end in zeros


# ---------------------------------------------------------------- there and back


def sweep_range(bits, step, *, signed=True):
    low = -(1 << bits - 1) if signed else 0
    return st.integers(low, low + (1 << bits) - 1).map(lambda raw: raw * step)


ANGLES = {"m0": 32, "omega0": 32, "omega": 32}
EPHEMERIDES = st.builds(
    lambda values, iodc, fit: replace(
        EPHEMERIS, **values, iodc=iodc, iode=iodc % 256, fit_interval_h=4.0 if fit is False else 6.0
    ),
    st.fixed_dictionaries(
        {name: sweep_range(bits, 2.0**-31).map(lambda v: v * GPS_PI) for name, bits in ANGLES.items()}
        | {"delta_n": sweep_range(16, 2.0**-43).map(lambda v: v * GPS_PI)}
        | {"idot": sweep_range(14, 2.0**-43).map(lambda v: v * GPS_PI)}
        | {"omega_dot": st.integers(-55000, -1).map(lambda raw: raw * 2.0**-43 * GPS_PI)}
        | {"i0": st.integers(479_000_000, 819_000_000).map(lambda raw: raw * 2.0**-31 * GPS_PI)}
        | {"sqrt_a": st.integers(2_622_000_000, 2_778_000_000).map(lambda raw: raw * 2.0**-19)}
        | {"e": st.integers(0, 850_000_000).map(lambda raw: raw * 2.0**-33)}
        | {name: sweep_range(16, 2.0**-5) for name in ("crs", "crc")}
        | {name: sweep_range(16, 2.0**-29) for name in ("cus", "cuc", "cis", "cic")}
        | {"af0": sweep_range(22, 2.0**-31), "af1": sweep_range(16, 2.0**-43), "af2": sweep_range(8, 2.0**-55)}
        | {"tgd": sweep_range(8, 2.0**-31), "health": st.integers(0, 63), "ura_index": st.integers(0, 15)}
        | {"code_on_l2": st.integers(0, 3), "l2_p_flag": st.integers(0, 1)}
    ),
    st.integers(0, 239),
    st.booleans(),
)


@settings(max_examples=60)
@given(EPHEMERIDES, st.sampled_from([0, 1]))
def test_every_field_of_an_ephemeris_comes_back(eph, inverted):
    stream = encode_subframes(eph, None, None, 596760, 2190, 3) ^ inverted
    back = ephemeris_from_subframes(*list_subframes(stream), eph.sat, 2000)
    assert repr(back) == repr(eph)
    assert repr(quantise(eph)) == repr(eph)


@settings(max_examples=60)
@given(
    st.lists(st.integers(-128, 127), min_size=8, max_size=8),
    sweep_range(32, 2.0**-30),
    sweep_range(24, 2.0**-50),
    st.integers(0, 147),
    st.integers(2100, 2300),
    st.integers(0, 60),
)
def test_ionosphere_and_utc_come_back(raw, a0, a1, tot, wnt, leaps):
    alpha = (raw[0] * 2.0**-30, raw[1] * 2.0**-27, raw[2] * 2.0**-24, raw[3] * 2.0**-24)
    beta = (raw[4] * 2.0**11, raw[5] * 2.0**14, raw[6] * 2.0**16, raw[7] * 2.0**16)
    klobuchar = Klobuchar(alpha=alpha, beta=beta)
    utc = UtcParameters(a0=a0, a1=a1, tot=tot * 4096.0, wnt=wnt, leap_seconds=leaps)
    stream = encode_subframes(EPHEMERIS, klobuchar, utc, 596778, 2190, 1)  # page 18 of subframe 4
    assert ionosphere_and_utc(decode_subframe(stream), 2200) == (klobuchar, utc)


def test_only_page_18_of_subframe_4_holds_the_ionosphere():
    superframe = list_subframes(encode_subframes(EPHEMERIS, NOMINAL_KLOBUCHAR, UTC, 0, 2190, 125))
    assert len(superframe) == 125
    holders = [k for k, subframe in enumerate(superframe) if ionosphere_and_utc(subframe, 2190) is not None]
    assert holders == [17 * 5 + 3]
    without = list_subframes(encode_subframes(EPHEMERIS, None, None, 596760, 2190, 5))
    assert all(ionosphere_and_utc(subframe, 2190) is None for subframe in without)
    utc_only = decode_subframe(encode_subframes(EPHEMERIS, None, UTC, 596778, 2190, 1))
    assert ionosphere_and_utc(utc_only, 2190)[1].leap_seconds == 18


def test_a_real_ephemeris_keeps_its_values_to_a_message_step():
    eph = replace(EPHEMERIS, m0=1.23456789012345, crs=-84.91, af0=-1.17e-4)
    sent = quantise(eph)
    assert sent.m0 == pytest.approx(eph.m0, abs=GPS_PI * 2.0**-32)
    assert sent.crs == -84.90625
    assert sent.af0 == pytest.approx(eph.af0, abs=2.0**-32)
    assert sent.sat == eph.sat


def test_a_value_that_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"af0 = 0\.01 .*\b22 bits"):
        encode_subframes(replace(EPHEMERIS, af0=0.01), None, None, 0, 2190, 1)
    with pytest.raises(ValueError, match=r"multiple of 6\b"):
        encode_subframes(EPHEMERIS, None, None, 5, 2190, 1)


def test_the_week_ends_inside_a_stream():
    stream = encode_subframes(EPHEMERIS, None, None, 604794, 2190, 7)
    subframes = list_subframes(stream)
    assert [(s.id, s.tow_s) for s in subframes] == [(5, 604794), *((k + 1, 6 * k) for k in range(5)), (1, 30)]
    assert subframes[1].fields["week_mod_1024"] == 2191 % 1024


@pytest.mark.parametrize(("toe", "tow_s", "week"), [(0.0, 604770, 2191), (604784.0, 0, 2190), (7200.0, 6000, 2191)])
def test_an_ephemeris_has_the_week_of_its_time_not_transmission(toe, tow_s, week):
    sent_week = 2190 if tow_s > 300000 else 2191
    eph = replace(EPHEMERIS, toe=toe, toc=toe, week=week, toc_week=week)
    stream = encode_subframes(eph, None, None, tow_s, sent_week, 3)
    assert repr(ephemeris_from_subframes(*list_subframes(stream), eph.sat, 2000)) == repr(eph)


@pytest.mark.parametrize(
    ("iodc", "flag_h", "hours"), [(10, 4.0, 4.0), (10, 8.0, 6.0), (244, 8.0, 8.0), (496, 14.0, 14.0)]
)
def test_the_fit_interval_follows_flag_and_iodc(iodc, flag_h, hours):
    eph = replace(EPHEMERIS, iodc=iodc, iode=iodc % 256, fit_interval_h=flag_h)
    back = ephemeris_from_subframes(*list_subframes(encode_subframes(eph, None, None, 596760, 2190, 3)), "G05", 2190)
    assert back.fit_interval_h == hours  # IS-GPS-200N, table 20-XII


def test_subframes_of_different_data_sets_make_no_ephemeris():
    newer = encode_subframes(replace(EPHEMERIS, iodc=99, iode=99), None, None, 596790, 2190, 3)
    first, second, third = list_subframes(STREAM)[:3]
    new_one, new_two, new_three = list_subframes(newer)
    assert ephemeris_from_subframes(first, second, third, "G05", 2190) is not None
    assert ephemeris_from_subframes(new_one, second, third, "G05", 2190) is None
    assert ephemeris_from_subframes(first, new_two, third, "G05", 2190) is None
    assert ephemeris_from_subframes(first, second, new_three, "G05", 2190) is None
    with pytest.raises(ValueError, match="subframes 2, 1, 3 given"):
        ephemeris_from_subframes(second, first, third, "G05", 2190)


@pytest.mark.parametrize("wrong", [{"sqrt_a": 2000.0}, {"e": 0.4}, {"i0": 0.1}, {"omega_dot": 1e-8}])
def test_an_orbit_that_gps_cannot_fly_is_no_ephemeris(wrong: dict[str, float]):
    stream = encode_subframes(replace(EPHEMERIS, **wrong), None, None, 596760, 2190, 3)
    assert ephemeris_from_subframes(*list_subframes(stream), "G05", 2190) is None


# ---------------------------------------------------------------- finding


@given(st.integers(0, 700), st.sampled_from([0, 1]), st.integers(0, 2**32))
def test_subframes_are_found_at_any_start_and_polarity(cut, inverted, seed):
    noise = np.random.default_rng(seed).integers(0, 2, 137, dtype=np.int8)
    noise[-1] = 1 - STREAM[cut - 1] ^ inverted  # chance shall not mend the first subframe
    stream = np.concatenate([noise, STREAM[cut:] ^ inverted])
    first = -cut % 300 + 137
    assert find_subframes(stream) == list(range(first, stream.size - 59, 300))
    assert all(s.inverted == bool(inverted) for s in list_subframes(stream))


def test_a_damaged_subframe_costs_itself_only():
    stream = STREAM.copy()
    stream[645] ^= 1  # in the hand-over word of the third
    stream[1000] ^= 1  # in the body of the fourth
    starts = find_subframes(stream)
    assert starts == [0, 300, 900, 1200, 1500, 1800, 2100, 2400, 2700]
    assert [s is None for s in list_subframes(stream)] == [False, False, True, *[False] * 6]


def test_a_false_start_does_not_appear_beside_true_ones():
    stream = STREAM.copy()
    stream[400:460] = encode_subframes(EPHEMERIS, None, None, 12, 2190, 1)[:60]  # a perfect head in the wrong place
    assert 400 not in find_subframes(stream)
    whole = encode_subframes(EPHEMERIS, None, None, 12, 2190, 1)
    assert find_subframes(np.concatenate([whole, stream[283:]])) == list(range(317, 300 - 283 + 3000, 300))


def test_a_cut_subframe_still_gives_the_time():
    assert find_subframes(STREAM[:60]) == [0]
    assert find_subframes(STREAM[:59]) == []
    assert decode_how(STREAM[:60]).tow_s == 596760
    assert find_subframes(np.array([], dtype=np.int8)) == []


def test_noise_is_no_message():
    noise = np.random.default_rng(7).integers(0, 2, 100_000, dtype=np.int8)
    assert find_subframes(noise) == []  # expected by chance: 0.006
    assert decode_subframe(noise[:300]) is None


def test_a_stream_of_wrong_length_is_our_own_mistake():
    with pytest.raises(ValueError, match=r"\b299 bits .*\b300"):
        decode_subframe(SUBFRAME[:299])
