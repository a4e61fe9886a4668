"""The likenesses of TEXBAT's ds7 and ds8 keep to the published recipe, measured on rendered samples and correlators.

What is false is what a scene's samples have over those of the same scene without the attack. The figures are those of
Humphreys, "TEXBAT data sets 7 and 8", 2016, section 4.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import scipy

from skyproof.arrays import Booleans, Complexes, Reals
from skyproof.gnss.constants import CA_CHIP_RATE_HZ, SPEED_OF_LIGHT_M_S
from skyproof.gnss.signals import GPS_L1_CA, prn_of
from skyproof.simulator.constellation import make_navigation
from skyproof.simulator.correlators import CorrelatorOutputs, correlate
from skyproof.simulator.received import Scene
from skyproof.simulator.samples import BLOCK, Rendering, prepare_rendering, render, render_samples
from skyproof.simulator.scenario import Scenario
from skyproof.simulator.scenes import read_ready_made
from skyproof.simulator.sky import make_scene
from skyproof.simulator.tracked import align_channels
from skyproof.simulator.truth import compute_signal_truth

RATE_HZ = 25e6
SAT = "G06"
SAMPLE_M = SPEED_OF_LIGHT_M_S / RATE_HZ
CHIP_M = SPEED_OF_LIGHT_M_S / CA_CHIP_RATE_HZ
GUESS_S = 50e-6
BIT_S = 0.02


def find_published_phase_deg(at_s: Reals) -> Reals:
    """Return the published phase of the false signal against the true one."""
    return np.interp(at_s, [110.0, 130.0], [90.0, 180.0])


def find_published_amplitude(at_s: Reals) -> Reals:
    """Return the published amplitude of the false signal over that of the true one."""
    grown = np.where(at_s < 130.0, -2.0 * np.cos(np.radians(find_published_phase_deg(at_s))), 2.0)
    return np.asarray(np.where(at_s < 110.0, 0.0, np.where(at_s < 150.0, grown, np.interp(at_s, [150, 400], [2, 1]))))


def find_published_delay_m(at_s: Reals) -> Reals:
    return np.asarray(1.2 * np.maximum(at_s - 150.0, 0.0))


@cache
def make_likeness(number: int, *, attacked: bool = True, sat: str | None = None) -> Scene:
    """Make a likeness with all its satellites, or with one that no other disturbs."""
    scenario = read_ready_made(f"texbat-like-{number}")
    return work_out(scenario, scenario.attacks if attacked else (), sat)


def work_out(scenario: Scenario, attacks: tuple, sat: str | None) -> Scene:  # type: ignore[type-arg]
    sats = None if sat is None else (sat,)
    changes = {
        "attacks": tuple(attack.model_copy(update={"sats": sats}) for attack in attacks),
        "sky": scenario.sky.model_copy(update={"sats": sats}),
    }
    return make_scene(scenario.model_copy(update=changes), make_navigation(scenario))


# ------------------------------------------------------------------ what samples hold


@cache
def make_rendering(number: int, attacked: bool) -> Rendering:
    return prepare_rendering(make_likeness(number, attacked=attacked, sat=SAT), 0)


def render_at(of: Rendering, first: int, count: int) -> Complexes:
    """Render samples without noise, before the quantiser."""
    blocks = range(first // BLOCK, (first + count - 1) // BLOCK + 1)
    planes = np.concatenate([render(of, block, noise=False) for block in blocks], axis=1)
    start = first - blocks[0] * BLOCK
    return np.asarray((planes[0] + 1j * planes[1])[start : start + count])


def render_true_and_false(number: int, elapsed_s: float, count: int) -> tuple[Complexes, Complexes]:
    """Samples of one satellite's true and false signal from a moment on."""
    first = round(elapsed_s * RATE_HZ)
    true = render_at(make_rendering(number, False), first, count)
    return true, render_at(make_rendering(number, True), first, count) - true


