"""Reduce code periods of every channel to one row of measurements at a common receiver time.

The loops' own states are correlated in time. What is measured here is not them but the loop's replica plus what the
correlators find beside it, fitted over the block: white from block to block, whatever the loops' bandwidths.
Once bits are known, correlators are summed over a data bit first, and the bits wiped off, so that hardly any squaring
loss remains; the discriminators are ratios of sums over the whole block.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from skyproof.arrays import Complexes, ComplexFloats, Integers, Reals
from skyproof.compiled import compiled
from skyproof.gnss.signals import SignalPlan
from skyproof.receiver import kernels as k
from skyproof.receiver.discriminator import Discriminator
from skyproof.records import Selectable

# Columns of what `measure` gives for a channel (float64).
PERIODS = 0  # whole code periods that the received code shows, since the start of the channel's code period 0
FRACTION_S = 1  # the rest, s
CARRIER_CYC = 2  # grows with the range; arbitrary start
DOPPLER_HZ = 3
CN0_DBHZ = 4
CODE_SIGMA_S = 5
CARRIER_SIGMA_CYC = 6
DOPPLER_SIGMA_HZ = 7
SLIP = 8  # 1 if the carrier slipped, or may have, since the last row that was given out
JUMP = 9  # largest step of the carrier's phase beside the loop's, over its sigma
TURNED = 10  # 1 if the carrier is nearer to half a cycle off the loop's: data bits have the other sign on it
QUADRATURE_S = 11  # as the code beside the replica, of the part a quarter of a cycle off the carrier
N_COLUMNS = 12

# Columns of what an antenna of several measures beside their sum, of which the columns above tell (float64).
OWN_CODE_S = 0  # to be added to FRACTION_S
OWN_PHASE_CYC = 1  # ahead of the sum's; unwrapped from row to row
OWN_DOPPLER_HZ = 2  # above the sum's
OWN_CN0_DBHZ = 3
OWN_CODE_SIGMA_S = 4
OWN_PHASE_SIGMA_CYC = 5
OWN_DOPPLER_SIGMA_HZ = 6
OWN_SLIP = 7  # 1 if OWN_PHASE_CYC slipped, or may have, since the last row
N_OWN = 8

UNSYNCHRONISED_PERIODS = 20  # a group, while it is not known where bits begin
STRAY_CYC = 0.05  # by so much signal and loop may part in the time of a group; a slip takes several
SLIP_SUSPECTED_CYC = 0.15  # a step of the residual that may hide a slip of half a cycle
MIN_GROUPS = 5
LEAST_CN0_HZ = 10.0
PARABOLA_SHARE = 5.0 / 9.0
"""Of the variance of a parabola's value in the middle of a block, what a mean over the block does not have."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Measurements(Selectable):
    """Measurements of any number of channels and epochs, one a row, in order of time.

    elapsed_s : (n,) receiver time. arc : (n,) int64, which stretch of tracking. table : (n, N_COLUMNS).
    taps : (n, n_looks, n_taps) complex64, mean correlator of a code period with bits and carrier wiped off, over each
        look: equal parts of the block, or the whole of it; NaN where none was taken.
    turns_rad : (n, n_looks) by which the taps of a guided channel were turned to take off what its carrier was ahead of
        the replica's, bits aside; NaN of all others.
    first_power : (n, n_looks) of the prompt on the first antenna of several in each look; of one antenna (n, 0).
    own : (n, n_antennas, N_OWN) of each antenna, if there are several: `table` and `taps` belong to their sum then. Of
    one
        antenna it is (n, 0, N_OWN).
    """

    elapsed_s: Reals
    arc: Integers
    table: Reals
    taps: ComplexFloats
    own: Reals
    turns_rad: Reals
    first_power: Reals

    def __len__(self) -> int:
        return int(self.arc.size)

    def column(self, index: int) -> Reals:
        """Return one column of the table, (n,)."""
        return self.table[:, index]

    def on_antenna(self, antenna: int) -> "Measurements":
        """Return what one antenna of several measured, numbered from 0: the rows in which it had the signal."""
        rows = np.isfinite(self.own[:, antenna, OWN_PHASE_CYC])
        part = self.select(rows)
        antenna_values, table = part.own[:, antenna], part.table.copy()
        table[:, FRACTION_S] += antenna_values[:, OWN_CODE_S]
        table[:, CARRIER_CYC] -= antenna_values[:, OWN_PHASE_CYC]
        table[:, DOPPLER_HZ] += antenna_values[:, OWN_DOPPLER_HZ]
        table[:, CN0_DBHZ] = antenna_values[:, OWN_CN0_DBHZ]
        table[:, CODE_SIGMA_S] = antenna_values[:, OWN_CODE_SIGMA_S]
        # The value in the middle of the block goes by the curvature that the sum shows.
        of_sum = PARABOLA_SHARE * table[:, CARRIER_SIGMA_CYC] ** 2
        table[:, CARRIER_SIGMA_CYC] = np.sqrt(antenna_values[:, OWN_PHASE_SIGMA_CYC] ** 2 + of_sum)
        table[:, DOPPLER_SIGMA_HZ] = antenna_values[:, OWN_DOPPLER_SIGMA_HZ]
        begins = np.zeros(len(part), np.bool_)
        begins[np.unique(part.arc, return_index=True)[1]] = True  # an arc's first row has nothing to have slipped from
        table[:, SLIP] = np.maximum(table[:, SLIP], np.where(begins, 0.0, antenna_values[:, OWN_SLIP]))
        return replace(part, table=table, own=part.own[:, :0])

    @staticmethod
    def nothing(n_looks: int = 1, n_taps: int = 0, n_antennas: int = 0) -> "Measurements":
        """Return measurements without a row."""
        return Measurements(
            elapsed_s=np.empty(0),
            arc=np.empty(0, np.int64),
            table=np.empty((0, N_COLUMNS)),
            taps=np.empty((0, n_looks, n_taps), np.complex64),
            own=np.empty((0, n_antennas, N_OWN)),
            turns_rad=np.empty((0, n_looks)),
            first_power=np.empty((0, n_looks if n_antennas and n_looks > 1 else 0)),
        )

    @staticmethod
    def join(parts: Sequence["Measurements"]) -> "Measurements":
        """Join the rows of all parts, in their order."""
        if not parts:
            return Measurements.nothing()
        return Measurements(
            **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Measurements)}
        )


