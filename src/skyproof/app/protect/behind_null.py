"""Recover positions of antenna arrays behind a null, where a jammer or a stronger transmitter leaves none.

The samples' own covariance shows what stands above the noise (`recording.null`). Where an epoch has no fix of
satellites and its samples hold such a source, the recording is tracked a second time without it, and what that gives
is judged as one receiver alone is: behind the null there is no array any more. So its fixes are *consistent* at most,
and no word and no label of the run changes by them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.common.settings import Settings
from skyproof.app.common.windows import asked
from skyproof.app.protect.judging import find_tracks, judge
from skyproof.app.protect.outcome import Outcome, ReceiverOutcome
from skyproof.app.protect.positions import BehindNull, Positions
from skyproof.app.receive.policy import POLICY
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import track
from skyproof.arrays import Booleans, Reals
from skyproof.interruption import has_come
from skyproof.navigation.predictor import Predictor
from skyproof.navigation.window import median_interval_s
from skyproof.recording.null import BLOCK_S, measure_rise, take_out_sources
from skyproof.records import MeasurementSource, NavigationData, ObservationLog, Samples

__all__ = ["recover_behind_nulls"]

_LOOK_S: Final = 0.01
"""Of each block, where it is only asked whether it holds a source."""


def recover_behind_nulls(
    outcome: Outcome,
    sources: Sequence[MeasurementSource],
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    predictors: Mapping[str, Predictor],
) -> Outcome:
    """Return the outcome with fixes behind a null, of arrays that have none at epochs with a source above the noise.

    sources : of the receivers, as they were opened: what is removed from antennas one by one spoils a common null.
    """
    receivers = []
    for r, source in zip(outcome.receivers, sources, strict=True):
        behind = None if r.positions is None else _track_again(r, source, navigation, settings, progress, predictors)
        if behind is not None and r.positions is not None:
            positions = replace(r.positions, behind_null=behind)
            r = replace(r, positions=positions, tracks=find_tracks(positions))
        receivers.append(r)
    return replace(outcome, receivers=tuple(receivers))


def _track_again(
    r: ReceiverOutcome,
    samples: MeasurementSource,
    navigation: NavigationData | None,
    settings: Settings,
    progress: Progress,
    predictors: Mapping[str, Predictor],
) -> BehindNull | None:
    """Track and judge an array's recording behind a null; None where no source costs a fix."""
    if not isinstance(samples, Samples) or not samples.others or r.positions is None or has_come():
        return None
    log, lacking = r.positions.log, ~r.fixed_by_satellites
    rise = np.ones(lacking.size)
    rise[lacking] = _measure_rises(samples, log.elapsed_s[lacking])
    covered = rise > 1.0
    if not covered.any():
        return None
    progress.say(f"{samples.name}: sources above the noise cost positions; tracked again behind a null")
    combined = [take_out_sources(samples, POLICY.most_sky_hz)]
    (tracker,), interrupted = track(combined, settings, progress, navigation, asked=asked(), as_one=True)
    if interrupted:
        return None
    outcome, _ = judge(
        [observe(tracker, navigation, diagnose=False)], navigation, settings, progress, predictors=predictors
    )
    positions, epochs = _keep_consistent(outcome.receivers[0].positions), np.zeros_like(lacking)
    if positions is not None and positions.log.gpst.size == lacking.size:
        track_ = positions.track("consistent")
        epochs = lacking & (track_ is not None and track_.fixed)
    return BehindNull(
        word=outcome.decision.verdict,
        positions=positions,
        epochs=epochs,
        seconds=float(np.sum(epochs)) * (median_interval_s(log.elapsed_s) if lacking.size > 1 else 0.0),
        source_to_noise=float(np.median(rise[covered])) - 1.0,
        cost_db=None if positions is None else _measure_cost_db(positions.log, epochs & covered, ~lacking),
    )


def _keep_consistent(positions: Positions | None) -> Positions | None:
    """Return positions none of which is trusted."""
    if positions is None:
        return None
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
