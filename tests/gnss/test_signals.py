import numpy as np
import pytest

from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, prn_of, sat_name, service_of


def test_the_signal_is_described_in_one_place():
    assert GPS_L1_CA.code(7).shape == (GPS_L1_CA.code_length,)
    assert GPS_L1_CA.period_s == pytest.approx(1e-3, abs=1e-18)
    assert GPS_L1_CA.carrier_hz / GPS_L1_CA.chip_rate_hz == 1540.0  # IS-GPS-200N, 3.3.1.1: both from 10.23 MHz
    assert np.isclose(GPS_L1_CA.period_s * GPS_L1_CA.periods_per_symbol, GPS_L1_CA.symbol_s)


def test_names_and_numbers_of_satellites_agree():
    assert [prn_of(sat) for sat in GPS_SATS] == list(range(1, 33))
    assert tuple(sat_name(prn) for prn in range(1, 33)) == GPS_SATS
    assert prn_of("G5") == 5


@pytest.mark.parametrize("sat", ["G00", "G33", "E05", "5", "", "G005", "g05"])
def test_a_name_that_is_no_gps_satellite_is_refused(sat):
    with pytest.raises(ValueError, match="is not a GPS satellite"):
        prn_of(sat)


@pytest.mark.parametrize("prn", [0, 33])
def test_a_number_that_is_no_gps_satellite_is_refused(prn):
    with pytest.raises(ValueError, match="is not a GPS satellite"):
        sat_name(prn)


def test_codes_of_one_signal_are_one_service_and_others_are_not():
    assert service_of("E1", "C") == service_of("E1", "X") == service_of("E1", "B")
    assert service_of("L2", "L") == service_of("L2", "X")
    assert service_of("L2", "W") != service_of("L2", "L")
    assert service_of("L1", "CA") != service_of("L1", "X")
    assert service_of("B1C", "1P") == service_of("B1C", "1X")
    assert service_of("E1", "A") not in (service_of("E1", "C"), service_of("E1", "Z"))
