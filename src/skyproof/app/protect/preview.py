"""Tell the words so far while recordings are still being tracked."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from time import perf_counter
from typing import Final

from skyproof.app.common.settings import Settings
from skyproof.app.protect.judging import begin_session, choose_orbits
from skyproof.app.protect.so_far import WordsSoFar
from skyproof.app.protect.stated import Stated
from skyproof.app.receive.reception import observe
from skyproof.app.receive.tracker import Tracker
from skyproof.formats.pieces import Workspace
from skyproof.interruption import watch
from skyproof.records import AntennaArray, NavigationData

__all__ = ["Preview"]

_FIRST_WINDOWS: Final = 1.5
"""A window is complete half a window after its end."""
_SOON_S: Final = 10.0
"""A run whose tracking ends within so long is not worth a look: its own words come about as soon."""


class Preview:
    """Look at what is tracked once the first window is complete, and then whenever twice as much is.

    Behind half of the recording the run's own end is near, and there are no more looks; nor are there any while the
    rest would be tracked within `_SOON_S` at the pace so far. All together examine no more windows than the run does in
    the end, which begins again: what comes later may change the week or a half cycle.
    """

    def __init__(
        self,
        stated: Stated,
        navigation: NavigationData | None,
        settings: Settings,
        arrays: Mapping[str, AntennaArray],
        so_far: WordsSoFar,
    ) -> None:
        """Wait for the first window. arrays : where the antennas of receivers with several are."""
        self._stated, self._navigation, self._settings = stated, navigation, settings
        self._arrays, self._so_far = arrays, so_far
        self._next_s = _FIRST_WINDOWS * settings.window_s
        self._begun_s = perf_counter()

    def look(self, trackers: Sequence[Tracker]) -> None:
        """Examine the windows so far, if it is time; what is not to be judged yet is left for later."""
        running = [tracker for tracker in trackers if not (tracker.ended or tracker.broken)]
        tracked_s = min((tracker.examined_s for tracker in running), default=0.0)
        open_s = max((tracker.samples.duration_s - tracker.examined_s for tracker in running), default=0.0)
        if not self._next_s <= tracked_s <= open_s:
            return
        if open_s * (perf_counter() - self._begun_s) / tracked_s < _SOON_S:
            return
        self._next_s = 2.0 * tracked_s
        with suppress(Exception):  # no run is lost for a look ahead: what is wrong will be raised at the end
            self._examine(trackers)

    def _examine(self, trackers: Sequence[Tracker]) -> None:
        interrupted = watch()
        with Workspace() as kept:
            receptions = [
                observe(tracker, self._navigation, self._arrays.get(tracker.samples.name), kept, diagnose=False)
                for tracker in trackers
            ]
            if any(r.observations is None or r.observations.gpst.size < 2 for r in receptions):
                return
            ready = self._stated.equip(receptions, self._settings)
            orbits = choose_orbits(ready.receptions, self._navigation)
            session = begin_session(
                ready.receptions, orbits, ready.settings, ready.spin_arms, ready.body, ready.predictors
            )
            for step in session.steps():
                self._so_far.take(step)
                if interrupted():
                    return
