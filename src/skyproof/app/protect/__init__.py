"""The main job: recordings in, spoofed signals named, the true position out."""

from skyproof.app.protect.judging import judge
from skyproof.app.protect.run import ProtectResult, protect, verdict_of

__all__ = ["ProtectResult", "judge", "protect", "verdict_of"]
