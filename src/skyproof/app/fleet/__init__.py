"""The main job for many inputs: a catalogue in, a folder an item, one page and one table over all."""

from skyproof.app.fleet.run import FleetResult, fleet

__all__ = ["FleetResult", "fleet"]
