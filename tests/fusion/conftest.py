"""Invented records: what detectors might say of receivers that might have measured."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.detectors.adapter import finding_from_evidence
from skyproof.records import OBSERVABLES, ConsistentSet, Evidence, Observations, SignalId, SignalRef

START = np.datetime64("2024-05-14T10:00:00", "ns")
WINDOW_S = 10.0


def make_time(seconds: float) -> np.datetime64:
    return START + np.timedelta64(round(seconds * 1e9), "ns")


def make_ref(name: str, receiver: str = "rx1") -> SignalRef:
    """Make the reference "G05a" of a receiver."""
    return SignalRef(receiver, SignalId(name[:3], copy=name[3:]))


class Invented:
    """Makers of records: a second between epochs, windows of ten."""

    @staticmethod
    def observations(
        names=("G05a", "G07a", "G10a", "G13a", "G15a"),
        *,
        receiver="rx1",
        duration_s=40,
        begin_s=0,
        there=None,
        slips=None,
        found=None,
    ):
        """Make observations.
        there : name to (first, last) epoch.

        slips : name to epochs.
        found : name to (missed_s, found_s).
        """
        n, k = duration_s, len(names)
        measured = np.ones((n, k), bool)
        status = np.zeros((n, k), np.uint8)
        missed_s, found_s = np.full(k, np.nan), np.zeros(k)
        for column, name in enumerate(names):
            if there and name in there:
                first, last = there[name]
                measured[:, column] = (np.arange(n) >= first) & (np.arange(n) <= last)
            for epoch in (slips or {}).get(name, ()):
                status[epoch, column] = 3
            if found and name in found:
                missed_s[column], found_s[column] = found[name]
        status[~measured] = 1
        range_m = np.where(measured, 2.2e7, np.nan)
        numbers = dict.fromkeys(
            OBSERVABLES,
            range_m,
        )
        elapsed_s = np.arange(n, dtype=float)
        return Observations(
            receiver=receiver,
            signals=tuple(make_ref(name).signal for name in names),
            gpst=make_time(begin_s) + (elapsed_s * 1e9).astype("timedelta64[ns]"),
            elapsed_s=elapsed_s,
            status=status,
            found_elapsed_s=found_s,
            missed_elapsed_s=missed_s,
            **numbers,
        )

    @staticmethod
    def evidence(
        window: int,
        says: str,
        *names: str,
        receivers=("rx1",),
        detector="one",
        p_value=1e-9,
        asked=1e-6,
        code="",
        **more,
    ):
        """Make what a detector finds about the same signals in all of these receivers, in a window."""
        return finding_from_evidence(
            Evidence(
                detector=detector,
                start_gpst=make_time(window * WINDOW_S),
                end_gpst=make_time((window + 1) * WINDOW_S),
                subject=tuple(make_ref(name, receiver) for receiver in receivers for name in names),
                says=says,
                because="why",
                p_value=p_value,
                false_alarm_probability=asked,
                code=code or detector,
                **more,
            )
        )

    @staticmethod
    def restate(finding, **changes):
        """Copy a finding with these fields changed."""
        return finding_from_evidence(replace(finding.estimates["evidence"], **changes))

    @staticmethod
    def sky(window: int, *names: str, receiver="rx1"):
        """Make a consistent set."""
        return ConsistentSet(
            receiver=receiver,
            signals=tuple(make_ref(name).signal for name in names),
            gpst=make_time((window + 0.5) * WINDOW_S),
            position_ecef_m=np.zeros(3),
            clock_bias_s=0.0,
            covariance_m2=np.eye(4),
            statistic=1.0,
            dof=1,
            p_value=0.3,
        )

    at = staticmethod(make_time)
    ref = staticmethod(make_ref)


@pytest.fixture
def invented() -> type[Invented]:
    return Invented