def measure(
    states: Reals,
    before: tuple[Reals, Integers],
    now: tuple[Reals, Integers],
    elapsed_s: float,
    rate_hz: float,
    if_hz: float,
    signal: SignalPlan,
    discriminator: Discriminator,
) -> tuple[Reals, ComplexFloats, Complexes]:
    """Measure all channels at receiver time `elapsed_s` from the code periods around it.

    states : (n_channels, N_STATE); the columns that belong to the measurements are carried forward in place.
    before, now : rows (n_channels, max_periods, columns) of the kernel and how many of them count, of the two frames.

    Returns
    -------
    table (n_channels, N_COLUMNS), NaN for a channel with too few periods; taps (n_channels, n_taps), means over
    the block, NaN of those not taken in all of it; rotations
    (n_channels, periods of both frames) that take carrier and data bit off each code period, zero where there is none.

    Phase and frequency come from a parabola through the phases of the groups (so a constant acceleration biases
    neither); their sigmas are the Cramer-Rao bound of that model times the squaring loss of a group, 1 + 1/(2 C/N0 T)
    (Kaplan & Hegarty, 8.9). The code's sigma is that of a coherent early-minus-late discriminator over the block.
    """
    n_taps = (before[0].shape[2] - k.OUT_TAPS) // 2
    table = np.full((states.shape[0], N_COLUMNS), np.nan)
    taps = np.zeros((states.shape[0], n_taps), np.complex128)
    wipe = np.zeros((states.shape[0], before[0].shape[1] + now[0].shape[1]), np.complex128)
    _measure(
        states,
        *before,
        *now,
        elapsed_s,
        rate_hz,
        if_hz,
        signal.carrier_hz,
        signal.chip_rate_hz,
        signal.period_s,
        signal.periods_per_symbol,
        discriminator.gain,
        discriminator.noise_chips2,
        table,
        taps,
        wipe,
    )
    return table, taps.astype(np.complex64), wipe


