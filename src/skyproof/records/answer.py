"""Name what is answered: the word of a run, a receiver or a window, and the label of a signal."""

from typing import Final, Literal, get_args

__all__ = ["LABELS", "WORDS", "Label", "VerdictWord"]

VerdictWord = Literal["authentic", "no_attack_seen", "suspect", "spoofed"]
"""authentic : positive evidence that the signals come from the sky, for every receiver, all the time.
no_attack_seen : every test that could run passed.
suspect : a test failed, and what else than an attack may be the reason is not excluded.
spoofed : there is an attack.
"""
WORDS: Final[tuple[VerdictWord, ...]] = get_args(VerdictWord)
Label = Literal["authentic", "spoofed", "multipath", "unknown"]
"""multipath : a late copy of another signal, by a reflector or a repeater. unknown : nothing was shown of it."""
LABELS: Final[tuple[Label, ...]] = get_args(Label)
