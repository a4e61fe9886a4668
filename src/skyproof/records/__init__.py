"""The vocabulary: what flows between the rooms.

Frozen dataclasses of arrays, time along axis 0, channels along axis 1, NaN where there is nothing, units in the names.
An instant is a label: `numpy.datetime64[ns]` read as GPS time (no leap seconds, no zone). A measurement is never the
difference of two labels. Frames are ECEF WGS-84 unless a name says otherwise; angles are radians unless a name says
deg.

Frozen means frozen: `freeze` checks that shapes agree and keeps read-only views; the caller's arrays stay writable.
"""

from skyproof.gnss.ephemeris import Ephemeris, Klobuchar, NavigationData, UtcParameters
from skyproof.records.answer import LABELS, WORDS, Label, VerdictWord
from skyproof.records.correlations import Asked, Ccaf, CcafAsked, Taps, TapsAsked, TimeSliced
from skyproof.records.estimates import (
    NOTICED,
    Baseline,
    Direction,
    InterferenceSign,
    NoiseRise,
    NoticedAttack,
    NoticedKind,
    OverlappingSkies,
    WeakStart,
)
from skyproof.records.findings import (
    UNTESTED,
    AnyFinding,
    Cause,
    CauseName,
    Datum,
    Evidence,
    Finding,
    Hypothesis,
    Null,
    Says,
    StatementTest,
    WrongStatement,
)
from skyproof.records.fixes import FIX_STATUS, ConsistentSet, Fix, FixStatus
from skyproof.records.measurements import (
    CELL_STATUS,
    OBSERVABLES,
    ArrayPhases,
    CellStatus,
    ObservationLog,
    Observations,
    SnapshotChange,
    SnapshotChanges,
)
from skyproof.records.needs import Need
from skyproof.records.platform import AntennaArray, Attitude, ImuSeries, InertialReadings, NavState, SpinArm
from skyproof.records.receiver_words import FrontEndLevels, ReceivedMessages, ReceiverFixes
from skyproof.records.samples import MeasurementSource, OpenFile, SampleGap, Samples
from skyproof.records.shapes import Channels, Selectable, freeze
from skyproof.records.signals import BY_NAME, Kind, SignalId, SignalRef, Transmission, list_refs
from skyproof.records.window import Holding, Records

__all__ = [
    "BY_NAME",
    "CELL_STATUS",
    "FIX_STATUS",
    "LABELS",
    "NOTICED",
    "OBSERVABLES",
    "UNTESTED",
    "WORDS",
    "AntennaArray",
    "AnyFinding",
    "ArrayPhases",
    "Asked",
    "Attitude",
    "Baseline",
    "Cause",
    "CauseName",
    "Ccaf",
    "CcafAsked",
    "CellStatus",
    "Channels",
    "ConsistentSet",
    "Datum",
    "Direction",
    "Ephemeris",
    "Evidence",
    "Finding",
    "Fix",
    "FixStatus",
    "FrontEndLevels",
    "Holding",
    "Hypothesis",
    "ImuSeries",
    "InertialReadings",
    "InterferenceSign",
    "Kind",
    "Klobuchar",
    "Label",
    "MeasurementSource",
    "NavState",
    "NavigationData",
    "Need",
    "NoiseRise",
    "NoticedAttack",
    "NoticedKind",
    "Null",
    "ObservationLog",
    "Observations",
    "OpenFile",
    "OverlappingSkies",
    "ReceivedMessages",
    "ReceiverFixes",
    "Records",
    "SampleGap",
    "Samples",
    "Says",
    "Selectable",
    "SignalId",
    "SignalRef",
    "SnapshotChange",
    "SnapshotChanges",
    "SpinArm",
    "StatementTest",
    "Taps",
    "TapsAsked",
    "TimeSliced",
    "Transmission",
    "UtcParameters",
    "VerdictWord",
    "WeakStart",
    "WrongStatement",
    "freeze",
    "list_refs",
]
