"""Why a detector could not test: every reason that the code gives, made to happen, with the words that a user reads."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.detectors import nulls
from tests.detectors.own_fixes.test_detector import HOME, make_fixes

from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.ins_array import InsArray
from skyproof.detectors.array.spin import Spin
from skyproof.detectors.bands.detector import Bands
from skyproof.detectors.base import NEEDS
from skyproof.detectors.carrier_break.detector import CarrierBreak
from skyproof.detectors.code_carrier.detector import CodeCarrier
from skyproof.detectors.code_doppler.detector import CodeDoppler
from skyproof.detectors.code_motion.detector import CodeMotion
from skyproof.detectors.common_change.detector import CommonChange
from skyproof.detectors.correlators.beats_detector import Beats
from skyproof.detectors.correlators.sqm_detector import Sqm
from skyproof.detectors.correlators.vector_sqm_detector import VectorSqm
from skyproof.detectors.dccaf.detector import Dccaf
from skyproof.detectors.known_place.detector import CodesAtPlace, CodesAtPlaceSettings
from skyproof.detectors.messages.detector import BroadcastMessages
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.own_fixes.detector import OwnFixes
from skyproof.detectors.registry import load_detectors
from skyproof.detectors.residual import Residual, ResidualSettings
from skyproof.detectors.second_signals.detector import SecondSignals
from skyproof.detectors.torn.detector import Torn
from skyproof.explain import explain
from skyproof.records import NavigationData, Records
from skyproof.testing import FalseSky, MeasuredScene, TrackErrors

HERE = Path(__file__).parent
DETECTORS = HERE.parents[1] / "src" / "skyproof" / "detectors"
SCENE = {"antennas_enu_m": nulls.ONE, "errors": TrackErrors(1.0, constant_m=1.0), "epochs": 10}
BOTH = {"rx1": (0.0, 0.0, 0.0), "rx2": (40.0, 0.0, 0.0)}


def make_rng():
    return np.random.default_rng(5)


def clean(**changes):
    return MeasuredScene(**(SCENE | changes)).records(make_rng())


def change_cells(records, number=0, **cells):
    """Change these cells of a receiver's observations by functions of them."""
    observations = list(records.observations)
    o = observations[number]
    observations[number] = replace(o, **{name: change(o) for name, change in cells.items()})
    return replace(records, observations=tuple(observations))


def drop_all(o):
    return np.full(o.status.shape, np.nan)


STANDING = CodesAtPlaceSettings(speed_max_m_s=0.0)
AT_PLACE = CodesAtPlaceSettings(positions_ecef_m={"rx1": np.array([3e6, 1e6, 5.5e6])})


def rename_signals(records, names):
    """Give the signals other names, which are in no set."""
    (o,) = records.observations
    return replace(records, observations=(replace(o, signals=tuple(names(o.signals))),), sets=())


def keep_orbits(records, count):
    """Keep the orbits of so many satellites."""
    sats = [signal.sat for signal in records.observations[0].signals][:count]
    known = tuple(e for e in records.navigation.ephemerides if e.sat in sats)
    return replace(records, navigation=replace(records.navigation, ephemerides=known))


def shift_time(records, seconds):
    """Move the same receiver's records to so much later."""
    by = np.timedelta64(round(seconds * 1e9), "ns")
    observations = tuple(replace(o, gpst=o.gpst + by, elapsed_s=o.elapsed_s + seconds) for o in records.observations)
    return replace(
        records, start_gpst=records.start_gpst + by, end_gpst=records.end_gpst + by, observations=observations
    )


def change_taps(change, kind="taps", records=None):
    records = nulls.take_looks(make_rng()) if records is None else records
    (taps,) = getattr(records, kind)
    return replace(records, **{kind: (change(taps),)})


def drop_channels(taps, kept):
    value = taps.value.copy()
    value[:, kept:] = np.nan
    return replace(taps, value=value)


def add_chance_set():
    """Add a second set of five signals, which unrelated ones make by chance."""
    records = clean(false=(FalseSky(),))
    sky, false = records.sets
    return replace(records, sets=(sky, replace(false, signals=false.signals[:5], statistic=1.0, dof=1)))


