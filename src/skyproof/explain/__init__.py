"""Findings in words: the one place of sentences, remedies and assumptions that people read.

    explain(finding).sentence      what a test found, or why it could not run
    explain(finding).remedy        what would let it run, or decide
    explain(finding).assumptions   what its word assumes

Each detector has a module of its name here with its `ENTRIES`, one a code; a detector knows none of this.
"""

from skyproof.explain.entry import Entry, Wording
from skyproof.explain.table import explain, list_entries, stands_beside

__all__ = ["Entry", "Wording", "explain", "list_entries", "stands_beside"]
