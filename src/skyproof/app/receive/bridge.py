"""Put zeros in the place of samples that were never recorded: receiver time and the signals' codes continue."""

from dataclasses import replace

import numpy as np

from skyproof.app.receive.policy import POLICY
from skyproof.arrays import Floats
from skyproof.records import Samples
from skyproof.remarks import Remark, RemarkKind

__all__ = ["bridge_gaps"]


def bridge_gaps(samples: Samples, *, begun_s: float = 0.0) -> tuple[Samples, tuple[str, ...]]:
    """Fill a recording's known gaps with zeros, and say what was done; itself if it has none.

    It ends before the gap that would make more zeros than the policy allows; a remark says how to continue behind it.

    begun_s : how much of the file lies before the recording's first sample, for that remark.
    """
    if not samples.gaps:
        return samples, ()
    zeros = np.cumsum([gap.missing_samples for gap in samples.gaps])
    n_kept = int(np.searchsorted(zeros, POLICY.bridged_s * samples.rate_hz, side="right"))
    kept, rest = samples.gaps[:n_kept], samples.gaps[n_kept:]
    n_zeros = int(zeros[n_kept - 1]) if kept else 0
    n_recorded = rest[0].at_sample if rest else samples.n_samples
    firsts = [0, *(gap.at_sample for gap in kept)]  # as recorded, of the stretches between gaps
    shifts = [0, *zeros[:n_kept].tolist()]  # by so much later each of them stands now
    stretches = list(zip(firsts, [*firsts[1:], n_recorded], shifts, strict=True))
    n_samples = n_recorded + n_zeros

    def read(start: int, count: int) -> Floats:
        if start < 0 or count < 0:
            raise ValueError(f"start {start} and count {count} must not be negative")
        stop = min(start + count, n_samples)
        planes = np.zeros((2, max(stop - start, 0)), np.float32)
        for first, end, shift in stretches:
            begin, until = max(start, first + shift), min(stop, end + shift)
            if begin < until:
                planes[:, begin - start : until - start] = samples.read(begin - shift, until - begin)
        return planes

    remarks: list[str] = []
    if kept:
        places = "a gap" if len(kept) == 1 else f"{len(kept)} gaps"
        remarks.append(Remark(f"{places} of {n_zeros / samples.rate_hz:.6g} s bridged with zeros", RemarkKind.BEARS))
    if rest:
        gap = rest[0]
        start_s = begun_s + gap.at_sample / samples.rate_hz
        remarks.append(
            Remark(
                f"used up to the gap of {gap.missing_samples / samples.rate_hz:.6g} s only, for {POLICY.bridged_s:g} s "
                f"of gaps are bridged at most; for what comes after it give start_s = {start_s:.9g}",
                RemarkKind.CUT,
            )
        )
    antennas = tuple(bridge_gaps(other)[0] for other in samples.others)
    return replace(samples, n_samples=n_samples, read=read, gaps=(), others=antennas), tuple(remarks)