@compiled
def _measure(
    states: Reals,
    rows_before: Reals,
    count_before: Integers,
    rows_now: Reals,
    count_now: Integers,
    elapsed_s: float,
    rate_hz: float,
    if_hz: float,
    carrier_hz: float,
    chip_rate_hz: float,
    period_s: float,
    periods_per_bit: int,
    code_gain: float,
    code_noise_chips2: float,
    table: Reals,
    taps: Complexes,
    wipe: Complexes,
) -> None:
    for channel in range(states.shape[0]):
        n_before, n = count_before[channel], count_before[channel] + count_now[channel]
        if n_before == 0 or n == n_before:
            continue
        rows = np.empty((n, rows_now.shape[2]))
        rows[:n_before] = rows_before[channel, :n_before]
        rows[n_before:] = rows_now[channel, : n - n_before]
        _measure_channel(
            states[channel],
            rows,
            elapsed_s,
            rate_hz,
            if_hz,
            carrier_hz,
            chip_rate_hz,
            period_s,
            periods_per_bit,
            code_gain,
            code_noise_chips2,
            table[channel],
            taps[channel],
            wipe[channel, :n],
        )


@compiled
def _measure_channel(
    state: Reals,
    rows: Reals,
    elapsed_s: float,
    rate_hz: float,
    if_hz: float,
    carrier_hz: float,
    chip_rate_hz: float,
    period_s: float,
    periods_per_bit: int,
    code_gain: float,
    code_noise_chips2: float,
    result: Reals,
    taps: Complexes,
    wipe: Complexes,
) -> None:
    n = rows.shape[0]
    synchronised = state[k.BIT_START] >= 0.0
    group = _assign_groups(rows[:, k.OUT_PERIOD], state[k.BIT_START], periods_per_bit)
    n_groups = group[n - 1] + 1
    if n_groups < MIN_GROUPS:
        return
    epoch = elapsed_s * rate_hz
    at_epoch = 0
    while at_epoch + 1 < n and rows[at_epoch + 1, k.OUT_START] <= epoch:
        at_epoch += 1
    reference_hz = rows[at_epoch, k.OUT_FREQUENCY]
    phase = rows[at_epoch, k.OUT_PHASE] + reference_hz * (epoch - rows[at_epoch, k.OUT_START]) / rate_hz

    prompt = rows[:, k.OUT_TAPS + 2] + 1j * rows[:, k.OUT_TAPS + 3]
    sums = np.zeros(n_groups, np.complex128)
    squares = np.zeros(n_groups, np.complex128)
    weight, loop_cyc = np.zeros(n_groups), np.zeros(n_groups)
    middle_s, square_s2 = np.zeros(n_groups), np.zeros(n_groups)
    for r in range(n):
        g = group[r]
        t = (rows[r, k.OUT_START] - epoch) / rate_hz + 0.5 * period_s
        sums[g] += prompt[r]
        squares[g] += prompt[r] * prompt[r]
        weight[g] += 1.0
        middle_s[g] += t
        square_s2[g] += t * t
        loop_cyc[g] += rows[r, k.OUT_PHASE] + 0.5 * period_s * rows[r, k.OUT_FREQUENCY] - phase - reference_hz * t
    middle_s /= weight
    square_s2 /= weight
    loop_cyc /= weight
    if synchronised:
        squares = sums * sums

    coherent_s = period_s * (n / n_groups if synchronised else 1.0)
    wipe[:] = 1.0
    cn0_hz = 10.0 ** (0.1 * state[k.CN0_DBHZ])  # before bits are known, what it was
    if synchronised:
        cn0_hz = _carrier_to_noise_hz(prompt, wipe, group, synchronised, period_s)
    expected = _period_variance(max(cn0_hz, LEAST_CN0_HZ), coherent_s, period_s)
    residual_cyc, slipped, jump = _unwrap(state, squares, expected / weight)
    if slipped:
        state[k.SLIPPED] = 1.0
    fit, variance = _fit_parabola(middle_s, square_s2, loop_cyc + residual_cyc, weight)

    # Rotations that leave the signal on the real axis, bits wiped off.
    along = 0.0
    for r in range(n):
        g = group[r]
        turn = np.exp(-2j * np.pi * (fit[0] + fit[1] * middle_s[g] + fit[2] * square_s2[g] - loop_cyc[g]))
        along += turn.real
        seen = sums[g] * turn if synchronised else prompt[r] * turn
        wipe[r] = turn if seen.real >= 0.0 else -turn
    code_chips = 0.0
    code_s = 0.0
    for r in range(n):
        for tap in range(taps.shape[0]):
            value = complex(rows[r, k.OUT_TAPS + 2 * tap], rows[r, k.OUT_TAPS + 2 * tap + 1])
            taps[tap] += value * wipe[r] / n
        ahead_s = (epoch - rows[r, k.OUT_START]) / rate_hz
        carrier_ahead_s = (phase - rows[r, k.OUT_PHASE] - if_hz * ahead_s) / carrier_hz
        code_chips += (rows[r, k.OUT_CHIP] - rows[r, k.OUT_SHIFT]) / n
        code_s += ((rows[r, k.OUT_PERIOD] - rows[at_epoch, k.OUT_PERIOD]) * period_s + ahead_s + carrier_ahead_s) / n
    difference = taps[0] - taps[2]
    level = taps[1].real
    if not level > 0.0:
        return
    code_chips += difference.real / level / code_gain

    cn0_hz = max(_carrier_to_noise_hz(prompt, wipe, group, synchronised, period_s), LEAST_CN0_HZ)
    period_variance = _period_variance(cn0_hz, coherent_s, period_s)
    result[PERIODS] = rows[at_epoch, k.OUT_PERIOD]
    result[FRACTION_S] = code_s + code_chips / chip_rate_hz
    result[CARRIER_CYC] = if_hz * elapsed_s - phase - fit[0]
    result[DOPPLER_HZ] = reference_hz + fit[1] - if_hz
    result[CN0_DBHZ] = 10.0 * math.log10(cn0_hz)
    result[CODE_SIGMA_S] = math.sqrt(code_noise_chips2 / (n * period_s * cn0_hz)) / chip_rate_hz
    result[CARRIER_SIGMA_CYC] = math.sqrt(variance[0] * period_variance)
    result[DOPPLER_SIGMA_HZ] = math.sqrt(variance[1] * period_variance)
    result[SLIP] = state[k.SLIPPED]
    # By the weakest quarter: what noise does once a signal has faded must not pass for a jump.
    weakest_hz = cn0_hz
    for quarter in range(4):
        q = slice(n * quarter // 4, n * (quarter + 1) // 4)
        weakest_hz = min(weakest_hz, _carrier_to_noise_hz(prompt[q], wipe[q], group[q], synchronised, period_s))
    weakest = _period_variance(max(weakest_hz, LEAST_CN0_HZ), coherent_s, period_s)
    result[JUMP] = jump * math.sqrt(expected / weakest)
    result[TURNED] = 1.0 if along < 0.0 else 0.0
    result[QUADRATURE_S] = difference.imag / level / code_gain / chip_rate_hz


@compiled
def _period_variance(cn0_hz: float, coherent_s: float, period_s: float) -> float:
    """Return the phase variance, cycles squared, of one period's share of a longer coherent sum."""
    return (1.0 + 0.5 / (cn0_hz * coherent_s)) / (2.0 * cn0_hz * period_s) / (2.0 * math.pi) ** 2


@compiled
def _assign_groups(periods: Reals, bit_start: float, periods_per_bit: int) -> Integers:
    """Assign each period to a group: its data bit, or a run of a few periods while bits are not known."""
    length = periods_per_bit if bit_start >= 0.0 else UNSYNCHRONISED_PERIODS
    start = max(bit_start, 0.0)
    group = np.empty(periods.size, np.int64)
    first = math.floor((periods[0] - start) / length)
    for r in range(periods.size):
        group[r] = math.floor((periods[r] - start) / length) - first
    return group


@compiled
def _unwrap(state: Reals, squares: Complexes, variance: Reals) -> tuple[Reals, bool, float]:
    """Unwrap the phase of the signal less the loop's in each group, cycles, from the block before.

    Also returned is whether it slipped, and the largest step over its sigma.

    squares : (n_groups,), their angles twice the phase; variance : (n_groups,) of the phase, cycles squared.

    A bit turns the phase by half a cycle and squaring hides that, so the residual is known modulo half a cycle. The
    loop holds it near a multiple of that; when it moves to another one, the loop has slipped. A mean that follows the
    groups as fast as their noise allows tells which multiple is near. The first and the last group of a block may be a
    single period: continued from its noise alone, the phase would slip where the loop did not.
    """
    before, known, offset = state[k.RESIDUAL], state[k.RESIDUAL_VARIANCE], state[k.HALF_CYCLES]
    began = before
    suspected = False
    jump = 0.0
    residual = np.empty(squares.size)
    for g in range(squares.size):
        wrapped = 0.25 * math.atan2(squares[g].imag, squares[g].real) / math.pi
        if math.isnan(before):
            before, known = wrapped + 0.5 * offset, variance[g]
            began = before
        step = wrapped + 0.5 * offset - before
        turns = math.floor(2.0 * step + 0.5)
        offset -= turns
        step -= 0.5 * turns
        jump = max(jump, abs(step) / math.sqrt(known + variance[g]))
        share = (known + STRAY_CYC**2) / (known + STRAY_CYC**2 + variance[g])
        suspected |= abs(share * step) > SLIP_SUSPECTED_CYC
        before += share * step
        known = share * variance[g]
        residual[g] = wrapped + 0.5 * offset
    state[k.RESIDUAL], state[k.RESIDUAL_VARIANCE], state[k.HALF_CYCLES] = before, known, offset
    slipped = math.floor(2.0 * before + 0.5) != math.floor(2.0 * began + 0.5)
    return residual, suspected or slipped, jump


@compiled
def _fit_parabola(t: Reals, t2: Reals, y: Reals, weight: Reals) -> tuple[Reals, Reals]:
    """Fit a weighted least-squares parabola: coefficients (3,), and their variances for unit variance at weight 1.

    y are means over groups, and so are t and its squares t2: the mean of a parabola is not its value in the middle, by
    0.0017 cycle for a bit at 2 g.
    """
    scale = max(abs(t[0]), abs(t[t.size - 1]))
    normal = np.zeros((3, 3))
    right = np.zeros(3)
    for g in range(t.size):
        powers = (1.0, t[g] / scale, t2[g] / scale**2)
        for i in range(3):
            right[i] += weight[g] * powers[i] * y[g]
            for j in range(3):
                normal[i, j] += weight[g] * powers[i] * powers[j]
    # The adjugate: three by three needs no library.
    inverse = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            c, d = (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = normal[a, c] * normal[b, d] - normal[a, d] * normal[b, c]
    determinant = normal[0, 0] * inverse[0, 0] + normal[0, 1] * inverse[1, 0] + normal[0, 2] * inverse[2, 0]
    inverse /= determinant
    scales = np.array([1.0, scale, scale * scale])
    fit = np.zeros(3)
    for i in range(3):
        for j in range(3):
            fit[i] += inverse[i, j] * right[j] / scales[i]
    return fit, np.array([inverse[0, 0], inverse[1, 1], inverse[2, 2]]) / scales**2


@compiled
def _carrier_to_noise_hz(
    prompt: Complexes,
    wipe: Complexes,
    group: Integers,
    synchronised: bool,
    period_s: float,
) -> float:
    """Estimate C/N0 as a ratio in hertz.

    Noise follows from the differences of neighbouring prompts within a bit, signal from the bit's sum less the noise in
    it. The loop's phase affects neither, and noise biases neither. While bits are not known, the real axis carries
    signal and noise, the imaginary one noise alone.
    """
    n = prompt.size
    if not synchronised:
        noise = 0.0
        power = 0.0
        for r in range(n):
            turned = prompt[r] * wipe[r]
            power += turned.real * turned.real / n
            noise += turned.imag * turned.imag / n
        return (power - noise) / (2.0 * noise * period_s) if noise > 0.0 else 0.0
    differences, pairs = 0.0, 0
    for r in range(1, n):
        if group[r] == group[r - 1]:
            step = prompt[r] - prompt[r - 1]
            differences += step.real * step.real + step.imag * step.imag
            pairs += 1
    if pairs == 0 or differences <= 0.0:
        return 0.0
    noise = 0.5 * differences / pairs
    signal, squares = 0.0, 0.0
    total, length = 0.0 + 0.0j, 0.0
    for r in range(n):
        total += prompt[r]
        length += 1.0
        if r == n - 1 or group[r + 1] != group[r]:
            signal += total.real * total.real + total.imag * total.imag - length * noise
            squares += length * length
            total, length = 0.0 + 0.0j, 0.0
    # A ratio of means: the inverse of an estimated variance is large by 1 + 1/(its degrees of freedom), 3/2 of them a
    # pair lost to the overlap of neighbouring differences.
    return signal / squares / (noise * period_s) * (1.0 - 1.5 / pairs)
