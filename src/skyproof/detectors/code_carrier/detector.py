"""Does the code of each signal go with its carrier, or its Doppler?

A false signal that lies upon a true one drags the code away; a carrier loop that holds the true phase, or a transmitter
that does not turn its carrier as it moves its code, lets both part. `continuity` and `common_change` look at what all
signals do together. Here each is looked at by itself, over the last seconds and over minutes (`divergence`).

A test that fails leaves the cause open: a satellite's fault, a direct signal that came to be blocked, or a false one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skyproof.arrays import Booleans
from skyproof.detectors.base import missing, undecided
from skyproof.detectors.code_carrier.divergence import LEAST_SIGNALS, Divergence, divergences_of, parted
from skyproof.errors import require_probability
from skyproof.gnss.signals import chip_m_of
from skyproof.records import CellStatus, Evidence, Need, Observations, Records, SignalRef

__all__ = ["CodeCarrier", "CodeCarrierSettings"]

_REMEMBERED_S: Final = 120.0
_REMEMBERED_EPOCHS: Final = 512
_GAP: Final = 2.5  # usual intervals, beyond which a stretch is broken
_NAMED: Final = 6


@dataclass(frozen=True)
class CodeCarrierSettings:
    """Settings of `CodeCarrier`.

    false_alarm_probability : of each receiver and window, for all its signals together.
    multipath_sigma_m : of one pseudorange, one sigma; it may change altogether.
    """

    false_alarm_probability: float = 1e-3
    multipath_sigma_m: float = 1.0

    def __post_init__(self) -> None:
        require_probability("code_carrier", "false_alarm_probability", self.false_alarm_probability)


class CodeCarrier:
    """The detector: see the module's text. It remembers two minutes of each receiver, thinned to 512 epochs."""

    name = "code_carrier"
    share = 0.0  # it never speaks of an attack
    needs = (Need.OBSERVATIONS,)

    def __init__(self, settings: CodeCarrierSettings | None = None) -> None:
        self.settings = settings or CodeCarrierSettings()

    def examine(self, records: Records, state: Any = None) -> tuple[list[Evidence], Any]:
        """Return the evidence of one window; never raises for what the data lack."""
        lacking = missing(self, records)
        if lacking:
            return lacking, state
        tails: dict[str, Observations] = dict(state or {})
        found = []
        for o in records.observations:
            tail = tails.get(o.receiver)
            if tail is not None and tail.elapsed_s[-1] >= o.elapsed_s[0]:
                tail = None  # another recording
            joined = o if tail is None else Observations.joined((tail, o))
            found.append(self._receiver(records, o, joined))
            kept = joined.elapsed_s >= o.elapsed_s[-1] - _REMEMBERED_S
            first = max(int(np.argmax(kept)), joined.gpst.size - _REMEMBERED_EPOCHS)
            tails[o.receiver] = joined.read(first, joined.gpst.size)
        return found, tails

    def _receiver(self, records: Records, o: Observations, joined: Observations) -> Evidence:
        tested: list[tuple[SignalRef, Divergence]] = []
        tests = 0
        whole = _unbroken(joined)
        signals = [signal for signal in o.signals if whole[-1, joined.column_of[signal]]]
        columns = np.array([joined.column_of[signal] for signal in signals], np.intp)
        begins = whole[:, columns].argmax(axis=0)
        window = int(np.searchsorted(joined.elapsed_s, o.elapsed_s[0]))
        apart_m, gathered_m2 = (values[:, columns] for values in parted(joined))
        code_m2 = joined.pseudorange_sigma_m[:, columns] ** 2
        chip_m = np.array([chip_m_of(signal.sat, signal.band, signal.code) for signal in signals])
        looks = [
            divergences_of(
                joined.elapsed_s, apart_m, code_m2, gathered_m2, chip_m, starts, self.settings.multipath_sigma_m
            )
            for starts in (np.maximum(window, begins), begins)
        ]
        for k, signal in enumerate(signals):
            spans = looks if begins[k] != window else looks[:1]
            known = [look for span in spans if (look := span[k]) is not None]
            tests += len(known)
            if known:
                tested.append((SignalRef(o.receiver, signal), min(known, key=lambda look: look.p_value)))
        subject = tuple(ref for ref, _ in tested)
        if not tested:
            every = tuple(SignalRef(o.receiver, signal) for signal in o.signals)
            because = (
                f"fewer than {LEAST_SIGNALS} signals of {o.receiver} have code and carrier, or Doppler, over eight "
                "unbroken epochs"
            )
            need = "carrier phases or Dopplers beside the codes"
            return undecided(self, records, every, because=because, would_need=need, code="no_carrier")
        worst, look = min(tested, key=lambda each: each[1].p_value)
        alpha = self.settings.false_alarm_probability
        failed = [(ref, each) for ref, each in tested if tests * each.p_value < alpha]
        if failed:
            because = _words(failed, worst, look)
            subject = tuple(ref for ref, _ in failed)
        else:
            because = f"the codes of {len(tested)} signals in {o.receiver} go with their carriers"
        return Evidence(
            detector=self.name,
            start_gpst=records.start_gpst,
            end_gpst=records.end_gpst,
            subject=subject,
            says="undecided" if failed else "clean",
            because=because,
            p_value=min(1.0, tests * look.p_value),
            false_alarm_probability=alpha,
            overrules=bool(failed),
            may_also_be=("reflections", "fault") if failed else (),
            would_need="another receiver, or correlators, to tell a fault from a false signal" if failed else None,
        )


def _unbroken(o: Observations) -> Booleans:
    """Return where (n_epochs, n_signals) a signal goes on to the last epoch without a slip or a gap.

    The epoch of a slip begins the stretch that goes on.
    """
    there = np.isfinite(o.pseudorange_m) & (o.status != CellStatus.NOT_TRACKED)
    step_s = np.diff(o.elapsed_s)
    usual_s = float(np.median(step_s)) if step_s.size else 0.0
    gap = np.append(False, step_s > _GAP * usual_s)
    with_carrier = np.isfinite(o.carrier_cyc).any(axis=0)
    broken = there & (gap[:, None] | ((o.status == CellStatus.SLIP) & with_carrier))
    lost = np.where(with_carrier, there & ~np.isfinite(o.carrier_cyc), False)
    later_break = np.cumsum((broken | lost | ~there)[::-1], axis=0)[::-1]
    after = np.vstack([later_break[1:], np.zeros((1, later_break.shape[1]), later_break.dtype)])
    return np.asarray((after == 0) & there & ~lost)


def _words(failed: Sequence[tuple[SignalRef, Divergence]], worst: SignalRef, look: Divergence) -> str:
    names = ", ".join(str(ref.signal) for ref, _ in failed[:_NAMED])
    more = f" and {len(failed) - _NAMED} more" if len(failed) > _NAMED else ""
    return (
        f"code and carrier part: {names}{more} in {worst.receiver}; {worst.signal} by {look.change_m:.0f} m in "
        f"{look.time_s:.0f} s"
    )