def mix_down(of: Scene, samples: Complexes, elapsed_s: float) -> Complexes:
    """Samples from a moment on, with the true signal's carrier taken off."""
    sky = of.skies[0]
    at_s = elapsed_s + np.arange(samples.size) / RATE_HZ
    late_s = sky.true_minus_elapsed_s(at_s)
    phase_cyc = GPS_L1_CA.carrier_hz * (late_s - sky.carrier_delay_s(at_s + late_s)[:, 0])
    return np.asarray(samples * np.exp(-2j * np.pi * phase_cyc))


@dataclass(frozen=True)
class Copy:
    """How a false signal differs from the true one."""

    amplitude: float
    phase_deg: float
    delay_m: float


def compare(number: int, middle_s: float, count: int = 1 << 15) -> Copy:
    """Find the delay at which the false samples are most like the true ones, and their ratio there."""
    from_s = round((middle_s - 0.5 * count / RATE_HZ) * RATE_HZ) / RATE_HZ
    taper = np.hanning(count)  # a delay moves samples in at one end and out at the other
    true, false = (
        taper * mix_down(make_likeness(number, attacked=False, sat=SAT), samples, from_s)
        for samples in render_true_and_false(number, from_s, count)
    )
    hertz = np.fft.fftfreq(count, 1.0 / RATE_HZ)
    cross = np.fft.fft(false) * np.fft.fft(true).conj()

    def compute_likeness(delay_m: float) -> complex:
        return complex(np.sum(cross * np.exp(2j * np.pi * hertz * delay_m / SPEED_OF_LIGHT_M_S)))

    rough = int(np.abs(np.fft.ifft(cross)).argmax())
    rough_m = (rough if rough < count // 2 else rough - count) * SAMPLE_M
    best_m = scipy.optimize.minimize_scalar(
        lambda m: -abs(compute_likeness(m)), bounds=(rough_m - SAMPLE_M, rough_m + SAMPLE_M), method="bounded"
    ).x
    ratio = compute_likeness(best_m) / np.sum(np.abs(true) ** 2) / count
    return Copy(abs(ratio), float(np.degrees(np.angle(ratio)) % 360.0), best_m)


STAGES_S = (111.0, 115.0, 120.0, 125.0, 129.0, 131.0, 140.0, 149.0, 151.0, 200.0, 275.0, 399.0, 401.0, 430.0, 467.0)


def test_samples_hold_nothing_false_until_110_s() -> None:
    _, false = render_true_and_false(7, 109.9999, 5_000)
    elapsed_s = 109.9999 + int(np.flatnonzero(false)[0]) / RATE_HZ
    true_s = elapsed_s + float(make_likeness(7, sat=SAT).skies[0].true_minus_elapsed_s(elapsed_s))
    assert true_s == pytest.approx(110.0, abs=0.3e-6)  # 50 m from the transmit antenna
    assert not render_true_and_false(7, 60.0, 5_000)[1].any()
    assert not render_true_and_false(8, 109.99, 5_000)[1].any()


def test_every_stage_of_the_recipe_is_in_the_samples() -> None:
    # The false signal's amplitude to 0.3 %, its phase to 0.2 degrees, its code to 5 cm.
    found = [compare(7, at_s) for at_s in STAGES_S]
    at_s = np.array(STAGES_S)
    assert [item.amplitude for item in found] == pytest.approx(find_published_amplitude(at_s), rel=3e-3)
    assert [item.phase_deg for item in found] == pytest.approx(find_published_phase_deg(at_s), abs=0.2)
    assert [item.delay_m for item in found] == pytest.approx(find_published_delay_m(at_s), abs=0.05)


def test_the_stages_begin_and_end_where_they_should() -> None:
    # Corners of amplitude and code at 130, 150 and 400 s, none of them rounded.
    corners_s = np.array([129.5, 130.5, 149.5, 150.5, 399.5, 400.5])
    found = [compare(7, at_s) for at_s in corners_s]
    assert [item.amplitude for item in found] == pytest.approx([1.99846, 2.0, 2.0, 1.998, 1.002, 1.0], abs=1e-3)
    assert [item.phase_deg for item in found] == pytest.approx([177.75, 180.0, 180.0, 180.0, 180.0, 180.0], abs=0.1)
    assert [item.delay_m for item in found] == pytest.approx([0.0, 0.0, 0.0, 0.6, 299.4, 300.6], abs=0.02)


def test_the_sum_keeps_its_amplitude_and_turns_half_a_cycle() -> None:
    at_s = np.array([110.5, 112.0, 115.0, 118.0, 120.0, 122.0, 125.0, 128.0, 129.9, 135.0, 145.0, 149.9])
    sums = []
    for middle_s in at_s:
        true, false = render_true_and_false(7, float(middle_s), 1 << 14)
        sums.append(np.vdot(true, true + false) / np.vdot(true, true))
    assert np.abs(sums) == pytest.approx(1.0, abs=1e-3)
    turned_deg = np.degrees(np.unwrap(np.angle(sums)))
    assert turned_deg == pytest.approx(180.0 * np.clip((at_s - 110.0) / 20.0, 0.0, 1.0), abs=0.1)


def test_the_truth_is_what_the_samples_hold() -> None:
    table = compute_signal_truth(make_likeness(7, sat=SAT), "roof")
    false = table["label"] == "spoofed"
    matching = {
        name: table[name][~false] for name in table if name.endswith(("authentic", "authentic_m", "authentic_hz"))
    }
    assert (matching["amplitude_to_authentic"] == 1.0).all()
    assert not matching["delay_to_authentic_m"].any()
    assert not matching["doppler_to_authentic_hz"].any()
    for wanted_s in (113.0, 140.0, 300.0, 460.0):
        row = np.flatnonzero(false)[np.abs(table["true_s"][false] - wanted_s).argmin()]
        found = compare(7, float(table["elapsed_s"][row]))
        assert table["amplitude_to_authentic"][row] == pytest.approx(found.amplitude, rel=3e-3)
        assert 360.0 * table["phase_to_authentic_cyc"][row] == pytest.approx(found.phase_deg, abs=0.2)
        assert table["delay_to_authentic_m"][row] == pytest.approx(found.delay_m, abs=0.05)
        turns_hz = 0.25 / 20.0 if wanted_s < 130.0 else 0.0
        assert table["doppler_to_authentic_hz"][row] == pytest.approx(turns_hz, abs=1e-4)


# ------------------------------------------------------------------ what correlators hold


TAPS_CHIPS = np.linspace(-3.0, 3.0, 121)
INSIDE = slice(35, -35)  # of the taps, with room for delays on both sides
SATS = ("G04", "G05", "G06", "G11", "G12", "G19", "G26", "G27", "G30", "G31")


def draw_correlators(number: int, at_s: Reals, *sats: str, attacked: bool = True) -> CorrelatorOutputs:
    """Draw correlators without noise on true signals, over about whole bits."""
    of = make_likeness(number, attacked=attacked)
    signals = [(heard.id.sat, heard.label) for heard in of.skies[0].signals]
    tracked = align_channels(of, 0, [signals.index((sat, "authentic")) for sat in sats])
    return correlate(of, 0, at_s, delays_chips=TAPS_CHIPS, coherent_s=BIT_S, tracked=tracked, quantised=False)


@pytest.mark.parametrize(
    ("number", "sats"),
    [
        (7, ("G06", "G31")),
        pytest.param(7, SATS, marks=pytest.mark.long),
        pytest.param(8, SATS, marks=pytest.mark.long),
    ],
)
def test_correlators_of_every_satellite_see_one_takeover(number: int, sats: tuple[str, ...]) -> None:
    # Amplitude, phase and delay of what they have over a clean sky's; guesses cost ds8 half a percent at most.
    at_s = np.array(STAGES_S)
    clean = draw_correlators(number, at_s, *sats, attacked=False).mean[:, :, 0]
    false = draw_correlators(number, at_s, *sats).mean[:, :, 0] - clean
    present = np.abs(false).max(axis=2) > 0.0
    assert present[:, :-1].all()
    assert present[:, -1].sum() == at_s.size - 2  # G31 sets before the end
    lost = 0.0 if number == 7 else 2.0 * GUESS_S / BIT_S
    for epoch, channel in np.argwhere(present):
        found = find_likeness(false[epoch, channel], clean[epoch, channel], float(find_published_delay_m(at_s[epoch])))
        amplitude = float(find_published_amplitude(at_s[epoch]))
        assert amplitude * (1.0 - lost) - 2e-3 < found.amplitude < amplitude + 2e-3
        assert found.phase_deg == pytest.approx(find_published_phase_deg(at_s[epoch]), abs=0.1)
        assert found.delay_m == pytest.approx(find_published_delay_m(at_s[epoch]), abs=0.1)


def find_likeness(false: Complexes, true: Complexes, near_m: float) -> Copy:
    """Find the delay within 20 m at which correlations are most alike, and their ratio there."""
    shape = scipy.interpolate.CubicSpline(TAPS_CHIPS, true)

    def like(delay_m: float) -> Complexes:
        return np.asarray(shape(TAPS_CHIPS[INSIDE] + delay_m / CHIP_M))

    def unlike(delay_m: float) -> float:
        return -abs(np.vdot(like(delay_m), false[INSIDE])) / float(np.linalg.norm(like(delay_m)))

    bounds = near_m - 20.0, near_m + 20.0
    best_m = scipy.optimize.minimize_scalar(unlike, bounds=bounds, method="bounded").x
    ratio = np.vdot(like(best_m), false[INSIDE]) / np.linalg.norm(like(best_m)) ** 2
    return Copy(float(abs(ratio)), float(np.degrees(np.angle(ratio)) % 360.0), best_m)


def test_the_sum_shows_nothing_but_its_turn_until_150_s() -> None:
    # C/N0 and shape, that is delay, of every satellite's correlation stay; its carrier turns by 0.025 Hz and stops.
    at_s = np.arange(110.05, 149.96, 0.7)
    clean = draw_correlators(7, at_s, "G05", "G27", attacked=False).mean[:, :, 0]
    means = draw_correlators(7, at_s, "G05", "G27").mean[:, :, 0]
    strong = slice(45, -45)  # within 0.75 chip
    ratio = (means / clean)[..., strong]
    assert np.abs(ratio) == pytest.approx(1.0, abs=1e-3)
    turned_deg = np.degrees(np.unwrap(np.angle(ratio), axis=0))
    published_deg = 180.0 * np.clip((at_s - 110.0) / 20.0, 0.0, 1.0)
    assert turned_deg == pytest.approx(np.broadcast_to(published_deg[:, None, None], turned_deg.shape), abs=0.1)


def test_codes_are_dragged_evenly_and_carriers_are_not() -> None:
    # By the truth that is attached to correlators.
    at_s = np.linspace(150.1, 467.9, 60)
    parts = draw_correlators(7, at_s, "G04", "G30").parts
    false = [part for part, label in enumerate(parts.label) if label == "spoofed"]
    delay_m = parts.lag_chips[:, false] * CHIP_M
    assert delay_m == pytest.approx(np.broadcast_to(1.2 * (at_s - 150.0)[:, None], delay_m.shape), abs=2e-3)
    assert parts.doppler_hz[:, false] == pytest.approx(0.0, abs=1e-4)
    assert np.abs(parts.phase_cyc[:, false]) == pytest.approx(0.5, abs=1e-4)


# ------------------------------------------------------------------ ds8's guesses


def find_false_column(of: Scene, sat: str) -> int:
    return next(n for n, heard in enumerate(of.skies[0].signals) if (heard.id.sat, heard.label) == (sat, "spoofed"))


def find_bit_edges_s(of: Scene, sat: str, from_s: float, until_s: float) -> Reals:
    """Find when bits of a false signal begin, by the sampling clock."""
    sky = of.skies[0]
    elapsed_s = np.linspace(from_s, until_s, 1001)
    true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
    bits = (of.messages.lead_s + true_s - sky.code_delay_s(true_s)[:, find_false_column(of, sat)]) / BIT_S
    return np.asarray(np.interp(np.arange(np.ceil(bits[0]), np.floor(bits[-1]) + 1.0), bits, elapsed_s))


def test_guesses_are_wrong_for_50_us_after_bits_begin_only() -> None:
    # Over 0.2 s of samples while the false signal is antipodal: where it is the true one's like, a guess is wrong.
    from_s, count = 140.0, round(0.2 * RATE_HZ)
    true, false = render_true_and_false(8, from_s, count)
    wrong = (false * true.conj()).real > 0.0
    changes = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]]).astype(np.int8)))
    starts, ends = changes[::2], changes[1::2]
    edges = (find_bit_edges_s(make_likeness(8, sat=SAT), SAT, from_s, from_s + count / RATE_HZ) - from_s) * RATE_HZ
    assert 2 <= starts.size < edges.size
    assert np.abs(starts[:, np.newaxis] - edges).min(axis=1).max() < 2.0  # samples
    assert (ends - starts) / RATE_HZ == pytest.approx(GUESS_S, abs=2.0 / RATE_HZ)
    assert np.abs(false + 2.0 * true)[~wrong].max() < 1e-3 * np.abs(true).max()  # elsewhere, ds8 is ds7


