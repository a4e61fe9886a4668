"""Sources taken out of the samples of an antenna array by where they are.

The antennas' samples x = a s + v j + n hold a signal a s, what a strong source sends, v j, and noise. With the
covariance R of all that is not the signal, and the signatures V of sources that must vanish, the samples are replaced
by as many combinations of them,

    y = P S x,    S = R^(-1/2),    P = I - W (W^H W)^-1 W^H,    W = S V,

whose noise is white before P takes the sources out. A receiver that weights each combination by the signal's own
amplitude in it, and turns it by its phase, as `receiver.antennas` does, then has for every signal

    SINR = a^H S P S a

times the power of s, which is the most that any weights w with w^H V = 0 give (linearly constrained minimum variance:
Frost, Proc. IEEE 60(8), 1972; Van Trees, Optimum Array Processing, 6.7). So one filter serves all signals, no
direction of a wanted signal need be known, and neither do antenna positions, attitude and lines of the antennas: the
signature of what is to vanish is measured, in the samples where it stands above the noise, and in the phases of tracked
signals where it does not.

R is that of the samples themselves, block by block, so that sources above the noise fall below it without being asked
for (power inversion: Compton, IEEE Trans. AES-15(6), 1979). From n independent samples of M antennas the SINR comes
within the factor (n + 2 - M) / (n + 1) of the best on average (Reed, Mallett, Brennan, IEEE Trans. AES-10(6), 1974,
eq. 34): nothing is lost in a block.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from skyproof.arrays import Complexes, ComplexFloats, Floats, Reals
from skyproof.records import Samples

__all__ = ["Signatures", "filter_of", "filtered", "signature_of", "sinr_share"]

Signatures = Callable[[float], Complexes]
"""(n_antennas, n_sources) of sources that are to vanish, at so many seconds from the first sample."""

BLOCK_S: Final = 0.1
"""One filter holds so long: a platform that turns by 10 degrees a second has turned by 1 within it."""
_LEAST: Final = 1e-12
"""Of the greatest eigenvalue of a covariance: a combination of antennas with less holds nothing (one that is dead, or
two that are the same)."""


def filter_of(covariance: Complexes, signatures: Complexes) -> Complexes:
    """(M, M) that turns samples of M antennas into combinations without the sources.

    covariance : (M, M) of the samples. signatures : (M, K) of sources that are to vanish, in units of the samples up
    to a factor each; K may be 0.

    Raises ValueError if the sources leave nothing: as many as antennas that receive.
    """
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _LEAST * max(values[-1], 0.0)
    if not kept.any():  # a gap that is bridged with zeros
        return np.zeros_like(covariance)
    values, vectors = values[kept], vectors[:, kept]
    white = (vectors / np.sqrt(values)) @ vectors.conj().T
    basis, strength, _ = np.linalg.svd(white @ signatures, full_matrices=False)
    basis = basis[:, strength > np.sqrt(_LEAST) * strength.max(initial=0.0)]
    if basis.shape[1] >= values.size:
        raise ValueError(f"{basis.shape[1]} sources cannot be taken out of the samples of {values.size} antennas")
    return np.asarray(white - basis @ (basis.conj().T @ white))


def sinr_share(filter_: Complexes, signature: Complexes, covariance: Complexes) -> float:
    """SINR behind the filter over that of all antennas without any source, by theory.

    signature : (M,) of a signal. covariance : (M, M) of the noise alone.
    """
    alone = np.real(signature.conj() @ np.linalg.solve(covariance, signature))
    return float(np.sum(np.abs(filter_ @ signature) ** 2) / alone)


def signature_of(phase_cyc: Reals, sigma_cyc: Reals, noise_rms: Reals) -> Complexes:
    """(M,) of one source, from the phases of all its signals on M antennas.

    phase_cyc, sigma_cyc : (n, M), rows of any epochs and signals; what the antennas of a row share is arbitrary. Rows
    with NaN are left out. noise_rms : (M,) of the antennas' samples.

    The sigma of a phase is as its antenna's noise over the amplitude. Rows are joined by the vector that fits their
    outer products best (the first principal component), so their common phases do not matter.

    Raises ValueError if no row is complete.
    """
    rows = np.isfinite(phase_cyc).all(axis=1) & np.isfinite(sigma_cyc).all(axis=1)
    if not rows.any():
        raise ValueError("no signal of the source was measured on all antennas")
    seen = np.exp(2j * np.pi * phase_cyc[rows]) / sigma_cyc[rows]
    _, vectors = np.linalg.eigh(seen.T @ seen.conj())
    return np.asarray(vectors[:, -1] * noise_rms)


def filtered(samples: Samples, signatures: Signatures | None = None, *, block_s: float = BLOCK_S) -> Samples:
    """A recording of several antennas without what stands above their noise, and without the sources named.

    The antennas of what is returned are combinations of those of `samples`: phases between them give no
    directions. A stretch read is the same whatever was read before.

    Raises ValueError for one antenna; when read, for sources that leave nothing.
    """
    antennas = (samples, *samples.others)
    if len(antennas) < 2:
        raise ValueError(f"{samples.name} has one antenna; a source is taken out of several")
    read = _Filtered(samples, signatures, min(max(round(block_s * samples.rate_hz), 1), max(samples.n_samples, 1)))
    first, *rest = (replace(antenna, read=partial(read, number), others=()) for number, antenna in enumerate(antennas))
    return replace(first, others=tuple(rest))


class _Filtered:
    """Reads one of the combinations. Whoever reads one reads the others of the stretch next: they wait until then."""

    def __init__(self, samples: Samples, signatures: Signatures | None, block: int) -> None:
        self._samples, self._signatures, self._block = samples, signatures, block
        self._stretch: tuple[int, int] | None = None
        self._waiting: dict[int, Floats] = {}

    def __call__(self, antenna: int, start: int, count: int) -> Floats:
        if start < 0 or count < 0:
            raise ValueError(f"start {start} and count {count} must not be negative")
        if self._stretch != (start, count) or antenna not in self._waiting:
            self._waiting = dict(enumerate(self._read(start, min(start + count, self._samples.n_samples))))
            self._stretch = (start, count)
        return self._waiting.pop(antenna)

    def _read(self, start: int, stop: int) -> Floats:
        out = np.empty((1 + len(self._samples.others), 2, max(stop - start, 0)), np.float32)
        n_blocks = self._samples.n_samples // self._block  # the last of which has what is left over as well
        for number in range(min(start // self._block, n_blocks - 1), n_blocks):
            first = number * self._block
            if first >= stop:
                break
            end = first + self._block if number < n_blocks - 1 else self._samples.n_samples
            part = self._combine_antennas(first, end)[:, max(start - first, 0) : stop - first]
            rows = slice(max(first - start, 0), max(first - start, 0) + part.shape[1])
            out[:, 0, rows], out[:, 1, rows] = part.real, part.imag
        return out

    def _combine_antennas(self, first: int, end: int) -> ComplexFloats:
        """One block, whole."""
        planes = self._samples.read_all(first, end - first)
        waves = planes[:, 0] + 1j * planes[:, 1]
        covariance = (waves @ waves.conj().T / waves.shape[1]).astype(np.complex128)
        middle_s = 0.5 * (first + end) / self._samples.rate_hz
        sources = np.zeros((waves.shape[0], 0)) if self._signatures is None else self._signatures(middle_s)
        return np.asarray(filter_of(covariance, sources).astype(np.complex64) @ waves)