def keep_one_satellite():
    """Keep channels of a vector receiver so that only one satellite's last through the window."""
    records = nulls.draw_vector_taps(make_rng())
    (o,), (taps,) = records.observations, records.vector_taps
    rows = [0] * 5 + list(range(1, len(o.signals)))
    signals = tuple(replace(o.signals[0], copy="abcde"[k]) for k in range(5)) + o.signals[1:]
    cells = {
        name: value[:, rows] for name, value in vars(o).items() if isinstance(value, np.ndarray) and value.ndim == 2
    }
    channels = {name: getattr(o, name)[rows] for name in ("found_elapsed_s", "missed_elapsed_s", "carrier_hz")}
    value = taps.value[:, rows].copy()
    value[:, 5:] = np.nan
    return replace(
        records,
        observations=(replace(o, signals=signals, **cells, **channels),),
        vector_taps=(replace(taps, signals=signals, value=value),),
    )


def make_grids(satellites):
    records = nulls.draw_ccaf(nulls.CLEAN_CCAF.records(make_rng()), make_rng())
    (grid,) = records.ccaf
    value = np.array(grid.value)
    value[:, satellites:] = np.nan
    return replace(records, ccaf=(replace(grid, value=value),))


def change_phases(change, directions=None):
    directions = nulls.draw_directions(make_rng(), 6) if directions is None else directions
    return nulls.make_window(change(nulls.draw_array_phases(make_rng(), directions, side=1.0)))


def keep_one_antenna(phases):
    phase = phases.phase_cyc.copy()
    phase[..., 1:] = np.nan
    return replace(phases, phase_cyc=phase)


def make_turning(n=150, signals=8, bent=0):
    level = nulls.draw_directions(make_rng(), signals)[:, :2]
    records = nulls.draw_spin_records(make_rng(), level, n=n)
    (o,) = records.observations
    carrier = o.carrier_cyc.copy()
    carrier[:, :bent] += 0.2 * np.sin(2.0 * np.pi * 0.37 * o.elapsed_s)[:, None]
    return replace(records, observations=(replace(o, carrier_cyc=carrier),))


def open_delays():
    """Make second signals that have no range yet."""
    n = nulls.ECHOING
    records = nulls.draw_second_signals(make_rng(), np.ones(n, bool))
    unknown = np.arange(2 * n) >= n
    return change_cells(records, pseudorange_m=lambda o: np.where(unknown, np.nan, o.pseudorange_m))


def make_pair(**changes):
    return clean(antennas_enu_m=BOTH, **changes)


def list_sets(records, *changes):
    return replace(records, sets=tuple(change(chosen) for change, chosen in zip(changes, records.sets, strict=True)))


def keep_records(first, stop):
    return lambda one: replace(one, signals=one.signals[first:stop])


def examine_second(detector, first, second):
    """Examine two windows and return the findings of the second."""
    _, state = detector.examine(first)
    return detector.examine(second, state)[0]


def examine_all(detector, records):
    return detector.examine(records)[0]


