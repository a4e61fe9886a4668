"""Correlator outputs in closed form are what rendered samples give, in mean, variance and correlation."""

from dataclasses import replace

import numpy as np
import pytest

from skyproof.arrays import Complexes
from skyproof.gnss.ephemeris import NavigationData
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.simulator.attacks import Interference, Takeover
from skyproof.simulator.correlation import Replica, compute_correlation, read
from skyproof.simulator.correlators import CorrelatorOutputs, correlate
from skyproof.simulator.received import Scene
from skyproof.simulator.samples import BLOCK, Rendering, prepare_rendering, render, render_quantised
from skyproof.simulator.scenario import FrontEnd, Multipath, Scenario, ScenePlace, SceneReceiver, Sky
from skyproof.simulator.sky import make_scene
from skyproof.simulator.tracked import Tracked, align_channels

START = np.datetime64("2023-03-04T05:06:07.25", "ns")
RATE_HZ = 4_000_250.0  # no millisecond is a whole number of samples, so that what sharp chips fold back averages out
TAPS_CHIPS = np.linspace(-1.2, 1.2, 9)
OFFSETS_HZ = np.array([-20.0, 0.0, 35.0])
MIDDLE_S = 0.0164
COHERENT_S = 0.02


TAKEOVER = Takeover(
    target="one",
    transmit=ScenePlace(lat_deg=40.0003, lon_deg=-3.0002, height_m=660.0),
    power_db=2.0,
    onset_s=-1.0,
    code_offset_m=150.0,
)


def make_overlapping(navigation: NavigationData, front_end: FrontEnd, **changes: object) -> Scene:
    """Make one satellite with a reflection, and a false copy half a chip off, 2 dB stronger."""
    place = {"lat_deg": 40.0, "lon_deg": -3.0, "height_m": 650.0}
    scenario = Scenario(
        seed=7,
        start_gpst=START,
        duration_s=0.2,
        front_end=front_end,
        sky=Sky(zenith_cn0_dbhz=46.0, horizon_cn0_dbhz=46.0),
        receivers=(
            SceneReceiver(
                name="one",
                **place,
                start_offset_s=1.23e-5,
                lo_ppm=0.7,
                multipath=(Multipath(delay_m=90.0, power_db=-5.0, phase_deg=70.0, rate_hz=4.0),),
            ),
        ),
        attacks=(TAKEOVER,),
    ).model_copy(update=changes)
    everything = make_scene(scenario, navigation)
    sat = everything.skies[0].signals[0].id.sat
    alone = scenario.sky.model_copy(update={"sats": (sat,)})
    attack = scenario.attacks[0].model_copy(update={"sats": (sat,), "sat_doppler_hz": {sat: 7.0}})
    return make_scene(scenario.model_copy(update={"sky": alone, "attacks": (attack,)}), navigation)


FILTERED = FrontEnd(rate_hz=RATE_HZ, encoding="float", bits=32, bandwidth_hz=3.2e6)


