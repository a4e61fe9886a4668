"""Records show themselves in a few lines, whatever is in their arrays."""

import dataclasses
import inspect

import numpy as np
import pytest

from skyproof import records
from skyproof.formats.pieces import Workspace
from skyproof.formats.spool import ObservationSpool
from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.records import AntennaArray, Baseline, Observations, Records, SignalId, Taps
from skyproof.short_repr import ShortRepr, summarize
from skyproof.testing import MeasuredScene

FEW_LINES = 600
WINDOW = MeasuredScene(epochs=2000, step_s=0.1).records(np.random.default_rng(1))
OBSERVATIONS = WINDOW.observations[0]


def test_every_record_that_holds_arrays_is_shown_short():
    # By its type: a new record that forgets it is seen here, before a notebook prints hundreds of lines.
    classes = [
        item
        for _, item in inspect.getmembers(records, dataclasses.is_dataclass)
        if item.__module__.startswith("skyproof.records.")
    ]
    plain = {item.__name__ for item in classes if item.__repr__ is not ShortRepr.__repr__}
    assert plain == {
        "Asked",
        "CcafAsked",
        "NoticedAttack",
        "SampleGap",
        "SignalId",
        "SignalRef",
        "SnapshotChange",
        "SnapshotChanges",
        "SpinArm",
        "TapsAsked",
        "WrongStatement",
    }


def test_observations_show_receiver_span_and_signals():
    result = repr(OBSERVATIONS)
    assert len(result) < FEW_LINES
    assert "\n" not in result
    for part in (OBSERVATIONS.receiver, "2000 from ", str(OBSERVATIONS.gpst[0])[:19], str(OBSERVATIONS.signals[0])):
        assert part in result
    assert f"signals={len(OBSERVATIONS.signals)}: " in result


def test_measurements_on_a_disk_show_the_same():
    log = ObservationSpool(Workspace(), OBSERVATIONS.receiver)
    log.append(OBSERVATIONS)
    assert repr(log).partition("(")[2].startswith(repr(OBSERVATIONS).partition("(")[2].partition(", found")[0])


@pytest.mark.parametrize(
    "record",
    [
        WINDOW,
        make_nominal_constellation(np.datetime64("2024-05-14T10:00:00", "ns")),
        Taps(
            receiver="rx",
            signals=tuple(SignalId(f"G{k:02d}") for k in range(1, 33)),
            elapsed_s=np.arange(500.0),
            delays_chips=np.linspace(-1, 1, 81),
            dopplers_hz=np.zeros(1),
            value=np.zeros((500, 32, 1, 81), np.complex64),
        ),
    ],
    ids=lambda record: type(record).__name__,
)
def test_a_large_record_is_shown_short(record):
    assert len(repr(record)) < FEW_LINES


def test_small_arrays_are_written_out():
    assert "[[0. , 0. , 0. ], [0.1, 0. , 0. ]]" in repr(AntennaArray(elements_m=np.array([[0.0, 0, 0], [0.1, 0, 0]])))
    when = np.datetime64("2024-05-14T10:00:00.500", "ns")
    baseline = Baseline(
        receivers=("bow", "stern"), start_gpst=when, end_gpst=when, enu_m=np.ones((1, 3)), covariance_m2=np.eye(3)
    )
    assert "receivers=2: bow, stern, start_gpst=2024-05-14T10:00:00.5, " in repr(baseline)
    assert "enu_m=[[1., 1., 1.]]" in repr(baseline)


def test_what_is_empty_is_left_out():
    assert repr(Records(start_gpst=np.datetime64("2024-01-01"), end_gpst=np.datetime64("2024-01-02"))) == (
        "Records(start_gpst=2024-01-01, end_gpst=2024-01-02)"
    )


def test_long_texts_and_tuples_are_cut():
    result = summarize(
        "X", {"text": "a" * 500, "names": tuple("abcdefghij"), "many": (Observations,) * 99, "n": 0.1 + 0.2}
    )
    assert result == f"X(text='{'a' * 57}...', names=10: a, b, c, d, e, f, ..., many=99 type, n=0.3)"