CASES = {
    ("residual", "no_epochs"): (
        lambda: examine_all(Residual(), replace(r := clean(), observations=(r.observations[0].read(0, 0),), sets=())),
        "no epoch of rx1 lies in the window",
    ),
    ("residual", "few_ranges"): (
        lambda: examine_all(Residual(), clean(max_satellites=4)),
        "4 satellites in rx1 have pseudo",
    ),
    ("residual", "few_orbits"): (lambda: examine_all(Residual(), keep_orbits(clean(), 3)), "the orbits of 3 of"),
    ("residual", "few_above_mask"): (
        lambda: examine_all(Residual(ResidualSettings(elevation_mask_deg=75.0)), clean()),
        "stand above the elevation mask of 75 degrees",
    ),
    ("residual", "no_position"): (
        lambda: examine_all(
            Residual(),
            rename_signals(clean(max_satellites=5), lambda own: (*own[:3], *(replace(s, code="1C") for s in own[3:]))),
        ),
        "the 5 satellites in rx1 give no position",
    ),
    ("residual", "sets_by_chance"): (
        lambda: examine_all(Residual(), add_chance_set()),
        "unrelated signals can do so",
    ),
    ("dccaf", "few_grids"): (
        lambda: examine_all(Dccaf(), make_grids(4)),
        "4 satellites in rx1 have whole correlation grids",
    ),
    ("sqm", "no_pair"): (
        lambda: examine_all(Sqm(), change_taps(lambda t: replace(t, delays_chips=t.delays_chips + 0.01))),
        "no pair of correlators symmetric",
    ),
    ("sqm", "few_looks"): (
        lambda: examine_all(Sqm(), nulls.take_looks(make_rng(), n=60)),
        "60 outputs of the correlators of rx1",
    ),
    ("sqm", "few_signals"): (
        lambda: examine_all(Sqm(), change_taps(lambda t: drop_channels(t, 3))),
        "3 signals of rx1 were tracked without a break",
    ),
    ("sqm", "several_of_a_satellite"): (
        lambda: examine_all(
            Sqm(),
            change_taps(lambda t: replace(t, signals=(*t.signals[:5], *(replace(s, copy="b") for s in t.signals[:5])))),
        ),
        "0 of 5 satellites in rx1 have only one signal",
    ),
    ("beats", "few_signals"): (
        lambda: examine_all(Beats(), nulls.track(change_cells(clean(), pseudorange_m=drop_all))),
        "fewer than 6 signals of rx1 have correlators and a direction",
    ),
    ("vector_sqm", "no_pair"): (
        lambda: examine_all(
            VectorSqm(),
            change_taps(
                lambda t: replace(t, delays_chips=np.array([0.4, 0.0, -0.5])),
                "vector_taps",
                nulls.draw_vector_taps(make_rng()),
            ),
        ),
        "no early and late correlators within a chip",
    ),
    ("vector_sqm", "no_position"): (
        lambda: examine_all(VectorSqm(), change_cells(nulls.draw_vector_taps(make_rng()), pseudorange_m=drop_all)),
        "have ranges and orbits, so there is no position",
    ),
    ("vector_sqm", "few_satellites"): (
        lambda: examine_all(
            VectorSqm(), change_taps(lambda t: drop_channels(t, 4), "vector_taps", nulls.draw_vector_taps(make_rng()))
        ),
        "4 satellites in rx1 were tracked together",
    ),
    ("vector_sqm", "weak_geometry"): (
        lambda: examine_all(VectorSqm(), keep_one_satellite()),
        "5 signals in rx1 give no position",
    ),
    ("vector_sqm", "few_looks"): (
        lambda: examine_all(VectorSqm(), nulls.draw_vector_taps(make_rng(), n=12)),
        "the 8 channels of rx1 have 12 common outputs",
    ),
    ("array_common", "few_antennas"): (
        lambda: examine_all(ArrayCommon(), change_phases(keep_one_antenna)),
        "fewer than two antennas of rx1 give phases",
    ),
    ("array_common", "few_signals"): (
        lambda: examine_all(ArrayCommon(), change_phases(lambda p: p, nulls.draw_directions(make_rng(), 1))),
        "1 signals make no pair",
    ),
    ("array_common", "directions_near"): (
        lambda: examine_all(
            ArrayCommon(ArrayCommonSettings(1e-6)), change_phases(lambda p: p, nulls.draw_one_direction(make_rng(), 2))
        ),
        "are too close to tell apart",
    ),
    ("array_common", "two_skies"): (
        lambda: examine_all(ArrayCommon(), replace(change_phases(lambda p: p), sets=clean(false=(FalseSky(),)).sets)),
        "but they form two skies",
    ),
    ("ins_array", "few_antennas"): (
        lambda: examine_all(
            InsArray(),
            replace(r := nulls.draw_array_records(make_rng()), array_phases=(keep_one_antenna(r.array_phases[0]),)),
        )[1:],  # after the antennas that are left out
        "fewer than two antennas of rx1 give phases",
    ),
    ("ins_array", "no_place"): (
        lambda: examine_all(InsArray(), replace(nulls.draw_array_records(make_rng()), nav_state={})),
        "the place of rx1 is not known",
    ),
    ("ins_array", "no_signal"): (
        lambda: examine_all(
            InsArray(), replace(nulls.draw_array_records(make_rng()), navigation=NavigationData(ephemerides=()))
        ),
        "no signal of rx1 is on all antennas while its orbit",
    ),
    ("spin", "no_arm"): (
        lambda: examine_all(Spin(), replace(make_turning(), spin_arms=(replace(nulls.ARM, receiver="rx2"),))),
        "the window has no receiver on an arm",
    ),
    ("spin", "few_signals"): (
        lambda: examine_all(Spin(), make_turning(signals=1)),
        "1 signals of rx1 have an unbroken phase",
    ),
    ("spin", "few_epochs"): (lambda: examine_all(Spin(), make_turning(n=5)), "5 epochs of rx1 are too few"),
    ("spin", "phases_bent"): (lambda: examine_all(Spin(), make_turning(bent=2)), "each fit no single direction"),
    ("second_signals", "no_cn0"): (
        lambda: examine_all(SecondSignals(), change_cells(clean(), cn0_dbhz=drop_all)),
        "rx1 gives no C/N0",
    ),
    ("second_signals", "few_satellites"): (
        lambda: examine_all(SecondSignals(), clean(max_satellites=1)),
        "1 satellites with a signal of",
    ),
    ("second_signals", "delay_unknown"): (
        lambda: examine_all(SecondSignals(), open_delays()),
        "the delay between the two signals of",
    ),
    ("common_change", "few_satellites"): (
        lambda: examine_all(CommonChange(), clean(max_satellites=4)),
        "fewer than two epochs of rx1 have 5 satellites",
    ),
    ("common_change", "first_window"): (
        lambda: examine_all(CommonChange(), clean()),
        "this is the first window of rx1",
    ),
    ("common_change", "nothing_shared"): (
        lambda: examine_second(
            CommonChange(),
            bare := change_cells(clean(), cn0_dbhz=drop_all, carrier_cyc=drop_all),
            shift_time(bare, 10.0),
        ),
        "have code and carrier both now and in earlier windows",
    ),
    ("code_motion", "received_twice"): (
        lambda: examine_all(CodeMotion(), clean(false=(FalseSky(),))),
        "rx1 receives a satellite twice",
    ),
    ("code_motion", "few_fixes"): (
        lambda: examine_all(CodeMotion(), clean(max_satellites=4)),
        "fewer than 3 epochs of rx1 have a position",
    ),
    ("own_fixes", "few_own_fixes"): (
        lambda: examine_all(OwnFixes(), replace(clean(), own_fixes={"rx1": make_fixes([0.0, 1.0], [HOME, HOME])})),
        "rx1 gives fewer than 3 fixes of its own",
    ),
    ("messages", "no_message"): (
        lambda: examine_all(BroadcastMessages(), replace(clean(), sets=())),
        "rx1 gives no broadcast message",
    ),
    ("known_place", "no_place"): (lambda: examine_all(CodesAtPlace(), clean()), "the place of rx1 is not known"),
    ("known_place", "fixed"): (
        lambda: examine_all(CodesAtPlace(STANDING), clean()),
        "the satellites of rx1 give a position, which other tests check",
    ),
    ("known_place", "received_twice"): (
        lambda: examine_all(CodesAtPlace(AT_PLACE), replace(clean(false=(FalseSky(),)), sets=())),
        "rx1 receives no satellite, or one twice",
    ),
    ("known_place", "few_satellites"): (
        lambda: examine_all(CodesAtPlace(AT_PLACE), replace(keep_orbits(clean(), 2), sets=())),
        "fewer than 3 satellites at any epoch of rx1 have codes and orbits",
    ),
    ("torn", "received_twice"): (
        lambda: examine_all(Torn(), clean(false=(FalseSky(),))),
        "rx1 receives a satellite twice",
    ),
    ("bands", "one_band"): (lambda: examine_all(Bands(), clean()), "satellites of rx1 have codes of two bands"),
    ("code_carrier", "no_carrier"): (
        lambda: examine_all(CodeCarrier(), change_cells(clean(), carrier_cyc=drop_all, doppler_hz=drop_all)),
        "signals of rx1 have code and carrier, or Doppler",
    ),
    ("carrier_break", "no_carriers"): (
        lambda: examine_all(CarrierBreak(), nulls.track(change_cells(clean(), carrier_cyc=drop_all))),
        "rx1 has no carrier phases",
    ),
    ("code_doppler", "few_epochs"): (
        lambda: examine_all(CodeDoppler(), nulls.track(change_cells(clean(), doppler_hz=drop_all))),
        "no signal of rx1 has code and Doppler in 8 epochs",
    ),
    ("multi_receiver", "one_set"): (
        lambda: examine_all(MultiReceiver(), replace(r := make_pair(), sets=r.sets[:1])),
        "no five signals of rx2 fit one position",
    ),
    ("multi_receiver", "few_in_common"): (
        lambda: examine_all(MultiReceiver(), list_sets(make_pair(), keep_records(0, 6), keep_records(3, 9))),
        "3 satellites are in the consistent sets of rx1 and rx2 alike, and 5 are needed",
    ),
    ("multi_receiver", "few_common_epochs"): (
        lambda: examine_all(MultiReceiver(), change_cells(make_pair(), 1, pseudorange_m=drop_all)),
        "no 5 signals of one kind are in rx1 and rx2 over",
    ),
    ("multi_receiver", "sets_by_chance"): (
        lambda: examine_all(MultiReceiver(), make_chance_receivers()),
        "which is true was not decided",
    ),
}