def make_replicas(
    rendering: Rendering,
    tracked: Tracked,
    channel: int,
    scene: Scene,
    kind: str,
    first: int,
    count: int,
    *,
    middle_s: float = MIDDLE_S,
    wiped: bool = True,
) -> Complexes:
    """Make the replicas of samples, (n_dopplers * n_delays, count), sample by sample."""
    sky, signal, front_end = rendering.sky, rendering.sky.signal, rendering.front_end
    elapsed_s = (first + np.arange(count)) / front_end.rate_hz
    late_s = sky.true_minus_elapsed_s(elapsed_s)
    code_s, carrier_s = (delays[:, channel] for delays in tracked.delays_s(elapsed_s + late_s))
    phase_cyc = signal.carrier_hz * (late_s - carrier_s) + front_end.if_hz * elapsed_s
    sent_s = scene.messages.lead_s + elapsed_s + late_s - code_s
    code = signal.code(prn_of(tracked.signals[channel].sat)).astype(np.float64)
    symbols = scene.messages.symbols[tracked.symbols[channel]].astype(np.float64)
    fine = 64
    period = np.repeat(code, fine)
    if kind == "filtered":
        lines = np.fft.rfft(period)
        hertz = np.arange(lines.size) / signal.period_s
        x = np.clip((hertz / (0.5 * front_end.bandwidth_hz) - 0.75) / 0.5, 0.0, 1.0)
        centred = lines * np.exp(-1j * np.pi * hertz / signal.chip_rate_hz / fine)  # each point stands for its middle
        period = np.fft.irfft(centred * (0.5 + 0.5 * np.cos(np.pi * x)), period.size)
        period /= np.sqrt(np.mean(period**2))
    bits = symbols[np.floor(sent_s / signal.symbol_s).astype(np.int64)] if wiped else np.ones(count)
    spreads = []
    for ahead_chips in TAPS_CHIPS:
        chips = np.mod(sent_s * signal.chip_rate_hz + ahead_chips, code.size)
        if kind == "filtered":
            spreads.append(bits * np.interp(chips * fine, np.arange(period.size + 1), np.append(period, period[0])))
        else:
            spreads.append(bits * code[np.floor(chips).astype(np.int64) % code.size])
    rows = []
    for offset_hz in OFFSETS_HZ:
        carrier = np.exp(-2j * np.pi * (phase_cyc + offset_hz * (elapsed_s - middle_s)))
        rows.extend(carrier * spread for spread in spreads)
    return np.array(rows)


def correlate_trials(scene: Scene, tracked: Tracked, kind: str, trials: int, *, recorded: bool = False) -> Complexes:
    """Correlate samples rendered with one seed a trial: (trials, n_channels, n_dopplers * n_delays)."""
    rendering = prepare_rendering(scene, 0)
    count = round(COHERENT_S * rendering.front_end.rate_hz)
    first = round(MIDDLE_S * rendering.front_end.rate_hz - 0.5 * count)
    assert first >= 0
    assert first + count <= BLOCK
    rows = np.concatenate(
        [
            make_replicas(rendering, tracked, channel, scene, kind, first, count)
            for channel in range(len(tracked.signals))
        ]
    ).astype(np.complex64)
    found = np.empty((trials, rows.shape[0]), np.complex128)
    for trial in range(trials):
        seeded = replace(rendering, seed=1000 + trial)
        planes = render_quantised(seeded, 0) if recorded else render(seeded, 0)
        found[trial] = rows @ (planes[0] + 1j * planes[1])[first : first + count] / count
    return found.reshape(trials, len(tracked.signals), -1)


