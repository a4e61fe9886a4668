"""Power of a jammer over the receiver's noise (J/N): the ramp of the paper's figure 8, and ours over 45 dB.

N. Stenberg, E. Axell, J. Rantakokko, G. Hendeby, "Results on GNSS Spoofing Mitigation Using Multiple Receivers",
NAVIGATION 69(1), 2022, doi 10.33012/navi.510, section 5.2. The paper compares the power of samples with that before. A
receiver without samples shows it by C/N0 of all signals and by the gain of its front end.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from skyproof.app.common.progress import Silent
from skyproof.app.common.settings import Settings
from skyproof.app.inspect.advice import estimate_power_over_quietest
from skyproof.app.protect import judge
from skyproof.app.receive.observed import ObservedFile, OwnWords
from skyproof.app.receive.reception import Reception
from skyproof.gnss.received_power import JammerToNoise, estimate_jammer_to_noise
from skyproof.recording.conditioning import measure_front_end
from skyproof.records import CellStatus, FrontEndLevels, NavigationData, Observations, Samples
from skyproof.report.chart import Axes
from skyproof.simulator import make_clean
from skyproof.simulator.attacks import Interference
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.measurements import simulate_observations
from skyproof.simulator.samples import render_samples
from skyproof.simulator.scenario import FrontEnd, Scenario, ScenePlace
from skyproof.studies.base import Claim, Row, Study, StudySettings, value_of
from skyproof.studies.multi_receiver import PAPER

__all__ = ["STUDIES"]

_PLACE: Final = ScenePlace(lat_deg=59.0, lon_deg=17.0, height_m=100.0)
_START: Final = np.datetime64("2012-07-01T20:00:16", "ns")
_STEPS_DB: Final = tuple(float(db) for db in range(-6, 41, 2))
_FRONT_ENDS: Final = {
    "8 bits": FrontEnd(encoding="int", bits=8),
    "2 bits": FrontEnd(encoding="sign-magnitude", bits=2),
}
_LOST_DBHZ: Final = 25.0  # below which a receiver loses a signal
_SAMPLED_S, _LOGGED_S, _JAMMED_S = 0.4, 120, 30
_MEASURED: Final = (
    *("pseudorange_m", "carrier_cyc", "doppler_hz"),
    *("pseudorange_sigma_m", "carrier_sigma_cyc", "doppler_sigma_hz"),
)
_GAIN_SIGMA_DB: Final = 1.0
CN0, GAIN = "C/N0", "C/N0 and gain"


def _make_scene(jammer_db: float, duration_s: float, jammed_s: float, seed: int, front_end: FrontEnd) -> Scenario:
    """Make one receiver that is jammed at the end of a scene, by white noise."""
    scene = make_clean(_PLACE, _START, receivers=1, duration_s=duration_s, seed=seed, front_end=front_end)
    near: Any = ScenePlace(lat_deg=_PLACE.lat_deg + 5e-4, lon_deg=_PLACE.lon_deg, height_m=_PLACE.height_m)
    source = Interference(kind="noise", transmit=near, power_db=jammer_db, onset_s=duration_s - jammed_s)
    return scene.model_copy(update={"interference": (source,)})


def _row(how: str, jammer_db: float, found: Sequence[JammerToNoise | None]) -> Row:
    """Compare estimates with the truth. bounded : shares of those found whose limits hold it."""
    seen = [each for each in found if each is not None]
    whole = np.array([each.db for each in seen if each.high_db is not None])
    return {
        "how": how,
        "jammer_to_noise_db": jammer_db,
        "trials": len(found),
        "seen": len(seen) / len(found),
        "lower_bounds": sum(each.high_db is None for each in seen) / len(found),
        "estimate_db": float(np.mean(whole)) if whole.size else None,
        "bias_db": float(np.mean(whole) - jammer_db) if whole.size else None,
        "spread_db": float(np.std(whole)) if whole.size else None,
        "held": float(np.mean([_holds(each, jammer_db) for each in seen])) if seen else None,
    }


def _holds(found: JammerToNoise, jammer_db: float) -> bool:
    over = found.low_db is None or found.low_db <= jammer_db
    return over and (found.high_db is None or jammer_db <= found.high_db)


def _run(settings: StudySettings) -> Iterator[Row]:
    navigation = make_navigation(_make_scene(0.0, 1.0, 0.5, settings.seed, FrontEnd()))
    for name, front_end in _FRONT_ENDS.items():
        for jammer_db in _STEPS_DB:
            scene = _make_scene(jammer_db, _SAMPLED_S, 0.5 * _SAMPLED_S, settings.seed, front_end)
            (samples,) = render_samples(scene, navigation)
            yield _row(f"power, {name}", jammer_db, [_compare_powers(samples)])
            yield _row(f"shares, {name}", jammer_db, [estimate_power_over_quietest(measure_front_end(samples))])
    for how in (CN0, GAIN):
        for number, jammer_db in enumerate(_STEPS_DB[3::8] if settings.quick else _STEPS_DB[1::2]):
            rng = settings.rng(number)
            found = [_judge_log(jammer_db, navigation, rng, gain=how == GAIN) for _ in range(settings.count(10, 1))]
            yield _row(how, jammer_db, found)


def _compare_powers(samples: Samples) -> JammerToNoise | None:
    """Estimate as the paper does: mean square of the samples over that before."""
    half = samples.n_samples // 2
    before, after = (float(np.mean(np.square(samples.read(start, half)))) for start in (0, half))
    return estimate_jammer_to_noise(10.0 * np.log10(after / before), _GAIN_SIGMA_DB)


def _judge_log(
    jammer_db: float, navigation: NavigationData, rng: np.random.Generator, *, gain: bool
) -> JammerToNoise | None:
    """Return what `protect` says of a jammed log whose levels wander as those of receivers do; None of no jammer.

    gain : whether the log tells the front end's gain.
    """
    scene = _make_scene(jammer_db, float(_LOGGED_S), float(_JAMMED_S), int(rng.integers(1000)), FrontEnd())
    (observed,), _ = simulate_observations(scene, navigation, rng=rng)
    n_epochs, n_signals = observed.cn0_dbhz.shape
    window = np.arange(n_epochs) // 10
    wander_db = rng.standard_normal((window[-1] + 1, n_signals)) + 0.3 * rng.standard_normal((window[-1] + 1, 1))
    cn0_dbhz = observed.cn0_dbhz + wander_db[window] + 0.3 * rng.standard_normal((n_epochs, n_signals))
    lost = ~(cn0_dbhz > _LOST_DBHZ)
    cells: dict[str, Any] = {name: getattr(observed, name) for name in _MEASURED} | {"cn0_dbhz": cn0_dbhz}
    status = np.where(lost, CellStatus.NOT_TRACKED, observed.status).astype(np.uint8)
    cells = {name: np.where(lost, np.nan, values) for name, values in cells.items()}
    logged = replace(observed, status=status, **cells)
    levels = _make_levels(observed, jammer_db, rng) if gain else None
    outcome, _ = judge([_reception(logged, levels)], navigation, Settings(), Silent())
    spells = outcome.decision.interference or ()
    return max((spell.jammer for spell in spells if spell.jammer), key=lambda jammer: jammer.db, default=None)


def _make_levels(observed: Observations, jammer_db: float, rng: np.random.Generator) -> FrontEndLevels:
    """Make a gain that gives way to what comes in, and wanders by 0.5 dB from window to window."""
    n = observed.gpst.size
    wander_db = (0.5 * rng.standard_normal(n // 10 + 1))[np.arange(n) // 10]
    rise_db = np.where(
        observed.elapsed_s > _LOGGED_S - _JAMMED_S, 10.0 * np.log10(1.0 + 10.0 ** (jammer_db / 10.0)), 0.0
    )
    none = np.full(n, np.nan)
    return FrontEndLevels(
        gpst=observed.gpst,
        band=np.full(n, "L1"),
        agc_db=40.0 - rise_db + wander_db,
        agc_share=none,
        noise_db=none,
        jamming_share=none,
    )


def _reception(observed: Observations, levels: FrontEndLevels | None) -> Reception:
    """Build the reception of a log that holds it; there is no file."""
    no_file: Any = None
    source = ObservedFile(
        name=observed.receiver,
        path="",
        format="",
        observations=observed,
        file=no_file,
        own=OwnWords(levels=levels),
    )
    return Reception(
        source=source,
        observations=observed,
        decoded=NavigationData(ephemerides=()),
        n_signals=len(observed.signals),
        examined_s=float(observed.elapsed_s[-1]),
    )


def _step_db(how: str) -> Callable[[Sequence[Row]], float]:
    """Make a function from the rows to the step of the estimates from 10 to 20 dB, as the jammer rises by 2 dB."""
    low, high = (value_of("estimate_db", how=how, jammer_to_noise_db=db) for db in (10.0, 20.0))
    return lambda rows: (high(rows) - low(rows)) / 5.0


def _largest_db(how: str) -> Callable[[Sequence[Row]], float]:
    """Make a function from the rows to the largest error of the estimates."""
    return value_of("bias_db", lambda values: max(map(abs, values)), how=how)


def _claims() -> Iterator[Claim]:
    for name in _FRONT_ENDS:
        power, shares = f"power, {name}", f"shares, {name}"
        yield Claim(what="step where the jammer rises by 2 dB, middle of the ramp, dB", across=name, paper="close to 2",
                    reference=2.0, same=_step_db(power), better=_step_db(shares), digits=3)  # fmt: skip
        yield Claim(what="largest error from -6 to 40 dB, dB", across=name, paper="saturated",
                    reference=0.0, same=_largest_db(power), better=_largest_db(shares), digits=3)  # fmt: skip
    for column, words in (("bias_db", "mean error, dB"), ("spread_db", "spread, dB"), ("held", "within its limits")):
        for jammer_db in (8.0, 16.0, 24.0, 32.0, 40.0):
            for how in (CN0, GAIN):
                yield Claim(what=f"through protect, logs, {how}: {words}", across=f"{jammer_db:.0f} dB",
                            paper="not stated", digits=2,
                            protect=value_of(column, how=how, jammer_to_noise_db=jammer_db))  # fmt: skip


STUDIES: tuple[Study, ...] = (
    Study(
        name="multi-receiver.jammer-to-noise",
        title="Power of what comes in over the receiver's noise, estimated",
        paper=PAPER,
        figure="Figure 8",
        note="The paper compares the power of samples with that before, too small where the quantiser clips. Ours "
        "takes the noise's sigma from the share of samples below a level. Both take the satellites' own power (here "
        "0.6 dB) for noise. Through protect, a log shows J/N by C/N0, which falls, and by its front end's gain; "
        "*not run* where signals are lost and C/N0 gives a lower bound.",
        run=_run,
        charts=(
            Axes(
                title="Estimated over true J/N",
                x="jammer_to_noise_db",
                y="estimate_db",
                x_label="true J/N, dB",
                y_label="estimated J/N, dB",
                by=("how",),
            ),
        ),
        claims=tuple(_claims()),
    ),
)
