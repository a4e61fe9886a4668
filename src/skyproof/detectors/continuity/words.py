"""What does not go on, in words."""

from collections.abc import Sequence

from skyproof.detectors.continuity.steps import Step
from skyproof.detectors.continuity.whole_sky import SkyMotion
from skyproof.gnss.time import iso
from skyproof.records import Cause, Observations

__all__ = ["clock", "drawn_off_words", "moved_words", "seconds", "step_causes", "step_words"]


_REFLECTED_M = 150.0  # half a chip of C/A: a reflection draws a code loop off by no more


def step_words(receiver: str, o: Observations, step: Step, multipath_sigma_m: float) -> str:
    """What does not go on, when, by how much, and what that may be."""
    found = {
        "position": f"the position jumps by {_metres(step.position_m)}",
        "clock": f"the signals' time goes {'back' if step.clock_s > 0.0 else 'ahead'} by {seconds(abs(step.clock_s))}",
        "velocity": f"the velocity jumps by {step.speed_m_s:.1f} m/s",
        "rate": f"the clock's rate jumps by {step.rate * 1e6:+.2f} ppm",
    }
    words = [found[kind] for kind in step.kinds]
    words += ["all carriers break at once"] if step.broke else []
    after = f" after {step.outage_s:.1f} s without measurements" if step.outage_s > 0.0 else ""
    may_be = ["the recording is not continuous", "the signals were exchanged"]
    if "reflections" in step_causes(step):
        may_be.append(
            f"reflections draw ranges off by more than the {multipath_sigma_m:g} m, one sigma, that is stated "
            "(multipath_sigma_m)"
        )
    return f"{receiver}: at {clock(o, step)}{after} {_listed(words)}: {', or '.join(may_be)}"


def step_causes(step: Step) -> tuple[Cause, ...]:
    """What else than an exchange of signals makes such a step.

    Reflections draw a position off, or a velocity; not what all signals have in common, and they break no carriers.
    """
    reflected = set(step.kinds) <= {"position", "velocity"} and not step.broke and step.position_m <= _REFLECTED_M
    return ("missing_samples", "reflections") if reflected else ("missing_samples",)


def clock(o: Observations, step: Step) -> str:
    return iso(o.gpst[step.row], 1)[11:]


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _metres(metres: float) -> str:
    return f"{metres:.1f} m" if metres < 1000.0 else f"{metres / 1000.0:.1f} km"


def seconds(time_s: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if time_s >= size:
            return f"{time_s / size:.4g} {unit}"
    return f"{time_s * 1e9:.0f} ns"


def moved_words(receiver: str, moved: SkyMotion) -> str:
    """Of a receiver that is stated to stand."""
    return (
        f"the carriers of {moved.satellites} satellites in {receiver} move its position by {_metres(moved.metres)} "
        f"within {moved.time_s:.1f} s, and it is stated to stand"
    )


def drawn_off_words(receiver: str, motion: SkyMotion) -> str:
    """Of codes that carriers do not follow."""
    return (
        f"the codes of {motion.satellites} satellites in {receiver} move its position by {_metres(motion.metres)} "
        f"within {motion.time_s:.0f} s, and their carriers do not"
    )
