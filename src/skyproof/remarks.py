"""What is said of an input beside what it holds, and whether that bears on the answer."""

from collections.abc import Iterable
from enum import IntEnum

__all__ = ["Remark", "RemarkKind"]


class RemarkKind(IntEnum):
    """What a remark on an input does to the answer, the gravest last."""

    NOTE = 0  # nothing: the answer means the same without it
    BEARS = 1  # part of the input was not used, or is doubtful: the answer does not cover it
    CUT = 2  # the input ends early or changed while it was read: the answer holds up to there only


class Remark(str):
    """A remark on an input that bears on the answer. A plain `str` among remarks is a note.

    It is text, so that remarks are joined, compared and written as text. A text made from it is plain: `reword`
    keeps the kind.
    """

    __slots__ = ("kind",)
    kind: RemarkKind

    def __new__(cls, text: str, kind: RemarkKind) -> "Remark":
        remark = super().__new__(cls, text)
        remark.kind = kind
        return remark

    def __getnewargs__(self) -> tuple[str, RemarkKind]:  # type: ignore[override]
        return str(self), self.kind

    @staticmethod
    def kind_of(remark: str) -> RemarkKind:
        """Return the kind of a remark, `NOTE` of a plain text."""
        return remark.kind if isinstance(remark, Remark) else RemarkKind.NOTE

    @staticmethod
    def without_cut(remarks: Iterable[str]) -> tuple[str, ...]:
        """Return the remarks on a stretch that lies before the cut: the cut is a note."""
        return tuple(str(remark) if Remark.kind_of(remark) is RemarkKind.CUT else remark for remark in remarks)

    @staticmethod
    def reword(remark: str, text: str) -> str:
        """Return another text of the same kind."""
        kind = Remark.kind_of(remark)
        return Remark(text, kind) if kind else text
