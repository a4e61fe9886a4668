"""Take sources that stand above the noise out of the samples of an antenna array.

With the covariance R of the antennas' samples x, scaled to powers of 1 and of eigenvalues l and eigenvectors v, they
are replaced by as many combinations of them,

    y = sum over v of noise of v l^(-1/2) v^H x.

Nothing that comes from a source's direction is left in y, and its noise is white. A receiver that weights each
combination by the signal's own amplitude in it, as `receiver.antennas` does, has the best signal-to-noise ratio of all
weights that are blind to the source (Frost, Proc. IEEE 60(8), 1972; Van Trees, Optimum Array Processing, 6.7). So one
filter serves all signals, and neither directions, antenna positions, attitude nor lines need be known.

The filter is that of each block itself. From n independent samples of M antennas the signal-to-noise ratio comes within
the factor (n + 2 - M) / (n + 1) of the best on average (Reed, Mallett, Brennan, IEEE Trans. AES-10(6), 1974, eq. 34):
nothing is lost in a block. What is coarsely quantised keeps noise of the source's own power over the number of levels,
which comes from everywhere.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from skyproof.arrays import Complexes, ComplexFloats, Floats
from skyproof.records import Samples

__all__ = ["Null", "make_null", "measure_rise", "take_out_sources"]

BLOCK_S: Final = 0.1
"""One filter holds so long: a platform that turns by 10 degrees a second has turned by 1 within it."""
_LEAST: Final = 1e-12
"""Of the greatest eigenvalue of a covariance: a combination of antennas with less holds nothing (one that is dead, or
two that are the same)."""


@dataclass(frozen=True, eq=False)
class Null:
    """A filter of one block of samples.

    filter : (M, M) that turns samples of M antennas into combinations without the sources. n_sources : how many are
    taken out. rise : by which factor the sources raise the noise of one antenna, 1 without any.
    """

    filter: Complexes
    n_sources: int
    rise: float


def make_null(covariance: Complexes, most_sky: float) -> Null:
    """Make the filter that takes out what stands above the noise.

    covariance : (M, M) of the samples. most_sky : most power that a true sky has on one antenna, over the noise's; what
    has no more is left. One combination is always kept.
    """
    power = np.real(np.diag(covariance))
    scale = np.divide(1.0, np.sqrt(power), out=np.zeros_like(power), where=power > 0.0)
    values, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    kept = values > _LEAST * max(values[-1], 0.0)
    if not kept.any():  # a gap that is bridged with zeros
        return Null(np.zeros_like(covariance), 0, 1.0)
    values, vectors = values[kept], vectors[:, kept]
    quiet = values <= values[0] * (1.0 + values.size * most_sky)
    noise = vectors[:, quiet]
    return Null(
        filter=(noise / np.sqrt(values[quiet])) @ noise.conj().T * scale,
        n_sources=int(np.sum(~quiet)),
        rise=1.0 if quiet.all() else float(1.0 / values[0]),
    )


def measure_rise(samples: Samples, start: int, count: int, most_sky_hz: float) -> float:
    """Measure by which factor sources raise one antenna's noise in a stretch, 1 without any.

    most_sky_hz : as of `take_out_sources`.
    """
    return _make_null(samples.read_all(start, count), most_sky_hz / samples.rate_hz).rise


def take_out_sources(samples: Samples, most_sky_hz: float, *, block_s: float = BLOCK_S) -> Samples:
    """Return a recording of several antennas without the sources that stand above their noise.

    most_sky_hz : most power of a true sky over the density of the noise; what has no more is left.

    The antennas of what is returned are combinations of those of `samples`: phases between them give no directions. A
    stretch read is the same whatever was read before.

    Raises ValueError for one antenna.
    """
    antennas = (samples, *samples.others)
    if len(antennas) < 2:
        raise ValueError(f"{samples.name} has one antenna; a source is taken out of several")
    block = min(max(round(block_s * samples.rate_hz), 1), max(samples.n_samples, 1))
    read = _Filtered(samples, most_sky_hz / samples.rate_hz, block)
    first, *rest = (replace(antenna, read=partial(read, number), others=()) for number, antenna in enumerate(antennas))
    return replace(first, others=tuple(rest))


def _make_null(planes: Floats, most_sky: float) -> Null:
    waves = _join(planes)
    return make_null((waves @ waves.conj().T / max(waves.shape[1], 1)).astype(np.complex128), most_sky)


def _join(planes: Floats) -> ComplexFloats:
    return np.asarray(planes[:, 0] + 1j * planes[:, 1])


class _Filtered:
    """Reads one of the combinations. Whoever reads one reads the others of the stretch next: they wait until then."""

    def __init__(self, samples: Samples, most_sky: float, block: int) -> None:
        self._samples, self._most_sky, self._block = samples, most_sky, block
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
        """Filter one block, whole."""
        planes = self._samples.read_all(first, end - first)
        null = _make_null(planes, self._most_sky)
        return np.asarray(null.filter.astype(np.complex64) @ _join(planes))
