"""Codes that leave their carriers: one or some signals do, all alike or within a reflection's reach do not count."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.code_carrier.detector import CodeCarrier, CodeCarrierSettings
from skyproof.records import Cause, CellStatus, Records
from skyproof.testing import MeasuredScene, TrackErrors

RATE = 1e-6
ONE = {"rx1": (0.0, 0.0, 0.0)}
SCENE = MeasuredScene(antennas_enu_m=ONE, epochs=60, errors=TrackErrors(sigma_m=1.0, constant_m=1.0))


def change_cells(seed: int = 0, **changes) -> Records:
    """Return a clean minute with some cells changed: a function of the old values for each name."""
    records = SCENE.records(np.random.default_rng(seed))
    (o,) = records.observations
    return replace(records, observations=(replace(o, **{name: make(o) for name, make in changes.items()}),))


def drag_codes(columns: list[int], rate_m_s: float, start: int = 20):
    """Return codes that some signals' codes leave at a rate."""

    def make(o):
        codes_m = o.pseudorange_m.copy()
        since_s = np.maximum(o.elapsed_s - o.elapsed_s[start], 0.0)
        codes_m[:, columns] += rate_m_s * since_s[:, None]
        return codes_m

    return make


def examine(records: Records, window: int = 10) -> list:
    """Return the findings of windows of so many epochs."""
    detector, state, found = CodeCarrier(CodeCarrierSettings(false_alarm_probability=RATE)), None, []
    (o,) = records.observations
    for first in range(0, o.gpst.size, window):
        part = replace(records, observations=(o.read(first, first + window),))
        evidence, state = detector.examine(part, state)
        found += evidence
    return found


def list_failed(records: Records, window: int = 10) -> list[int]:
    return [k for k, e in enumerate(examine(records, window)) if e.failed]


@pytest.mark.parametrize("seed", range(4))
def test_a_clean_minute_is_clean(seed) -> None:
    found = examine(change_cells(seed))
    assert {(e.says, e.code, e.failed) for e in found} == {("clean", "together", False)}


def test_a_fast_drag_of_one_code_is_found_in_its_window() -> None:
    found = examine(change_cells(pseudorange_m=drag_codes([3], 38.0)))
    assert next(k for k, e in enumerate(found) if e.failed) == 2
    signal = SCENE._exact[0].signals[3]
    assert [ref.signal for ref in found[2].signals] == [signal]
    assert (found[2].code, found[2].says, found[2].overrules) == ("parted", "undecided", True)
    assert found[2].may_also_be == (Cause.REFLECTIONS, Cause.FAULT)
    assert found[2].data["worst"] == str(signal)
    assert found[2].data["change_m"] == pytest.approx(38.0 * found[2].data["time_s"], rel=0.1)


def test_a_slow_drag_is_found_once_it_is_beyond_reflections() -> None:
    assert list_failed(change_cells(pseudorange_m=drag_codes([3], 4.0)))[0] in (4, 5)
    assert list_failed(change_cells(pseudorange_m=drag_codes([3], 1.0))) == []


def test_dopplers_stand_for_carriers_that_are_missing() -> None:
    without = {"carrier_cyc": lambda o: np.full(o.carrier_cyc.shape, np.nan)}
    assert list_failed(change_cells(**without)) == []
    assert list_failed(change_cells(pseudorange_m=drag_codes([3], 38.0), **without))[0] == 2


def test_what_two_clocks_make_of_all_signals_does_not_count() -> None:
    every = list(range(len(SCENE._exact[0].signals)))
    assert list_failed(change_cells(pseudorange_m=drag_codes(every, 188.0, 0))) == []


def test_a_slip_is_no_divergence() -> None:
    def jump(o):
        cycles = o.carrier_cyc.copy()
        cycles[25:, 3] += 1e4
        return cycles

    def mark(o):
        status = o.status.copy()
        status[25, 3] = CellStatus.SLIP
        return status

    assert list_failed(change_cells(carrier_cyc=jump)) != []
    assert list_failed(change_cells(carrier_cyc=jump, status=mark)) == []


def test_reflections_come_and_go_within_a_quarter_of_a_chip() -> None:
    def reflect(o):
        rng = np.random.default_rng(5)
        codes_m = o.pseudorange_m.copy()
        for column in range(codes_m.shape[1]):
            codes_m[:, column] += 35.0 * np.sin(2 * np.pi * rng.uniform(0.005, 0.2) * o.elapsed_s + rng.uniform(0, 6))
        return codes_m

    assert list_failed(change_cells(pseudorange_m=reflect)) == []


def test_codes_alone_cannot_be_tested() -> None:
    none = {name: lambda o: np.full(o.carrier_cyc.shape, np.nan) for name in ("carrier_cyc", "doppler_hz")}
    found = examine(change_cells(**none))
    assert {(e.says, e.code, e.p_value) for e in found} == {("undecided", "no_carrier", None)}


def test_carriers_that_begin_anew_together_part_no_others() -> None:
    # All signals with a carrier slip at once, by any number of cycles; five have Dopplers alone.
    rng = np.random.default_rng(7)

    def carriers(o):
        cycles = o.carrier_cyc.copy()
        cycles[25:] += rng.integers(-(10**5), 10**5, cycles.shape[1])
        cycles[:, :5] = np.nan
        return cycles

    def status(o):
        slipped = o.status.copy()
        slipped[25, 5:] = CellStatus.SLIP
        return slipped

    assert list_failed(change_cells(carrier_cyc=carriers, status=status)) == []


def test_an_antenna_of_much_multipath_is_allowed_for() -> None:
    # A phone's code jumps by 110 m, a chip's quarter and two sigma and a half of 15 m of multipath.
    def codes(o):
        codes_m = o.pseudorange_m.copy()
        codes_m[25:, 3] += 110.0
        return codes_m

    records = change_cells(pseudorange_m=codes)
    found = {}
    for sigma_m in (1.0, 15.0):
        detector = CodeCarrier(CodeCarrierSettings(false_alarm_probability=RATE, multipath_sigma_m=sigma_m))
        (evidence,), _ = detector.examine(records)
        found[sigma_m] = evidence.failed
    assert found == {1.0: True, 15.0: False}