def find_wrong_guesses(sat: str, from_s: float, until_s: float) -> Booleans:
    """Find which guesses of a satellite's bits were wrong, by correlators that see nothing else."""
    the_scene = make_likeness(8)
    column = find_false_column(the_scene, sat)
    outputs = correlate(
        the_scene,
        0,
        find_bit_edges_s(the_scene, sat, from_s, until_s) + 0.5 * GUESS_S,
        delays_chips=[0.0],
        coherent_s=0.9 * GUESS_S,
        tracked=align_channels(the_scene, 0, [column]),
    )
    (part,) = np.flatnonzero(outputs.parts.signal == column)
    weight = outputs.parts.weight[:, part]
    assert np.abs(weight.imag).max() < 1e-3 * np.abs(weight).min()
    return np.asarray(weight.real < 0.0)


def test_guesses_are_a_coins_throws() -> None:
    # Wrong in half of all bits, neither alike from bit to bit nor from satellite to satellite.
    wrong = [find_wrong_guesses(sat, 151.0, 171.0)[:999] for sat in ("G05", "G06", "G27")]
    assert all(abs(np.mean(item) - 0.5) < 4.0 * 0.5 / np.sqrt(item.size) for item in wrong)
    pairs = [
        (wrong[0], wrong[1]),
        (wrong[1], wrong[2]),
        (wrong[0], wrong[2]),
        *((item[1:], item[:-1]) for item in wrong),
    ]
    for item, other in pairs:
        assert abs(np.mean(item == other) - 0.5) < 4.0 * 0.5 / np.sqrt(item.size)


