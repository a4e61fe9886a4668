"""Classes of oscillators: how far their frequency wanders, and the two states that predict a clock from it."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from skyproof.arrays import Reals

__all__ = ["OSCILLATORS", "PLATFORM_CLASSES", "Oscillator", "compute_clock_step"]

_MIDDLE_S: Final = 30.0  # averaging time at which two states do no more than the flicker noise that they stand for


@dataclass(frozen=True, kw_only=True)
class Oscillator:
    """Power-law densities of the fractional frequency, one-sided: S(f) = h0 + h_1 / f + h_2 / f^2.

    white_s : h0 in s; flicker : h-1, without unit; walk_hz : h-2 in 1/s.
    """

    white_s: float = 0.0
    flicker: float = 0.0
    walk_hz: float = 0.0
    source: str = ""

    def allan_deviation(self, tau_s: ArrayLike) -> Reals:
        """Compute the Allan deviation by theory, at averaging times of any shape (NIST SP 1065, table 3)."""
        tau_s = np.asarray(tau_s, np.float64)
        return np.asarray(
            np.sqrt(
                0.5 * self.white_s / tau_s
                + 2.0 * np.log(2.0) * self.flicker
                + 2.0 / 3.0 * np.pi**2 * self.walk_hz * tau_s
            )
        )


_BROWN_HWANG = "Brown and Hwang, Introduction to Random Signals and Applied Kalman Filtering, 4th ed., table 9.3"
OSCILLATORS: dict[str, Oscillator] = {
    "perfect": Oscillator(source="no noise"),
    "tcxo": Oscillator(white_s=2e-19, flicker=7e-21, walk_hz=2e-20, source=f"{_BROWN_HWANG}, low quality"),
    "tcxo-good": Oscillator(white_s=2e-21, flicker=1e-22, walk_hz=3e-24, source=f"{_BROWN_HWANG}, high quality"),
    "ocxo": Oscillator(white_s=2e-25, flicker=7e-25, walk_hz=6e-25, source=_BROWN_HWANG),
    "rubidium": Oscillator(white_s=2e-22, flicker=4.5e-26, walk_hz=1e-30, source=_BROWN_HWANG),
    "caesium": Oscillator(white_s=2e-22, flicker=5e-27, walk_hz=1.5e-33, source=_BROWN_HWANG),
    "csac": Oscillator(
        white_s=1.8e-19,
        flicker=7e-24,
        source="limits of a chip-scale atomic clock's data sheet (Microchip SA.45s): Allan deviation 3e-10 at 1 s, "
        "1e-11 at 1000 s, the flicker takes what the white noise leaves; a random walk is not stated",
    ),
}
"""By class. Typical values: single oscillators of one class differ by factors of several."""

PLATFORM_CLASSES: Final = {"quartz": "tcxo", "tcxo": "tcxo", "ocxo": "ocxo", "csac": "csac", "rubidium": "rubidium"}
"""Of a platform file, which does not say of what quality: the poorest of each class. A crystal without compensation
differs from a compensated one by temperature, over minutes and hours; over seconds it has the noise of a poor one."""


def compute_clock_step(oscillator: Oscillator, seconds: float) -> tuple[Reals, Reals]:
    """Return transition (2, 2) and noise (2, 2) of a clock's offset in s and its drift over a time.

    Exact for white and random-walk frequency noise (Brown and Hwang, Introduction to Random Signals and Applied Kalman
    Filtering, 4th ed., 9.3). Flicker noise has no two states. White and walking noise stand for it that together have
    its Allan deviation at 30 s, and a larger one at every other averaging time: 1.3 times at 10 and 90 s. Steady ageing
    and effects of temperature and acceleration are not in it.
    """
    flicker = 2.0 * np.log(2.0) * oscillator.flicker
    white = 0.5 * oscillator.white_s + 0.5 * flicker * _MIDDLE_S
    walk = 2.0 * np.pi**2 * oscillator.walk_hz + 1.5 * flicker / _MIDDLE_S
    noise = np.array(
        [
            [white * seconds + walk * seconds**3 / 3.0, walk * seconds**2 / 2.0],
            [walk * seconds**2 / 2.0, walk * seconds],
        ]
    )
    return np.array([[1.0, seconds], [0.0, 1.0]]), noise