def assert_same_law(found: Complexes, outputs: CorrelatorOutputs, drawn: Complexes, alpha: float = 1e-3) -> None:
    """Check that the mean, variance and correlations of `found` are those stated, and those drawn, two-sided.

    Each figure is a score of deviation 1; none may lie beyond what chance allows the largest of them.
    """
    trials = found.shape[0]
    found, mean = found.reshape(trials, -1), outputs.mean.ravel()
    sigma = np.repeat(outputs.noise_sigma.ravel(), found.shape[1] // outputs.noise_sigma.size)
    score = (found.mean(axis=0) - mean) / sigma * np.sqrt(trials)
    noise, ours = (found - found.mean(axis=0)) / sigma, (drawn - mean) / sigma
    covariance, stated = noise.T @ noise.conj() / (trials - 1), ours.T @ ours.conj() / len(ours)
    # a complex entry of a covariance of variance 2 has variance 4 / trials, here of both estimates
    entries = (covariance - stated) / np.sqrt(4.0 * (1.0 / trials + 1.0 / len(ours)))
    pseudo = noise.T @ noise / (trials - 1) / np.sqrt(4.0 * 2.0 / trials)  # noise is circular: this one is zero
    limit = np.sqrt(-2.0 * np.log(alpha / (2 * entries.size)))
    for scores in (
        score.real,
        score.imag,
        np.sqrt(2.0) * entries.real,
        np.sqrt(2.0) * entries.imag,
        pseudo.real,
        pseudo.imag,
    ):
        assert np.abs(scores).max() < limit + 0.3
    # the whole at once, in the law's own axes: as many squares of variance 1 as there are axes and trials
    size, axes = np.linalg.eigh(stated)
    kept = size > 0.01
    white = noise @ axes[:, kept].conj() / np.sqrt(size[kept])
    power = (np.abs(white) ** 2).sum() / (trials - 1) / kept.sum()
    assert power == pytest.approx(1.0, abs=3.5 / np.sqrt(trials * kept.sum()) + 0.01)


def list_drawn(outputs: CorrelatorOutputs) -> Complexes:
    return outputs.value.reshape(outputs.value.shape[0], -1).astype(np.complex128)


def draw_outputs(
    scene: Scene, tracked: Tracked, kind: Replica, draws: int, quantised: bool = False
) -> CorrelatorOutputs:
    rate_hz = scene.scenario.front_end.rate_hz
    count = round(COHERENT_S * rate_hz)
    first = round(MIDDLE_S * rate_hz - 0.5 * count)
    return correlate(
        scene,
        0,
        (first + 0.5 * (count - 1)) / rate_hz,
        delays_chips=TAPS_CHIPS,
        dopplers_hz=OFFSETS_HZ,
        coherent_s=count / rate_hz,
        tracked=tracked,
        replica=kind,
        quantised=quantised,
        rng=np.random.default_rng(3),
        draws=(draws,),
    )


@pytest.mark.long
@pytest.mark.parametrize("kind", ["filtered", "chips"])
def test_outputs_follow_the_law_of_rendered_samples(navigation: NavigationData, kind: Replica) -> None:
    scene = make_overlapping(navigation, FILTERED)
    tracked = align_channels(scene, 0)
    outputs = draw_outputs(scene, tracked, kind, 10_000)
    assert_same_law(correlate_trials(scene, tracked, kind, 25), outputs, list_drawn(outputs))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["filtered", "chips"])
def test_outputs_follow_the_law_of_many_rendered_samples(navigation: NavigationData, kind: Replica) -> None:
    scene = make_overlapping(navigation, FILTERED)
    tracked = align_channels(scene, 0)
    outputs = draw_outputs(scene, tracked, kind, 100_000)
    assert_same_law(correlate_trials(scene, tracked, kind, 600), outputs, list_drawn(outputs))


RECORDERS = {
    "sign": FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=3.2e6),
    "two bits, gain control": FrontEnd(
        rate_hz=RATE_HZ, bandwidth_hz=3.2e6, encoding="sign-magnitude", bits=2, agc=True
    ),
    "eight bits": FrontEnd(rate_hz=RATE_HZ, bandwidth_hz=3.2e6, encoding="int", bits=8),
}


@pytest.mark.parametrize("front_end", RECORDERS.values(), ids=RECORDERS)
def test_the_recorders_gain_and_loss_match_quantised_samples(navigation: NavigationData, front_end: FrontEnd) -> None:
    # Under a broadband jammer as strong as the noise, which shifts both.
    jammer = Interference(
        kind="noise", transmit=ScenePlace(lat_deg=40.01, lon_deg=-3.0, height_m=700.0), power_db=0.0, onset_s=-1.0
    )
    scene = make_overlapping(navigation, front_end, interference=(jammer,))
    tracked = align_channels(scene, 0)
    outputs = draw_outputs(scene, tracked, "filtered", 10_000, quantised=True)
    assert_same_law(correlate_trials(scene, tracked, "filtered", 16, recorded=True), outputs, list_drawn(outputs))