def test_after_its_guess_each_bit_is_right() -> None:
    at_s = find_bit_edges_s(make_likeness(8), SAT, 141.0, 143.0) + GUESS_S + 0.5 * 0.019
    the_scene = make_likeness(8)
    on_it = align_channels(the_scene, 0, [find_false_column(the_scene, SAT)])
    outputs = correlate(the_scene, 0, at_s, delays_chips=[0.0], coherent_s=0.019, tracked=on_it, wiped=True)
    (false,) = np.flatnonzero(np.array(outputs.parts.label) == "spoofed")
    (true,) = np.flatnonzero(np.array(outputs.parts.label) == "authentic")
    ratio = outputs.parts.weight[:, false] / outputs.parts.weight[:, true]
    assert ratio == pytest.approx(np.full(at_s.size, -2.0), abs=1e-3)


# ------------------------------------------------------------------ as they are written


def test_pieces_are_the_whole() -> None:
    scenario = make_likeness(8, sat=SAT).scenario
    (samples,) = render_samples(scenario, make_navigation(scenario))
    start, count = round(130.0 * RATE_HZ) - 200_001, 400_000
    whole = samples.read(start, count)
    (again,) = render_samples(scenario, make_navigation(scenario))
    pieces, position = [], start
    for size in (1, 77_777, 131_072, 2, 100_003, 91_145):
        pieces.append(again.read(position, size))
        position += size
    assert position == start + count
    np.testing.assert_array_equal(np.concatenate(pieces, axis=1), whole)
    assert set(np.unique(whole)) == {-3.0, -1.0, 1.0, 3.0}


