"""One sentence: what `skyproof protect` can do with a recording, and what would make it stronger."""

from collections.abc import Sequence
from typing import Final, Protocol

from skyproof.records import Samples

__all__ = ["Heard", "advice"]

_FIX_SATS: Final = 4
_TEST_SATS: Final = 5
"""From five on, positions can be tested for consistency."""
_EPHEMERIS_S: Final = 36.0
"""Three subframes of 6 s, which come every 30 s, begun anywhere."""
_SUBFRAME_S: Final = 12.0
"""A whole subframe of 6 s, begun anywhere."""
_TRACKED_S: Final = 2.0  # `Settings.window_s` has no less
_REACH_HZ: Final = 7000.0


class Heard(Protocol):
    """A satellite of an inspection."""

    @property
    def doppler_hz(self) -> float: ...
    @property
    def peaks(self) -> int: ...


def advice(samples: Samples, satellites: Sequence[Heard], *, gaps: int, mirrored: bool) -> str:
    """The sentence. mirrored : whether the description reads the spectrum the wrong way round."""
    n, several = len(satellites), sum(satellite.peaks > 1 for satellite in satellites)
    if n == 0:
        return (
            "`protect` can do nothing with it: no satellite was heard; check rate_hz, centre_hz and if_hz first, then "
            "the antenna."
        )
    needs = []
    if mirrored:
        needs.append("conjugate = true where it is told how to read it")
    if samples.duration_s < _TRACKED_S:
        needs.append(f"{_EPHEMERIS_S:.0f} s of recording (with --nav {_SUBFRAME_S:.0f} s)")
        can = "is too short for `protect`, which follows signals for seconds"
        can += "; that several signals of one satellite were heard already speaks of false ones" if several else ""
        return f"It {can}; what it needs: {_listed(needs)}."
    if n < _FIX_SATS:
        can = "can look for second signals of a satellite, but give no position"
        needs.append("a better view of the sky")
    elif n < _TEST_SATS:
        can = "can give a position, but not test it"
        needs.append("a better view of the sky")
    else:
        can = "can label its signals, test their consistency and give a position"
    if samples.duration_s < _SUBFRAME_S:
        needs.append(f"{_SUBFRAME_S:.0f} s or more, for the time in the messages")
    if samples.duration_s < _EPHEMERIS_S:
        needs.append("--nav, for it is too short to hold all orbits")
    if samples.start_gpst is None:
        needs.append("start_gpst, for the week")
    if any(abs(satellite.doppler_hz) > _REACH_HZ for satellite in satellites):
        farthest_hz = max(abs(satellite.doppler_hz) for satellite in satellites)
        needs.append(f"--doppler-max-hz {1e3 * (farthest_hz // 1e3 + 2.0):.0f}")
    if gaps:
        needs.append("a recorder that loses no samples")
    needs.append("a second receiver some tens of metres away, recorded at the same time")
    return f"`protect` {can}; stronger with {_listed(needs)}."


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
