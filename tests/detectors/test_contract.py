"""Each detector meets the contract of `skyproof.testing`, false alarms at the stated rate included."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

import numpy as np
import pytest
from tests.detectors import nulls
from tests.detectors.bands.test_detector import make_two_bands
from tests.detectors.carrier_break.test_carrier_break import SCENE as BROKEN
from tests.detectors.carrier_break.test_carrier_break import break_all
from tests.detectors.correlators.test_beats import beat
from tests.detectors.own_fixes.test_detector import HOME, make_fixes

from skyproof.detectors.array.array_common import ArrayCommon, ArrayCommonSettings
from skyproof.detectors.array.ins_array import InsArray
from skyproof.detectors.array.spin import Spin, SpinSettings
from skyproof.detectors.bands.detector import Bands, BandsSettings
from skyproof.detectors.base import Detector
from skyproof.detectors.carrier_break.detector import CarrierBreak, CarrierBreakSettings
from skyproof.detectors.code_carrier.detector import CodeCarrier, CodeCarrierSettings
from skyproof.detectors.code_doppler.detector import CodeDoppler, CodeDopplerSettings
from skyproof.detectors.code_motion.detector import CodeMotion, CodeMotionSettings
from skyproof.detectors.common_change.detector import CommonChange, CommonChangeSettings
from skyproof.detectors.continuity.detector import Continuity, ContinuitySettings
from skyproof.detectors.correlators.beats_detector import Beats, BeatsSettings
from skyproof.detectors.correlators.sqm_detector import Sqm, SqmSettings
from skyproof.detectors.correlators.vector_sqm_detector import VectorSqm, VectorSqmSettings
from skyproof.detectors.dccaf.delays import DccafSettings
from skyproof.detectors.dccaf.detector import Dccaf
from skyproof.detectors.known_place.detector import CodesAtPlace, CodesAtPlaceSettings
from skyproof.detectors.levels.detector import SignalLevels, SignalLevelsSettings
from skyproof.detectors.messages.detector import BroadcastMessages, BroadcastMessagesSettings
from skyproof.detectors.multi_receiver.detector import MultiReceiver
from skyproof.detectors.multi_receiver.settings import MultiReceiverSettings
from skyproof.detectors.own_fixes.detector import OwnFixes, OwnFixesSettings
from skyproof.detectors.prediction.choice import Prediction
from skyproof.detectors.prediction.inertia import Inertia, InertiaSettings
from skyproof.detectors.prediction.place import StatedPlace, StatedPlaceSettings
from skyproof.detectors.registry import load_detectors
from skyproof.detectors.residual import Residual, ResidualSettings
from skyproof.detectors.second_signals.detector import SecondSignals, SecondSignalsSettings
from skyproof.detectors.snapshot.detector import Snapshots
from skyproof.detectors.torn.detector import Torn, TornSettings
from skyproof.gnss.frames import ecef_from_geodetic
from skyproof.gnss.imu_grades import GRADES
from skyproof.gnss.oscillators import OSCILLATORS
from skyproof.gnss.time import GPS_EPOCH
from skyproof.navigation.inertial_predictor import Inertial
from skyproof.navigation.ins import InsSettings
from skyproof.navigation.predictor import Standing, place_surveyed
from skyproof.records import (
    Cause,
    Finding,
    Hypothesis,
    ImuSeries,
    Records,
    SnapshotChange,
    SnapshotChanges,
    list_refs,
)
from skyproof.testing import ALARMS, FalseSky, MeasuredScene, TrackErrors, check_detector, check_false_alarms

CAPTURED = MeasuredScene(sky=(), false=(FalseSky(),), epochs=8, errors=TrackErrors(1.0))
CLEAN = MeasuredScene(epochs=4, errors=TrackErrors(1.0, constant_m=1.0))
PLACES = {"rx1": (0.0, 0.0, 0.0), "rx2": (40.0, 0.0, 0.0)}
ECHOING = MeasuredScene(
    antennas_enu_m=PLACES,
    false=(FalseSky(shows_enu_m=(0.0, 0.0, 0.0)),),
    epochs=4,
    errors=TrackErrors(1.0, constant_m=1.0),
    max_satellites=10,
)
AUTHENTIC = ("authentic",)


@dataclass(frozen=True)
class Case:
    """A detector, the null hypothesis of its alarms, and in how many windows to count them: fast, and long.

    conservative : why its alarms are rarer than stated; None where its p-value is exact, and is counted on both sides.
    """

    about: str
    make: Callable[[], Detector]
    null: Callable[[np.random.Generator], Records]
    windows: int
    long: int
    alarms: Collection[str] = ALARMS
    conservative: str | None = None


def draw_fixes(rng: np.random.Generator) -> Records:
    """Draw records of a receiver that gives its own fixes too."""
    records = CLEAN.records(rng)
    return replace(records, own_fixes={"rx1": make_fixes(np.arange(10.0), HOME + rng.normal(0.0, 10.0, (10, 3)))})


ALONE = MeasuredScene(antennas_enu_m={"rx1": (0.0, 0.0, 0.0)}, epochs=4, errors=TrackErrors(1.0, constant_m=1.0))
LAT_DEG, LON_DEG, HEIGHT_M = ALONE.place_deg
HOME_ECEF_M = {"rx1": ecef_from_geodetic(np.radians(LAT_DEG), np.radians(LON_DEG), HEIGHT_M)}


def draw_few_satellites(rng: np.random.Generator) -> Records:
    """Draw records of five satellites without a position."""
    records = ALONE.records(rng)
    (o,) = records.observations
    codes_m = o.pseudorange_m.copy()
    codes_m[:, rng.permutation(codes_m.shape[1])[5:]] = np.nan
    return replace(records, observations=(replace(o, pseudorange_m=codes_m),), sets=())


def find_before(records: Records) -> Records:
    """Return records in which another test found nothing."""
    (o,) = records.observations
    nothing = Finding(
        detector="none",
        start_gpst=records.start_gpst,
        end_gpst=records.end_gpst,
        signals=list_refs(o.receiver, o.signals),
        hypothesis=Hypothesis.CONTINUOUS,
        code="nothing",
    )
    return replace(records, findings=(nothing,))


def draw_standing(rng: np.random.Generator) -> Records:
    """Draw records of a receiver that stands where it was surveyed."""
    stands = Standing(stands=True, oscillator=None, by=("standing",), assumes=("receiver_stands",))
    at_home = place_surveyed(stands, HOME_ECEF_M["rx1"], 0.01 * np.eye(3))
    return replace(find_before(ALONE.records(rng)), standing={"rx1": at_home})


def draw_two_false_skies(rng: np.random.Generator) -> Records:
    """Draw records of a receiver that stands elsewhere than either of its skies shows, under an attack."""
    records = draw_standing(rng)
    (true,) = records.sets
    middle = len(true.signals) // 2
    sets = tuple(
        replace(true, signals=signals, position_ecef_m=true.position_ecef_m + rng.normal(0.0, 1e4, 3))
        for signals in (true.signals[:middle], true.signals[middle:])
    )
    attack = tuple(replace(e, p={Cause.CLEAN: 1e-9}, alpha=1e-3) for e in records.findings)
    return replace(records, sets=sets, findings=attack, expected=records.standing)


def move_receiver(rng: np.random.Generator) -> Records:
    """Draw records of a receiver with an inertial unit and no stated attitude."""
    readings = ImuSeries(
        gpst=GPS_EPOCH + np.arange(3) * np.timedelta64(1, "s"),
        interval_s=1.0,
        specific_force_m_s2=np.tile([0.0, 0.0, -9.8], (3, 1)),
        angular_rate_rad_s=np.zeros((3, 3)),
    )
    unit = Inertial(
        readings=readings,
        settings=InsSettings(grade=GRADES["tactical"], oscillator=OSCILLATORS["tcxo"]),
        initial=None,
        clock=False,
        by=("inertial_unit",),
    )
    return replace(find_before(ALONE.records(rng)), inertial={"rx1": unit})


def draw_snapshots(rng: np.random.Generator) -> Records:
    """Draw records of a snapshot; once in ten its receiver reports a change."""
    records = ALONE.records(rng)
    (o,) = records.observations
    p_value = rng.uniform()
    change = SnapshotChange(
        signal=o.signals[0], kind="begins", gpst=o.gpst[1], after_s=1.0, p_value=p_value / len(o.signals)
    )
    changes = SnapshotChanges(
        signals=o.signals, changes=(change,) if p_value < 0.1 else (), chance=0.1 / len(o.signals)
    )
    return replace(records, changes={"rx1": changes})


class NotOneAntenna(MultiReceiver):
    """Says "authentic" as soon as "one antenna" is rejected, whatever is known of the antennas."""

    def examine(self, records, state=None):
        findings, state = super().examine(records, state)
        p_values = [e.data.get("p_one_antenna") for e in findings]
        return [
            e if p is None else replace(e, p={Cause.FALSE_SKY: p}) for e, p in zip(findings, p_values, strict=True)
        ], state


def make_white(rate: float) -> MultiReceiver:
    """Turn off the allowance for noise that is not white, so that too few false alarms are a fault as well."""
    return NotOneAntenna(
        MultiReceiverSettings(
            false_alarm_probability=rate, multipath_sigma_m=0.0, correlation_max=0.0, error_bound_m=np.inf
        )
    )


CASES = (
    Case("one antenna, white noise", lambda: make_white(0.1), CAPTURED.records, 1000, 10_000, AUTHENTIC),
    Case(
        "one antenna, as it comes",
        MultiReceiver,
        CAPTURED.records,
        50,
        1000,
        AUTHENTIC,
        "allows for correlated noise and constant errors that these records do not have",
    ),
    Case(
        "a true sky, as it comes",
        lambda: MultiReceiver(MultiReceiverSettings(false_alarm_probability=0.01)),
        CLEAN.records,
        50,
        1000,
        conservative="the antennas are farther apart than it was given",
    ),
    Case(
        "a true sky with echoes, antennas known",
        lambda: MultiReceiver(MultiReceiverSettings(false_alarm_probability=0.01, antennas_enu_m=PLACES)),
        lambda rng: nulls.draw_echoes(rng, ECHOING),
        50,
        2000,
        conservative="most satellites have no second signal, and tests share the rate",
    ),
    Case(
        "echoes",
        lambda: SecondSignals(SecondSignalsSettings(false_alarm_probability=0.02)),
        nulls.draw_echoes,
        400,
        20_000,
        conservative="most satellites have no second signal, which is less than a p-value of 1 says",
    ),
    Case(
        "one sky: RAIM",
        lambda: Residual(ResidualSettings(false_alarm_probability=0.1, ionosphere_share=0.0)),
        CLEAN.records,
        80,
        2000,
    ),
    Case(
        "unrelated second signals",
        lambda: Residual(ResidualSettings(false_alarm_probability=0.3, unrelated_spread_m=60.0)),
        nulls.draw_unrelated,
        30,
        500,
        conservative="a union bound over all sets that could be formed, at the worst geometry",
    ),
    Case(
        "near reflections, and some that are none",
        lambda: Dccaf(DccafSettings(false_alarm_probability=0.1, no_reflection_probability=0.1, multipath_sigma_m=2.0)),
        nulls.draw_near_reflections,
        10,
        300,
        conservative="two tests share the rate, counts are whole, some near signals look like reflections",
    ),
    Case(
        "one receiver that goes on",
        lambda: Continuity(ContinuitySettings(false_alarm_probability=0.3)),
        CLEAN.records,
        60,
        1000,
        ("undecided",),
        "a union bound over all epochs, and multipath may change more than it does in these records",
    ),
    Case(
        "two bands under an ionosphere",
        lambda: Bands(BandsSettings(false_alarm_probability=0.3)),
        make_two_bands,
        60,
        1000,
        ("undecided",),
        "the ionosphere is as strong as it can be in none of these records",
    ),
    Case(
        "satellites that fail now and then",
        lambda: Torn(TornSettings(false_alarm_probability=0.3)),
        CLEAN.records,
        40,
        400,
        ("undecided",),
        "no satellite fails in these records",
    ),
    Case(
        "few satellites at a known place",
        lambda: CodesAtPlace(CodesAtPlaceSettings(false_alarm_probability=0.3, positions_ecef_m=HOME_ECEF_M)),
        draw_few_satellites,
        40,
        400,
        ("undecided",),
        "whichever satellite is left out, and the worst epoch of several that share their errors",
    ),
    Case(
        "a receiver that stands where it was surveyed",
        lambda: StatedPlace(StatedPlaceSettings(false_alarm_probability=0.3)),
        draw_standing,
        40,
        400,
        ("undecided",),
        "the datum of the place is as far off as it may be in none of these records",
    ),
    Case(
        "a unit that is not aligned in the first window",
        lambda: Inertia(InertiaSettings(false_alarm_probability=0.3)),
        move_receiver,
        10,
        100,
        conservative="nothing is held against it before; of drives and walks it is counted in `test_inertia`",
    ),
    Case(
        "snapshots that stay what they are",
        Snapshots,
        draw_snapshots,
        40,
        400,
        conservative="it never speaks of an attack",
    ),
    Case(
        "satellites above the horizon",
        lambda: BroadcastMessages(BroadcastMessagesSettings(false_alarm_probability=0.3)),
        CLEAN.records,
        40,
        400,
        ("undecided",),
        "no satellite fails in these records, nor sends a message",
    ),
    Case(
        "beats of several walls",
        lambda: Beats(BeatsSettings(false_alarm_probability=0.3)),
        lambda rng: beat(rng, np.exp(rng.uniform(np.log(0.06), np.log(4.0), 10))),
        20,
        100,
        conservative="the p-value bounds the chance of the best of many motions",
    ),
    Case(
        "carriers that go on together",
        lambda: CarrierBreak(CarrierBreakSettings(false_alarm_probability=0.3)),
        lambda rng: break_all(nulls.track(BROKEN.records(rng)), 0.1),
        40,
        400,
        ("undecided",),
        "reflections may turn carriers more than they do in these records",
    ),
    Case(
        "codes that go with Dopplers",
        lambda: CodeDoppler(CodeDopplerSettings(false_alarm_probability=0.3)),
        lambda rng: nulls.track(MeasuredScene(epochs=12, errors=TrackErrors(1.0, constant_m=1.0)).records(rng)),
        40,
        400,
        conservative="reflections may do more to codes than they do in these records",
    ),
    Case(
        "codes that go with carriers",
        lambda: CodeCarrier(CodeCarrierSettings(false_alarm_probability=0.3)),
        MeasuredScene(epochs=12, errors=TrackErrors(1.0, constant_m=1.0)).records,
        40,
        400,
        ("undecided",),
        "reflections may do more to codes than they do in these records",
    ),
    Case(
        "codes that go on",
        lambda: CodeMotion(CodeMotionSettings(false_alarm_probability=0.3)),
        CLEAN.records,
        40,
        400,
        ("attack", "undecided"),
        "a platform may accelerate more than it does in these records",
    ),
    Case(
        "fixes that go on",
        lambda: OwnFixes(OwnFixesSettings(false_alarm_probability=0.3)),
        draw_fixes,
        40,
        400,
        ("undecided",),
        "a platform may accelerate more than it does in these records, and receivers err less",
    ),
    Case(
        "one receiver with nothing before",
        lambda: CommonChange(CommonChangeSettings(false_alarm_probability=0.3)),
        CLEAN.records,
        20,
        100,
        conservative="it says undecided at most, and tests of its own count that, in windows in a row",
    ),
    Case(
        "levels with nothing before",
        lambda: SignalLevels(SignalLevelsSettings(false_alarm_probability=0.3)),
        CLEAN.records,
        20,
        100,
        conservative="it says undecided at most, and tests of its own count that, in windows in a row",
    ),
    Case(
        "reflections, as many as it is given",
        lambda: Sqm(SqmSettings(false_alarm_probability=0.2, reflection_probability=0.3)),
        lambda rng: nulls.reflect(rng, 0.3),
        40,
        2000,
        conservative="no reflection comes before its signal",
    ),
    Case(
        "one position",
        lambda: VectorSqm(VectorSqmSettings(0.1, multipath_sigma_m=0.0, ionosphere_share=0.0)),
        nulls.draw_vector_taps,
        250,
        5000,
        ("undecided",),
        "of the noise the variances alone are taken from the looks, and the law is that of all covariances",
    ),
    Case(
        "a true sky",
        lambda: InsArray(nulls.INS_SETTINGS),
        nulls.draw_array_records,
        300,
        10_000,
        conservative="half of the rate for each of two tests, which share alarms",
    ),
    Case(
        "two signals of one antenna",
        lambda: ArrayCommon(ArrayCommonSettings(false_alarm_probability=0.05)),
        lambda rng: nulls.make_window(nulls.draw_array_phases(rng, nulls.draw_one_direction(rng, 2))),
        1000,
        20_000,
        AUTHENTIC,
    ),
    Case(
        "six signals of one antenna",
        lambda: ArrayCommon(ArrayCommonSettings(false_alarm_probability=0.2)),
        lambda rng: nulls.make_window(nulls.draw_array_phases(rng, nulls.draw_one_direction(rng, 6))),
        50,
        5000,
        AUTHENTIC,
        "one stray signal divides a cluster but does not make all of them different",
    ),
    Case(
        "a true sky",
        lambda: ArrayCommon(ArrayCommonSettings(false_alarm_probability=0.02)),
        lambda rng: nulls.make_window(nulls.draw_array_phases(rng, nulls.draw_directions(rng, 6))),
        400,
        20_000,
        conservative="a union bound over all choices of signals, at the worst direction",
    ),
    Case(
        "two signals of one antenna",
        lambda: Spin(SpinSettings(false_alarm_probability=0.05)),
        lambda rng: nulls.draw_spin_records(rng, nulls.draw_one_direction(rng, 2)[:, :2]),
        800,
        20_000,
        AUTHENTIC,
    ),
    Case(
        "five signals of one antenna",
        lambda: Spin(SpinSettings(false_alarm_probability=0.2)),
        lambda rng: nulls.draw_spin_records(rng, nulls.draw_one_direction(rng, 5)[:, :2]),
        50,
        5000,
        AUTHENTIC,
        "one stray signal divides a cluster but does not make all of them different",
    ),
    Case(
        "a true sky",
        lambda: Spin(SpinSettings(false_alarm_probability=0.02)),
        lambda rng: nulls.draw_spin_records(rng, nulls.draw_directions(rng, 5)[:, :2], sigma=0.08),
        400,
        10_000,
        conservative="a union bound over all choices of signals, at the worst direction",
    ),
    Case(
        "two false skies",
        Prediction,
        draw_two_false_skies,
        50,
        500,
        AUTHENTIC,
        "they are far from where the receiver stands",
    ),
)


def list_named(case):
    return f"{case.make().name}: {case.about}"


@pytest.mark.parametrize("name", load_detectors())
def test_every_installed_detector_is_in_the_contract(name):
    kind = load_detectors()[name]
    assert any(type(case.make()) is kind for case in CASES), f"add a case for {kind.__name__}"
    assert kind().name == name


@pytest.mark.parametrize("case", CASES, ids=list_named)
def test_a_detector_meets_the_contract(case):
    check_detector(
        case.make,
        case.null,
        np.random.default_rng(1),
        alarms=case.alarms,
        windows=case.windows,
        conservative=case.conservative,
    )


@pytest.mark.long
@pytest.mark.parametrize("case", CASES, ids=list_named)
def test_false_alarms_come_at_the_stated_rate_in_many_windows(case):
    rng = np.random.default_rng(2)
    check_false_alarms(
        case.make, (case.null(rng) for _ in range(case.long)), alarms=case.alarms, conservative=case.conservative
    )


@pytest.mark.long
@pytest.mark.parametrize("epochs", [5, 30])
@pytest.mark.parametrize("receivers", [2, 3])
def test_multi_receiver_false_alarms_hold_at_both_rates(receivers, epochs):
    places = {"rx1": (0.0, 0.0, 0.0), "rx2": (20.0, 0.0, 0.0), "rx3": (0.0, 30.0, 0.0)}
    captured = MeasuredScene(
        antennas_enu_m=dict(list(places.items())[:receivers]),
        sky=(),
        false=(FalseSky(),),
        epochs=epochs,
        errors=TrackErrors(1.0),
        max_satellites=6,
    )
    rng = np.random.default_rng(6)
    for rate, windows in ((0.01, 4000), (0.001, 4000)):
        check_false_alarms(
            lambda rate=rate: make_white(rate), (captured.records(rng) for _ in range(windows)), alarms=AUTHENTIC
        )
