"""Tell the word so far while a run goes on, and leave what was decided on the disk for whoever comes after a kill."""

import json
from collections.abc import Sequence
from typing import Final

import numpy as np

from skyproof.app.common.progress import Progress
from skyproof.app.protect.outputs import evidence_line
from skyproof.formats.pieces import Workspace
from skyproof.fusion.decide import Deciding, VerdictWord, decide
from skyproof.gnss.time import iso
from skyproof.records import Finding, Records
from skyproof.verdict import clock_words, word_shown

__all__ = ["NOTES", "WordsSoFar"]

_EVIDENCE: Final = "evidence.jsonl"
_WORDS: Final = "words.jsonl"
NOTES: Final = (_EVIDENCE, _WORDS)
"""Files of what was found and decided, a line a finding or a receiver's window, until the outputs hold it too."""


class WordsSoFar:
    """Decide each window as it comes.

    workspace : where each window is written down; nowhere if absent.
    """

    def __init__(self, progress: Progress, workspace: Workspace | None) -> None:
        self._progress, self._workspace = progress, workspace
        self._state = Deciding()
        self._word: VerdictWord | None = None

    def take(self, records: Records, findings: Sequence[Finding]) -> None:
        """Decide a window; note what was found, and tell the run's word where it is another one."""
        received = [o.receiver for o in records.observations]
        span = records.start_gpst, records.end_gpst
        self._state, _ = decide(self._state, findings, received, *span)
        self.note(findings)
        self._note_words(span[1])
        word = self._state.word
        if word is not None and word != self._word:
            self._word = word
            self._progress.say(f"up to {clock_words(iso(span[1], 0))}: {word_shown(word)}")

    def note(self, findings: Sequence[Finding]) -> None:
        """Write findings down."""
        if self._workspace is not None:
            self._workspace.note(_EVIDENCE, [evidence_line(e) for e in findings])

    def _note_words(self, end_gpst: np.datetime64) -> None:
        if self._workspace is None:
            return
        latest = [self._state.words[place] for place in self._state.latest.values()]
        rows = [
            {
                "receiver": word.receiver,
                "word": word.word,
                "since_gpst": iso(word.start_gpst, 3),
                "until_gpst": iso(word.end_gpst, 3),
                "may_also_be": list(word.causes),
                "run": self._state.word,
            }
            for word in latest
            if word.end_gpst == end_gpst
        ]
        self._workspace.note(_WORDS, [json.dumps(row) for row in rows])
