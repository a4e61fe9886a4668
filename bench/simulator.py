"""The simulator's three depths: how much faster than real time samples come, beside plain NumPy; how many sets of
correlator outputs a second, beside correlating samples; how many measurements."""

from collections.abc import Iterator
from functools import partial
from time import process_time

import numpy as np
from numpy.typing import NDArray
from timing import line, take_turns

from skyproof.gnss.nominal import make_nominal_constellation
from skyproof.gnss.signals import prn_of
from skyproof.simulator import (
    Antenna,
    FrontEnd,
    NoiseModel,
    ScenePlace,
    draw,
    make_clean,
    make_ideal_measurements,
    make_scene,
    scenes,
)
from skyproof.simulator.correlators import correlate
from skyproof.simulator.measurement_errors import FieldErrors
from skyproof.simulator.received import Scene
from skyproof.simulator.samples import BLOCK, Rendering, map_ahead, prepare_rendering, render, render_quantised

DURATION_S = 2.0
PLAIN_S = 0.02
TAPS_CHIPS = np.linspace(-1.0, 1.0, 41)
COHERENT_S = 0.02
DRAWS = 1000
LONG_S = 3600.0


def report() -> Iterator[str]:
    """Rows of the table."""
    scenario = scenes.make_meaconed(duration_s=DURATION_S, onset_s=0.0)
    scene = make_scene(scenario, make_nominal_constellation(scenario.start_gpst))
    rendering = prepare_rendering(scene, 0)
    signals = len(rendering.sky.signals)
    blocks = range(-(-rendering.n_samples // 131_072))

    def ours() -> None:
        for _ in map_ahead(lambda block: render_quantised(rendering, block), blocks):
            pass

    ours_s, plain_s = take_turns(ours, lambda: _plain(rendering), runs=5)
    factor, plain_factor = DURATION_S / ours_s.median, PLAIN_S / plain_s.median
    yield f"simulator, {signals} signals at {rendering.front_end.rate_hz / 1e6:g} Msps, all cores"
    yield line(
        "a second of one receiver's samples",
        ours_s * (1.0 / DURATION_S),
        "s",
        f"{factor:.1f} times real time; plain NumPy {plain_factor:.2g} ({factor / plain_factor:.0f} times slower)",
    )
    yield from _growth()
    yield from _correlators(scene)
    yield from _measurements()


def _growth() -> Iterator[str]:
    """How the work grows with satellites, rate and antennas: 8-bit samples behind a filter, noise included."""
    place = ScenePlace(lat_deg=47.38, lon_deg=8.54, height_m=450.0)
    start = np.datetime64("2024-05-14T09:59:58", "ns")
    navigation = make_nominal_constellation(start)
    whole = make_clean(place, start, receivers=1, duration_s=DURATION_S, mask_deg=0.0)
    sats = tuple(heard.id.sat for heard in make_scene(whole, navigation).skies[0].signals)[:12]
    cases = ((6, 4e6, 1), (12, 4e6, 1), (12, 25e6, 1), (12, 4e6, 4))
    for n_sats, rate_hz, n_antennas in cases:
        front_end = FrontEnd(rate_hz=rate_hz, bandwidth_hz=0.8 * rate_hz, encoding="int", bits=8)
        antennas = tuple(Antenna(name=str(k), body_m=(0.1 * k, 0.0, 0.0)) for k in range(n_antennas))
        receiver = whole.receivers[0].model_copy(update={"antennas": antennas})
        sky = whole.sky.model_copy(update={"sats": sats[:n_sats]})
        scene = make_scene(
            whole.model_copy(update={"front_end": front_end, "receivers": (receiver,), "sky": sky}), navigation
        )
        renderings = [prepare_rendering(scene, index) for index in range(n_antennas)]

        def ours(renderings: list[Rendering] = renderings) -> None:
            for rendering in renderings:
                for _ in map_ahead(partial(render_quantised, rendering), range(-(-rendering.n_samples // BLOCK))):
                    pass

        (took_s,) = take_turns(ours, runs=5)
        found = len(scene.skies[0].signals)
        what = f"{found} satellites, {rate_hz / 1e6:g} Msps, {n_antennas} antenna{'s' if n_antennas > 1 else ''}"
        factor = DURATION_S / took_s.median
        yield line(f"  {what}", took_s * (1.0 / DURATION_S), "s a second", f"{factor:.1f} times real time")


def _correlators(scene: Scene) -> Iterator[str]:
    """A trial is one integration of every signal's taps."""
    rng, sky = np.random.default_rng(1), scene.skies[0]
    pairs_s = 0.5 + COHERENT_S * np.arange(50)
    clean = make_scene(scene.scenario.model_copy(update={"attacks": ()}), scene.navigation)
    wanted = {"delays_chips": TAPS_CHIPS, "coherent_s": COHERENT_S, "rng": rng}
    many_s, moving_s, clean_s, naive_s = take_turns(
        lambda: correlate(scene, 0, [1.0], draws=(DRAWS,), **wanted),
        lambda: correlate(scene, 0, pairs_s, **wanted),
        lambda: correlate(clean, 0, np.tile(pairs_s, 10), **wanted),
        lambda: _naive(scene),
        runs=5,
        clock=process_time,
    )
    naive = 1.0 / naive_s.median
    yield f"correlators, {TAPS_CHIPS.size} taps over {COHERENT_S * 1e3:g} ms, one core; by samples {naive:.2g} a second"
    rows = (
        (f"draws of one epoch, {len(sky.signals)} signals in pairs", many_s, DRAWS),
        ("epochs of the same, as copies move", moving_s, pairs_s.size),
        (f"epochs of a clean sky, {len(clean.skies[0].signals)} signals", clean_s, 10 * pairs_s.size),
    )
    for kind, took_s, trials in rows:
        rate = trials / took_s.median
        beside = f"{rate:.0f} a second, {rate / naive:.0f} times as many"
        yield line(kind, took_s * (1e6 / trials), "us a trial", beside)


def _measurements() -> Iterator[str]:
    """Satellite-epochs of both receivers of a long scene."""
    scenario = scenes.make_meaconed(duration_s=LONG_S, onset_s=1.0)
    scene = make_scene(scenario, make_nominal_constellation(scenario.start_gpst))
    short = make_scene(scenario.model_copy(update={"duration_s": 60.0}), scene.navigation)
    rng, geometries = np.random.default_rng(1), make_ideal_measurements(scene)
    cells, few = (sum(each.present.size for each in those) for those in (geometries, make_ideal_measurements(short)))
    field = NoiseModel(field=FieldErrors())
    white_s, draw_s, field_s, pulled_s = take_turns(
        lambda: draw(make_ideal_measurements(scene), rng=rng),
        lambda: draw(geometries, rng=rng),
        lambda: draw(geometries, rng=rng, noise=field),
        lambda: make_ideal_measurements(short, pulled=True),
        runs=5,
        clock=process_time,
    )
    yield "measurements, one core"
    rows = (
        ("geometry and white noise", white_s, cells),
        ("white noise alone", draw_s, cells),
        ("noise and errors of the field", field_s, cells),
        ("geometry, pulled", pulled_s, few),
    )
    for kind, took_s, count in rows:
        yield line(kind, took_s * (1e9 / count), "ns a cell", f"{count / took_s.median / 1e6:.3g} million a second")


def _naive(scene: Scene) -> NDArray[np.complex128]:
    """One trial by samples: rendered, then correlated with every tap; without data bits and Doppler taps."""
    rendering = prepare_rendering(scene, 0)
    sky, rate_hz = rendering.sky, rendering.front_end.rate_hz
    count = int(COHERENT_S * rate_hz)
    planes = render(rendering, 0)
    samples = (planes[0] + 1j * planes[1])[: min(count, BLOCK)]
    true_s = np.arange(samples.size) / rate_hz
    code_s, carrier_s = sky.delays_s(true_s)
    sums = np.empty((len(sky.signals), TAPS_CHIPS.size), np.complex128)
    for column, heard in enumerate(sky.signals):
        code = sky.signal.code(prn_of(heard.id.sat))
        wiped = samples * np.exp(2j * np.pi * sky.signal.carrier_hz * carrier_s[:, column])
        chips = (true_s - code_s[:, column]) * sky.signal.chip_rate_hz
        for tap, ahead_chips in enumerate(TAPS_CHIPS):
            sums[column, tap] = code[np.floor(chips + ahead_chips).astype(np.int64) % code.size] @ wiped
    return sums


def _plain(rendering: Rendering) -> NDArray[np.complex128]:
    """The same sum of signals and noise, one array operation after the other; the bits are left out."""
    sky, rate_hz = rendering.sky, rendering.front_end.rate_hz
    elapsed_s = np.arange(int(PLAIN_S * rate_hz)) / rate_hz
    true_s = elapsed_s + sky.true_minus_elapsed_s(elapsed_s)
    rng = np.random.default_rng(1)
    samples = rng.standard_normal(elapsed_s.size) + 1j * rng.standard_normal(elapsed_s.size)
    delay_s, carrier_delay_s, cn0_dbhz = sky.code_delay_s(true_s), sky.carrier_delay_s(true_s), sky.cn0_dbhz(true_s)
    for column, code in enumerate(rendering.codes):
        chip = np.floor((true_s - delay_s[:, column]) * sky.signal.chip_rate_hz).astype(np.int64) % code.size
        phase_cyc = sky.signal.carrier_hz * (true_s - elapsed_s - carrier_delay_s[:, column])
        amplitude = np.sqrt(2.0 / rate_hz) * 10.0 ** (cn0_dbhz[:, column] / 20.0)
        samples += amplitude * code[chip] * np.exp(2j * np.pi * phase_cyc)
    return np.sign(samples.real) + 1j * np.sign(samples.imag)