def make_chance_receivers():
    """Make receivers, one with a second set that chance makes."""
    records = make_pair(false=(FalseSky(receivers=("rx2",)),))
    *sky, false = records.sets
    return replace(records, sets=(*sky, replace(false, signals=false.signals[:5], statistic=1.0, dof=1)))


@pytest.mark.parametrize(("name", "code"), CASES, ids=[" ".join(case) for case in CASES])
def test_a_reason_is_given_where_it_holds(name, code):
    make, words = CASES[name, code]
    found = [e for e in make() if e.code]
    assert [(e.detector, e.says, e.code, e.p_value) for e in found] == [(name, "undecided", code, None)]
    assert words in explain(found[0]).sentence
    assert explain(found[0]).remedy


def list_reasons(path):
    """List the codes that a module states, and its calls of `undecided` without any."""
    codes, without = set[str](), list[int]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        name = getattr(node.func, "attr", getattr(node.func, "id", "")) if isinstance(node, ast.Call) else ""
        if name not in ("undecided", "Untested", "NotTested"):
            continue
        stated = {word.arg: word.value for word in node.keywords}
        code = node.args[0] if name in ("Untested", "NotTested") and node.args else stated.get("code")
        if isinstance(code, ast.Constant):
            codes.add(code.value)
        if name == "undecided" and not {"code", None} & stated.keys():  # None: a reason's fields
            without.append(node.lineno)
    return codes, without


