"""How the receiver works: loops, taps, searches, and what it takes to lose a signal."""

from dataclasses import dataclass

from skyproof.gnss.signals import GPS_L1_CA, GPS_SATS, SignalPlan
from skyproof.receiver.acquisition import SearchSettings
from skyproof.records import CcafAsked

__all__ = ["LOCK_FRAMES", "MEASURE_FRAMES", "TELEMETRY_FRAMES", "LoopSettings", "ReceiverSettings"]

MEASURE_FRAMES = 2
TELEMETRY_FRAMES = 5
LOCK_FRAMES = 5

SEARCH = SearchSettings(coherent_periods=1, n_sums=20)
NEAR_SEARCH = SearchSettings(coherent_periods=4, n_sums=5)


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """Coherent integration in code periods (a divisor of a bit's) and loop bandwidths in hertz."""

    integration: int
    pll_bandwidth_hz: float
    fll_bandwidth_hz: float = 0.0
    dll_bandwidth_hz: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ReceiverSettings:
    """How the receiver works. Times in seconds of receiver time.

    early_late_chips : spacing between early and late tap.
    further_taps_chips : taps beside early, prompt and late, ahead of prompt positive.
    further_taps_hz : Dopplers beside the carrier's at which all taps are taken as well.
    looks_per_frame, look_share : all taps are taken in this share of so many equal parts of a frame, and averaged over
        each; 0 takes them all the time and averages over a row of measurements.
    grids : which correlation grids are taken; None takes none.
    least_dbhz : weaker signals are not measured: every third slip of their carriers goes unseen, and so do more and
        more false locks (`false_lock`).
    pull_in, searching_bits, tracking, weak : the loops for `pull_in_s`; until bits are known; then; and below
        `weak_dbhz` (with 2 dB of hysteresis).
    confirm_s : after that time a channel must be locked or is dropped.
    coast_s : for so long a confirmed channel whose signal has faded coasts; then the signal is lost.
    guided_s : for so long it does where it is guided (`guidance`).
    false_hold_probability : that noise passes for a locked signal in one look at the last half second.
    false_return_probability : that noise passes for a signal in the power of one frame.
    false_gap_probability : that bits which did not move are taken for moved by missing samples, a look.
    near_search_s, full_search_s : how often further signals are looked for near the Doppler of tracked and lost ones,
        and of every satellite at every Doppler; the latter every `first_search_s` until the first signal is found.
    pulled_chips : by as much code and carrier may part before a channel counts as pulled away from its signal.
    """

    signal: SignalPlan = GPS_L1_CA
    sats: tuple[str, ...] = GPS_SATS
    frame_s: float = 0.1
    early_late_chips: float = 0.25
    further_taps_chips: tuple[float, ...] = ()
    further_taps_hz: tuple[float, ...] = ()
    looks_per_frame: int = 0
    look_share: float = 1.0
    grids: CcafAsked | None = None
    code_phases: int = 32
    # Of 5 ms: a frequency loop of 1 ms shakes by 18 Hz at 35 dB-Hz and loses every other signal.
    pull_in: LoopSettings = LoopSettings(
        integration=5, pll_bandwidth_hz=15.0, fll_bandwidth_hz=5.0, dll_bandwidth_hz=4.0
    )
    searching_bits: LoopSettings = LoopSettings(integration=5, pll_bandwidth_hz=15.0)
    tracking: LoopSettings = LoopSettings(integration=5, pll_bandwidth_hz=15.0)
    weak: LoopSettings = LoopSettings(integration=20, pll_bandwidth_hz=6.0, dll_bandwidth_hz=0.5)
    weak_dbhz: float = 31.0
    least_dbhz: float = 25.0
    pull_in_s: float = 0.5
    confirm_s: float = 0.8
    coast_s: float = 10.0
    guided_s: float = 60.0
    false_hold_probability: float = 1e-4
    false_return_probability: float = 1e-3
    false_gap_probability: float = 1e-8
    merge_chips: float = 0.5
    pulled_chips: float = 0.1
    near_search_s: float = 0.5
    full_search_s: float = 10.0
    first_search_s: float = 1.0
    doppler_max_hz: float = 7000.0
    near_doppler_hz: float = 125.0
    search: SearchSettings = SEARCH
    near_search: SearchSettings = NEAR_SEARCH
