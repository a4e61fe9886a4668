"""Tell the word so far during a run, and leave what was decided on the disk for whoever comes after a kill."""

import json
from collections.abc import Sequence
from typing import Final

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.common.session import DecidedWindow
from skyproof.app.protect.outputs import write_evidence_line
from skyproof.formats.pieces import Workspace
from skyproof.fusion.decide import Deciding
from skyproof.gnss.time import format_clock, format_iso
from skyproof.records import Finding, VerdictWord
from skyproof.verdict import write_word

__all__ = ["NOTES", "WordsSoFar"]

_EVIDENCE: Final = "evidence.jsonl"
_WORDS: Final = "words.jsonl"
NOTES: Final = (_EVIDENCE, _WORDS)
"""Files of what was found and decided, a line a finding or a receiver's window, until the outputs hold it too."""


class WordsSoFar:
    """Tell the run's word whenever it changes.

    workspace : where each window is written down; nowhere if absent.
    """

    def __init__(self, progress: Progress, workspace: Workspace | None) -> None:
        self._progress, self._workspace = progress, workspace
        self._word: VerdictWord | None = None
        self._until: np.datetime64 | None = None

    def take(self, step: DecidedWindow) -> None:
        """Note a window's findings and decision, and report the run's word where it changed.

        A window that ends no later than one before is left out: it was taken while the run was tracking.
        """
        end = step.records.end_gpst
        if self._until is not None and end <= self._until:
            return
        self._until = end
        self.note(step.findings)
        self._note_words(step.deciding, end)
        word = step.deciding.word
        if word is not None and word != self._word:
            self._word = word
            self._progress.say(f"up to {format_clock(format_iso(end, 0))}: {write_word(word)}")

    def note(self, findings: Sequence[Finding]) -> None:
        """Write findings down."""
        if self._workspace is not None:
            self._workspace.note(_EVIDENCE, [write_evidence_line(e) for e in findings])

    def _note_words(self, deciding: Deciding, end_gpst: np.datetime64) -> None:
        if self._workspace is None:
            return
        latest = [deciding.words[place] for place in deciding.latest.values()]
        rows = [
            {
                "receiver": word.receiver,
                "word": word.word,
                "since_gpst": format_iso(word.start_gpst, 3),
                "until_gpst": format_iso(word.end_gpst, 3),
                "may_also_be": list(word.causes),
                "run": deciding.word,
            }
            for word in latest
            if word.end_gpst == end_gpst
        ]
        self._workspace.note(_WORDS, [json.dumps(row) for row in rows])