def read_part(part):
    """Read the code of a part of the detectors."""
    files = (DETECTORS / part).rglob("*.py") if (DETECTORS / part).is_dir() else [DETECTORS / f"{part}.py"]
    return "".join(path.read_text(encoding="utf-8") for path in files)


def read_tests(part):
    """Read the tests of a part of the detectors, without the cases here."""
    files = (HERE / part).rglob("*.py") if (HERE / part).is_dir() else HERE.glob(f"test_{part}.py")
    return "".join(path.read_text(encoding="utf-8") for path in files)


def test_no_reason_in_the_code_is_without_a_test():
    for path in DETECTORS.rglob("*.py"):
        codes, without = list_reasons(path)
        assert not without, f"{path}: lines {without} give no code"
        part = path.relative_to(DETECTORS).parts[0].removesuffix(".py")
        detectors = {name for name, _ in CASES if re.search(f'    name = "{name}"', read_part(part))}
        untested = {code for code in codes if not any((name, code) in CASES for name in detectors)}
        untested = {code for code in untested if f'"{code}"' not in read_tests(part)}
        assert not untested, f"{path}: no test holds {untested}"


@pytest.mark.parametrize("name", sorted(load_detectors()))
def test_what_is_not_there_is_named_with_what_gives_it(name):
    detector = load_detectors()[name]()
    (found,) = detector.examine(Records(start_gpst=nulls.START, end_gpst=nulls.START))[0]
    assert found.code == "_".join(("without", *detector.needs))
    assert found.lacking == detector.needs
    assert explain(found).remedy == "; ".join(NEEDS[need] for need in detector.needs)
