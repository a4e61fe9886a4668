"""What a message tells beside its sentence: the file, the place, the values that came and that were expected."""

import re

__all__ = ["match_facts"]


def match_facts(text: str) -> str:
    """Return the pattern of these facts in this order, whatever the words between them. ` … ` parts the facts."""
    return ".*".join(map(re.escape, text.split(" … ")))