def test_correlators_one_by_one_are_those_of_all_at_once() -> None:
    at_s = np.array([112.0, 130.0, 149.9995, 399.0])
    whole = draw_correlators(8, at_s, SAT).mean
    for epoch in range(at_s.size):
        np.testing.assert_allclose(draw_correlators(8, at_s[[epoch]], SAT).mean[0], whole[epoch], rtol=1e-9, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("number", [7, 8])
def test_recorded_samples_show_no_change_of_power_until_150_s(number: int) -> None:
    # As a receiver has them, with noise and two bits: 0.4 s at a time.
    # The power of the samples, and the amplitude of each correlation with the true signal, stay within what noise
    # allows them; the carriers turn by half a cycle.
    of = make_likeness(number)
    (samples,) = render_samples(of.scenario, make_navigation(of.scenario))
    sky, count = of.skies[0], round(0.4 * RATE_HZ)
    at_s = np.array([100.0, 114.0, 120.0, 126.0, 140.0])
    true = [column for column, heard in enumerate(sky.signals) if heard.label == "authentic"]
    powers, sums = [], []
    for from_s in at_s:
        first = round(from_s * RATE_HZ)
        planes = samples.read(first, count)
        powers.append(np.mean(planes.astype(np.float64) ** 2))
        sums.append([correlate_pieces(of, column, planes[0] + 1j * planes[1], first) for column in true])
    # the variance of a square of two-bit noise is 13.9; of the mean of 2 n of them, much less
    assert np.array(powers) == pytest.approx(powers[0], abs=5.0 * np.sqrt(2.0 * 13.9 / (2 * count)))
    outputs = correlate(
        of, 0, at_s[:1] + 0.2, delays_chips=[0.0], coherent_s=0.4, tracked=align_channels(of, 0, true), others="noise"
    )
    sigma, level = outputs.noise_sigma[0], np.abs(outputs.mean[0, :, 0, 0])
    allowed = 5.0 * np.sqrt(2.0) * sigma / level + 0.005
    assert allowed.max() < 0.1
    turned_rad = np.pi * np.clip((at_s + 0.2 - 110.0) / 20.0, 0.0, 1.0)[:, np.newaxis]
    ratio = np.array(sums) / np.array(sums[0]) * np.exp(-1j * turned_rad)
    assert (np.abs(ratio - 1.0) < allowed).all()
    assert np.abs(ratio.mean(axis=1) - 1.0).max() < 0.02


def correlate_pieces(of: Scene, column: int, samples: Complexes, first: int) -> complex:
    """Correlate with a replica of a signal and its bits, 0.1 s after 0.1 s, turned as the truth has it."""
    sky, signal = of.skies[0], GPS_L1_CA
    code = signal.code(prn_of(sky.signals[column].id.sat)).astype(np.float32)
    symbols = of.messages.symbols[of.messages.names.index((sky.signals[column].id.sat, ""))].astype(np.float32)
    total, step = 0.0 + 0.0j, 100_000
    for start in range(0, samples.size, step):
        ends_s = (first + start + np.array([0.0, step])) / RATE_HZ
        late_s = sky.true_minus_elapsed_s(ends_s)
        code_s, carrier_s = (delays[:, column] for delays in sky.delays_s(ends_s + late_s))
        share = np.arange(step) / step
        phase_cyc = np.interp(share, [0.0, 1.0], signal.carrier_hz * (late_s - carrier_s) % 1.0e6)
        sent_s = of.messages.lead_s + ends_s[0] + late_s[0] - code_s[0]
        sent_s = sent_s + share * (np.diff(ends_s + late_s - code_s)[0])
        chips = code[np.floor(sent_s * signal.chip_rate_hz).astype(np.int64) % code.size]
        replica = chips * symbols[np.floor(sent_s / signal.symbol_s).astype(np.int64)] * np.exp(2j * np.pi * phase_cyc)
        total += np.vdot(replica, samples[start : start + step])
    return total / samples.size
