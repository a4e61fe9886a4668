"""Selecting rows of records: every field that has them, and no other."""

from dataclasses import fields, replace

import numpy as np
import pytest

from skyproof.gnss.time import GPS_EPOCH
from skyproof.records import (
    ArrayPhases,
    Channels,
    Fix,
    FrontEndLevels,
    ImuSeries,
    NavState,
    Observations,
    ReceiverFixes,
    Selectable,
    SignalId,
    Taps,
)

N, K = 7, 2  # epochs, and signals: no other size is 7
SIGNALS = (SignalId("G01"), SignalId("G02"))
GPST = GPS_EPOCH + np.arange(N).astype("timedelta64[s]")
SECONDS = np.arange(N, dtype=float)


def list_numbers(*shape):
    return np.arange(np.prod((N, *shape)), dtype=float).reshape(N, *shape)


CELLS = ("pseudorange_m", "carrier_cyc", "doppler_hz", "cn0_dbhz")
SIGMAS = ("pseudorange_sigma_m", "carrier_sigma_cyc", "doppler_sigma_hz")
LEVELS = ("agc_db", "agc_share", "noise_db", "jamming_share")
OF_FIXES = ("horizontal_sigma_m", "vertical_sigma_m", "clock_bias_s", "clock_drift")
RECORDS = [
    Observations(
        receiver="rx",
        signals=SIGNALS,
        gpst=GPST,
        elapsed_s=SECONDS,
        status=np.zeros((N, K), np.uint8),
        found_elapsed_s=np.zeros(K),
        missed_elapsed_s=np.zeros(K),
        **{name: list_numbers(K) for name in (*CELLS, *SIGMAS)},
    ),
    Taps(
        receiver="rx",
        signals=SIGNALS,
        elapsed_s=SECONDS,
        delays_chips=np.zeros(3),
        dopplers_hz=np.zeros(1),
        value=list_numbers(K, 1, 3).astype(np.complex64),
        first_power=list_numbers(K),
    ),
    ArrayPhases(
        receiver="rx",
        signals=SIGNALS,
        gpst=GPST,
        elapsed_s=SECONDS,
        elements_m=np.zeros((3, 3)),
        phase_cyc=list_numbers(K, 3),
        sigma_cyc=list_numbers(K, 3),
    ),
    FrontEndLevels(gpst=GPST, band=np.full(N, "L1"), **{name: list_numbers() for name in LEVELS}),
    ReceiverFixes(
        gpst=GPST,
        position_ecef_m=list_numbers(3),
        velocity_ecef_m_s=list_numbers(3),
        satellites=np.arange(N),
        **{name: list_numbers() for name in OF_FIXES},
    ),
    ImuSeries(gpst=GPST, interval_s=0.1, specific_force_m_s2=list_numbers(3), angular_rate_rad_s=list_numbers(3)),
    NavState(
        gpst=GPST,
        position_ecef_m=list_numbers(3),
        velocity_ecef_m_s=list_numbers(3),
        attitude=list_numbers(3, 3),
        covariance=list_numbers(9, 9),
    ),
    NavState(
        gpst=GPST, position_ecef_m=list_numbers(3), velocity_ecef_m_s=list_numbers(3), attitude=list_numbers(3, 3)
    ),
    Fix(
        receiver="rx",
        signals=SIGNALS,
        gpst=GPST,
        position_ecef_m=list_numbers(3),
        velocity_ecef_m_s=list_numbers(3),
        clock_bias_s=list_numbers(),
        clock_drift=list_numbers(),
        covariance_m2=list_numbers(4, 4),
        residual_m=list_numbers(K),
        status=np.zeros(N, np.uint8),
        inter_system_s={"E": list_numbers()},
    ),
]


def list_parts(record):
    """List what a record holds by name, with mappings opened."""
    for field in fields(record):
        value = getattr(record, field.name)
        yield from value.items() if isinstance(value, dict) else [(field.name, value)]


@pytest.mark.parametrize("rows", [slice(2, 5), np.array([4, 1, 1]), np.arange(N) % 2 == 0], ids=["slice", "at", "mask"])
@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_selected_rows_are_those_of_every_field(record, rows):
    for (name, whole), (_, part) in zip(list_parts(record), list_parts(record.select(rows)), strict=True):
        has_rows = isinstance(whole, np.ndarray) and whole.ndim and len(whole) == N
        np.testing.assert_array_equal(part, whole[rows] if has_rows else whole, err_msg=name)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: type(record).__name__)
def test_between_has_its_begin_and_not_its_end(record):
    time = getattr(record, record.TIME)
    np.testing.assert_array_equal(getattr(record.select_between(time[2], time[5]), record.TIME), time[2:5])


def test_every_record_that_can_be_selected_is_tried():
    selectable = {kind for kind in Selectable.__subclasses__() if kind.__module__.startswith("skyproof.records")}
    assert selectable == {type(record) for record in RECORDS}


def test_selected_channels_are_those_of_every_field():
    whole = RECORDS[0]
    part = whole.select_channels(np.array([1]))
    assert part.signals == SIGNALS[1:]
    for name in (*CELLS, *SIGMAS, "status", "half_cycle_open", "quadrature_m"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:, 1:])


@pytest.mark.parametrize("record", [r for r in RECORDS if isinstance(r, Channels)], ids=lambda r: type(r).__name__)
def test_each_array_of_channels_is_among_those_that_are_selected(record):
    part = record.select_channels(np.array([1]))
    assert part.signals == record.signals[1:]
    for name in (*record.CELLS, *record.OF_CHANNELS):
        whole = np.asarray(getattr(record, name))
        np.testing.assert_array_equal(getattr(part, name), whole[:, 1:] if name in record.CELLS else whole[1:])


def test_an_array_that_is_not_there_stays_so():
    taps = next(record for record in RECORDS if isinstance(record, Taps))
    alone = replace(taps, first_power=None)
    assert alone.select_channels(np.array([1])).first_power is None
    assert alone.select(slice(1)).first_power is None