def average_correlations(
    scene: Scene, tracked: Tracked, middle_s: float, coherent_s: float, *, wiped: bool = True, kind: str = "filtered"
) -> Complexes:
    """Average rendered samples' correlations without noise, (n_channels, n_dopplers, n_delays)."""
    rendering = prepare_rendering(scene, 0)
    count = round(coherent_s * rendering.front_end.rate_hz)
    first = round(middle_s * rendering.front_end.rate_hz - 0.5 * (count - 1))
    planes = np.concatenate([render(rendering, block, noise=False) for block in range((first + count) // BLOCK + 1)], 1)
    real = rendering.front_end.kind == "real"
    samples = (planes[0] + (0.0 if real else 1j) * planes[1])[first : first + count]
    rows = [
        make_replicas(rendering, tracked, channel, scene, kind, first, count, middle_s=middle_s, wiped=wiped) @ samples
        for channel in range(len(tracked.signals))
    ]
    return np.reshape(rows, (len(rows), OFFSETS_HZ.size, TAPS_CHIPS.size)) / count


def make_attacked(**changes: object) -> tuple[Takeover, ...]:
    return (TAKEOVER.model_copy(update=changes),)


REAL = FrontEnd(rate_hz=8_000_250.0, if_hz=2.1e6, kind="real", encoding="float", bits=32, bandwidth_hz=3.0e6)
NARROW = FrontEnd(rate_hz=2_500_250.0, encoding="float", bits=32, bandwidth_hz=2e6)
CASES = {
    "20 ms": (FILTERED, {}, 0.0164, 0.02, True),
    "1 ms": (FILTERED, {}, 0.0164, 0.001, True),
    "70 ms": (NARROW, {}, 0.04, 0.07, True),
    "bits kept": (NARROW, {}, 0.04, 0.06, False),
    "other bits": (NARROW, {"attacks": make_attacked(message="random")}, 0.04, 0.07, True),
    "guessed bits": (NARROW, {"attacks": make_attacked(guess_s=6.3e-3)}, 0.04, 0.07, True),
    "guessed bits, in chips": (FILTERED, {"attacks": make_attacked(guess_s=5e-5)}, 0.0164, 0.02, True),
    "growing on the true one": (
        NARROW,
        {"attacks": make_attacked(phase="aligned", seamless_s=(-1.0, 19.0))},
        0.04,
        0.02,
        True,
    ),
    "some code periods off": (
        NARROW,
        {"attacks": make_attacked(code_offset_m=1_948_750.0 + 150.0 - 4 * 299_792.458)},
        0.04,
        0.07,
        True,
    ),
    "from the middle on": (NARROW, {"attacks": make_attacked(onset_s=0.035)}, 0.04, 0.07, True),
    "paused": (NARROW, {"attacks": make_attacked(off_s=((0.03, 0.05),))}, 0.04, 0.07, True),
    "real samples": (REAL, {}, 0.006, 0.008, True),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_means_are_those_of_samples_without_noise(
    navigation: NavigationData, case: tuple[FrontEnd, dict[str, object], float, float, bool]
) -> None:
    front_end, changes, middle_s, coherent_s, wiped = case
    scene = make_overlapping(navigation, front_end, **changes)
    tracked = align_channels(scene, 0)
    found = average_correlations(scene, tracked, middle_s, coherent_s, wiped=wiped)
    outputs = correlate(
        scene,
        0,
        [middle_s],
        delays_chips=TAPS_CHIPS,
        dopplers_hz=OFFSETS_HZ,
        coherent_s=coherent_s,
        tracked=tracked,
        replica="filtered",
        wiped=wiped,
        quantised=False,
    )
    assert np.abs(found - outputs.mean[0]).max() < 2.5e-3 * np.abs(found).max()


@pytest.mark.long
def test_other_satellites_are_the_noise_that_they_are_said_to_be(
    navigation: NavigationData, scenario: Scenario
) -> None:
    # What a whole sky adds to correlations of a millisecond, over its signals and many instants.
    clean = scenario.model_copy(update={"duration_s": 0.2, "attacks": (), "front_end": FILTERED})
    scene = make_scene(clean, navigation)
    tracked = align_channels(scene, 0)
    middles_s = 0.003 + 0.0072 * np.arange(4)
    found = np.stack([average_correlations(scene, tracked, middle_s, 0.001) for middle_s in middles_s])
    alone = correlate(
        scene,
        0,
        middles_s,
        delays_chips=TAPS_CHIPS,
        dopplers_hz=OFFSETS_HZ,
        coherent_s=0.001,
        replica="filtered",
        quantised=False,
    )
    noisy = correlate(
        scene, 0, middles_s, delays_chips=[0.0], coherent_s=0.001, replica="filtered", quantised=False, others="noise"
    )
    added = np.sqrt(np.mean(noisy.noise_sigma**2 - alone.noise_sigma**2))
    rms = np.sqrt(np.mean(np.abs(found - alone.mean) ** 2) / 2.0)
    assert rms == pytest.approx(added, rel=0.25)
    assert added < alone.noise_sigma.min()


def test_truth_is_attached(navigation: NavigationData) -> None:
    scene = make_overlapping(navigation, FILTERED)
    sky = scene.skies[0]
    parts = correlate(scene, 0, [0.02, 0.1], delays_chips=[0.0]).parts
    true_s = np.array([0.02, 0.1]) + sky.true_minus_elapsed_s(np.array([0.02, 0.1]))
    late_chips = sky.code_delay_s(true_s) * sky.signal.chip_rate_hz
    of = {
        (int(c), int(s), int(r)): part
        for part, (c, s, r) in enumerate(zip(parts.channel, parts.signal, parts.ray, strict=True))
    }
    assert [parts.label[of[0, 0, -1]], parts.label[of[0, 1, -1]], parts.label[of[0, 0, 0]]] == [
        "authentic",
        "spoofed",
        "multipath",
    ]
    np.testing.assert_allclose(parts.lag_chips[:, of[0, 1, -1]], late_chips[:, 1] - late_chips[:, 0], atol=1e-6)
    np.testing.assert_allclose(parts.lag_chips[:, of[0, 0, 0]], 90.0 / 293.0523, rtol=1e-4)
    np.testing.assert_allclose(parts.doppler_hz[:, of[0, 1, -1]], 7.0, atol=1e-3)
    np.testing.assert_allclose(parts.doppler_hz[:, of[1, 1, -1]], 0.0, atol=1e-9)


def test_replicas_may_stand_anywhere(navigation: NavigationData) -> None:
    # A replica moved later and higher sees everything earlier and lower.
    scene = make_overlapping(navigation, FILTERED)
    carrier_hz = scene.skies[0].signal.carrier_hz
    moved = align_channels(scene, 0, [0]).move(code_s=0.25 / 1.023e6, doppler_hz=12.0, carrier_hz=carrier_hz)
    parts = correlate(scene, 0, [0.1], delays_chips=[0.0], tracked=moved).parts
    assert parts.lag_chips[0, 0] == pytest.approx(-0.25, abs=1e-9)
    assert parts.doppler_hz[0, 0] == pytest.approx(-12.0, abs=1e-4)
    there = correlate(
        scene, 0, [0.1], delays_chips=[0.1 - 0.25], dopplers_hz=[12.0], tracked=align_channels(scene, 0, [0])
    )
    same = correlate(scene, 0, [0.1], delays_chips=[0.1], tracked=moved)
    assert np.abs(there.mean) == pytest.approx(np.abs(same.mean), rel=1e-5)


def test_taps_are_absent_while_their_signal_is(navigation: NavigationData) -> None:
    scene = make_overlapping(navigation, FILTERED, attacks=make_attacked(onset_s=0.05))
    outputs = correlate(scene, 0, [0.02, 0.1], delays_chips=TAPS_CHIPS, rng=np.random.default_rng(1), draws=(2,))
    taps = outputs.taps(1)
    assert taps.value.shape == (2, 2, 1, 9)
    assert np.isfinite(taps.value).all(axis=(2, 3)).tolist() == [[True, False], [True, True]]
    np.testing.assert_array_equal(taps.value[:, 0], outputs.value[1, :, 0])


def test_the_same_generator_gives_the_same_outputs(navigation: NavigationData) -> None:
    scene = make_overlapping(navigation, FILTERED)
    first, other = (
        correlate(scene, 0, [0.02, 0.1], delays_chips=TAPS_CHIPS, rng=np.random.default_rng(5), draws=(2, 3)).value
        for _ in range(2)
    )
    assert first.tobytes() == other.tobytes()
    assert first.shape == (2, 3, 2, 2, 1, 9)


def test_a_triangle_without_a_filter_and_less_with_one() -> None:
    chips = compute_correlation([5], GPS_L1_CA, FrontEnd())
    lags = np.array([0.0, 0.25, -0.5, 1.0, 1023.0])
    np.testing.assert_allclose(read(chips.signal[0], lags, chips.points)[:3], [1.0, 0.75, 0.5], atol=1e-3)
    np.testing.assert_allclose(read(chips.signal[0], lags, chips.points)[3:], [-1.0 / 1023.0, 1.0], atol=1e-12)
    wide, narrow = (compute_correlation([5], GPS_L1_CA, FrontEnd(rate_hz=20e6, bandwidth_hz=hz)) for hz in (16e6, 2e6))
    peak = [each.signal[0, 0] for each in (wide, narrow)]
    assert 0.9 < peak[1] < peak[0] < 1.0  # sharp chips are no matched filter of what the front end lets pass
    assert wide.signal.argmax() == narrow.signal.argmax() == 0


@pytest.mark.parametrize("kind", ["filtered", "chips"])
def test_channels_on_one_replica_hear_one_noise(navigation: NavigationData, kind: Replica) -> None:
    # Three hypotheses of one signal: two in one place, one three taps later; many taps, and so nearly singular.
    scene = make_overlapping(navigation, FILTERED)
    for columns in ([0, 0], [0, 0, 0]):
        shift_chips = np.array([0.0, 0.0, 0.15])[: len(columns)]
        tracked = align_channels(scene, 0, columns).move(code_s=shift_chips / 1.023e6, carrier_hz=1575.42e6)
        outputs = correlate(
            scene,
            0,
            [0.1],
            delays_chips=np.linspace(-1.0, 1.0, 41),
            tracked=tracked,
            replica=kind,
            rng=np.random.default_rng(2),
            draws=(800,),
        )
        noise = (outputs.value - outputs.mean)[:, 0, :, 0] / outputs.noise_sigma[0, 0]
        assert noise.std() == pytest.approx(np.sqrt(2.0), rel=0.05)
        np.testing.assert_allclose(noise[:, 1], noise[:, 0], atol=2e-3)
        if len(columns) == 3:  # a replica later by three taps' distance; between points of the table lines are straight
            np.testing.assert_allclose(noise[:, 2, 3:], noise[:, 0, :-3], atol=0.03 * np.abs(noise).max())


def test_the_short_way_for_two_channels_is_the_long_one(navigation: NavigationData) -> None:
    # Without Doppler taps two channels' noise is drawn by other steps: the same law.
    scene = make_overlapping(navigation, FILTERED)
    draws = 20_000
    found = []
    for offsets_hz in ([0.0], [0.0, 30.0]):
        outputs = correlate(
            scene,
            0,
            [0.1],
            delays_chips=TAPS_CHIPS,
            dopplers_hz=offsets_hz,
            draws=(draws,),
            rng=np.random.default_rng(len(offsets_hz)),
        )
        noise = ((outputs.value - outputs.mean)[:, 0, :, 0] / outputs.noise_sigma[0, 0]).reshape(draws, -1)
        found.append(noise.T @ noise.conj() / draws)
    scores = (found[0] - found[1]) / np.sqrt(4.0 * 2.0 / draws)
    assert np.abs(scores).max() < 4.5
    assert np.abs(found[0][:9, 9:]).max() > 0.5  # the channels hear much of one noise
