"""Recover positions of antenna arrays behind a null, where a jammer or a stronger transmitter leaves none.

The samples' own covariance shows what stands above the noise (`recording.null`). Where an epoch has no fix of
satellites and its samples hold such a source, the recording is tracked a second time without it, and what that gives
is judged as one receiver alone is: behind the null there is no array any more. So its fixes are *consistent* at most,
and no label of the run changes by them. Its word makes a run *suspect* that had a better one: another transmitter may
stand beside the source. What a null leaves of the source may look like one, so the run is not *spoofed* by it. Of one
array on which no test could run as recorded, word and
labels are those that one receiver has behind the null.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.protect.explanation import why_untested
from skyproof.app.protect.judging import find_tracks, judge
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.positions import BehindNull, Positions
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import track
from skyproof.arrays import Booleans, Reals
from skyproof.fusion.fuse import Decision
from skyproof.fusion.interference import Spell
from skyproof.fusion.suspicion import Suspicion
from skyproof.interruption import has_come
from skyproof.navigation.predictor import Predictor
from skyproof.navigation.window import median_interval_s
from skyproof.recording.null import BLOCK_S, measure_rise, take_out_sources
from skyproof.records import MeasurementSource, NavigationData, ObservationLog, Samples, VerdictWord
from skyproof.remarks import Remark, RemarkKind

__all__ = ["recover_behind_nulls"]

_LOOK_S: Final = 0.01
"""Of each block, where it is only asked whether it holds a source."""
_BAD: Final = ("suspect", "spoofed")


def recover_behind_nulls(
    outcome: Outcome,
    sources: Sequence[MeasurementSource],
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    predictors: Mapping[str, Predictor],
) -> Outcome:
    """Return the outcome with fixes behind a null, of arrays that have none at epochs with a source above the noise.

    Of one array on which no test could run, it is the outcome behind the null.

    sources : of the receivers, as they were opened: what is removed from antennas one by one spoils a common null.
    """
    alone = len(sources) == 1 and why_untested(outcome) is not None
    receivers, decision = [], outcome.decision
    for r, samples in zip(outcome.receivers, sources, strict=True):
        receivers.append(r)
        if not isinstance(samples, Samples) or not samples.others or not (alone or r.positions) or has_come():
            continue
        lacking_s = np.arange(0.0, samples.duration_s, BLOCK_S)
        if not alone and r.positions is not None:
            lacking_s = r.positions.log.elapsed_s[~r.fixed_by_satellites]
        rises = _measure_rises(samples, lacking_s)
        if not np.any(rises > 1.0):
            continue
        rise = float(np.median(rises[rises > 1.0]))
        progress.say(f"{samples.name}: a source above the noise costs positions; tracked again behind a null")
        combined = [take_out_sources(samples, POLICY.most_sky_hz)]
        (tracker,), interrupted = track(combined, settings, progress, navigation, asked=asked(), as_one=True)
        if interrupted:
            continue
        reception = observe(tracker, navigation, diagnose=False)
        if alone:
            why = (
                f"as recorded no test could run: all is behind a null of a source {_to_db(rise):.0f} dB above the noise"
            )
            reception = replace(reception, remarks=(Remark(why, RemarkKind.BEARS), *reception.remarks))
        found, _ = judge([reception], navigation, settings, progress, predictors=predictors)
        (behind,) = found.receivers
        positions = None if behind.positions is None else _keep_consistent(behind.positions)
        if alone and positions is not None:
            outcome, decision, r = found, found.decision, replace(behind, positions=positions, tracks={})
        if r.positions is not None:
            receivers[-1] = _add_fixes(r, found.decision.verdict, positions, rise, lacking_s[rises > 1.0])
            since_s, until_s = lacking_s[rises > 1.0][[0, -1]]
            decision = _add_interference(decision, r.positions.log, since_s, until_s, rise)
            decision = _add_doubt(decision, found, r.positions.log.receiver)
    return replace(outcome, receivers=tuple(receivers), decision=decision)


def _add_fixes(
    r: ReceiverOutcome, word: VerdictWord, behind: Positions | None, rise: float, disturbed_s: Reals
) -> ReceiverOutcome:
    """Add consistent fixes behind a null at the epochs at which a receiver has none of satellites, and a source.

    disturbed_s : rising times of blocks that hold a source. Elsewhere nothing is taken out, and what the array has
    found of the signals holds.
    """
    assert r.positions is not None
    log, fixed = r.positions.log, r.fixed_by_satellites
    track_ = None if behind is None else behind.track("consistent")
    blocks = np.unique(np.floor(disturbed_s / BLOCK_S))
    disturbed = np.isin(np.floor(log.elapsed_s / BLOCK_S), blocks)
    same = track_ is not None and track_.fixed.size == fixed.size
    epochs = ~fixed & disturbed & track_.fixed if track_ is not None and same else np.zeros_like(fixed)
    found = BehindNull(
        word=word,
        positions=behind,
        epochs=epochs,
        seconds=float(np.sum(epochs)) * (median_interval_s(log.elapsed_s) if fixed.size > 1 else 0.0),
        source_to_noise=rise - 1.0,
        cost_db=None if behind is None else _measure_cost_db(behind.log, epochs, fixed),
    )
    positions = replace(r.positions, behind_null=found)
    return replace(r, positions=positions, tracks=find_tracks(positions))


def _add_interference(decision: Decision, log: ObservationLog, since_s: float, until_s: float, rise: float) -> Decision:
    """Add a source that costs positions to the interference, where no test names it.

    since_s, until_s : its first and last epoch, after the first sample. rise : of an antenna's noise by it, a factor.
    """
    spells = decision.interference or ()
    if decision.verdict == "spoofed" or any(spell.receiver == log.receiver for spell in spells):
        return decision
    first, last = (min(int(row), log.gpst.size - 1) for row in np.searchsorted(log.elapsed_s, [since_s, until_s]))
    spell = Spell(
        receiver=log.receiver,
        carriers=("L1",),
        since_gpst=log.gpst[first],
        until_gpst=None if last == log.gpst.size - 1 else log.gpst[last],
        fall_db=_to_db(rise),
        sigma_db=POLICY.rise_sigma_db,
        level_db=_to_db(rise),
        level_sigma_db=POLICY.rise_sigma_db,
        lost=0,
        signs=("level",),
        may_be_shade=False,
    )
    return replace(decision, interference=(*spells, spell))


def _add_doubt(decision: Decision, behind: Outcome, receiver: str) -> Decision:
    """Make a run suspect if its signals behind a null are suspect, or worse."""
    if decision.verdict in _BAD or behind.decision.verdict not in _BAD:
        return decision
    onset = behind.decision.onset
    worst = next((e for e in behind.evidence if e.says in ("spoofed", "attack")), None)
    doubt = behind.decision.suspicion or Suspicion(receivers=(receiver,), onset=onset, finding=worst, may_also_be=())
    bad = [window for window in behind.decision.windows if window.word in _BAD]
    windows = decision.windows
    if bad:
        since, until = bad[0].start_gpst, bad[-1].end_gpst
        own = [window for window in windows if window.receiver == receiver]
        parts = [
            *(replace(w, end_gpst=min(w.end_gpst, since)) for w in own if w.start_gpst < since),
            replace(bad[0], receiver=receiver, end_gpst=until, word="suspect"),
            *(replace(w, start_gpst=max(w.start_gpst, until)) for w in own if w.end_gpst > until),
        ]
        windows = (*(window for window in windows if window.receiver != receiver), *parts)
    return replace(decision, verdict="suspect", onset=onset, suspicion=doubt, windows=windows)


def _to_db(ratio: float) -> float:
    return 10.0 * float(np.log10(ratio))


def _keep_consistent(positions: Positions) -> Positions:
    """Return positions none of which is trusted."""
    nothing = np.zeros_like(positions.log.measured)
    return replace(positions, masks={**positions.masks, "trusted": lambda: nothing})


def _measure_rises(samples: Samples, elapsed_s: Reals) -> Reals:
    """Measure by which factor sources raise an antenna's noise at these times (n,); 1 without any."""
    count = max(round(_LOOK_S * samples.rate_hz), 1)
    blocks, which = np.unique(np.floor(elapsed_s / BLOCK_S).astype(int), return_inverse=True)
    starts = np.minimum(blocks * round(BLOCK_S * samples.rate_hz), max(samples.n_samples - count, 0))
    rises = [measure_rise(samples, int(start), count, POLICY.most_sky_hz) for start in starts]
    return np.asarray(np.array(rises)[which])


def _measure_cost_db(log: ObservationLog, behind: Booleans, before: Booleans) -> float | None:
    """Measure by how much C/N0 behind a null is lower than without a source; None where no signal shows both."""
    falls = []
    for channel in range(len(log.signals)):
        cn0_dbhz = log.series("cn0_dbhz", channel)
        both = [cn0_dbhz[rows & np.isfinite(cn0_dbhz)] for rows in (before, behind)]
        if all(values.size for values in both):
            falls.append(float(np.mean(both[0]) - np.mean(both[1])))
    return float(np.median(falls)) if falls else None
