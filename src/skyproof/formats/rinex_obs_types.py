"""Name the signals behind observation types of RINEX 2, 3 and 4."""

from collections.abc import Iterable, Sequence
from typing import Final

from skyproof.errors import make_readable
from skyproof.formats.bounds import list_names
from skyproof.formats.rinex_cells import Layout
from skyproof.gnss.signals import rinex_signal
from skyproof.remarks import Remark, RemarkKind

__all__ = ["KINDS", "map_signals", "report_names"]

_BY_TYPE_2: Final = {
    "C1": "1C",
    "P1": "1P",
    "C2": "2C",
    "P2": "2P",
    "C5": "5X",
    "C6": "6X",
    "C7": "7X",
    "C8": "8X",
}
"""The RINEX 3 signal of a code of version 2 (RINEX 3.05, section 10): the channel of a modern code is not given: X."""
_BY_SYSTEM_2: Final = {
    "G": {"P1": "1W", "P2": "2W", "C2": "2X"},
    "E": {"C1": "1X"},
    "C": {"C1": "2I", "C2": "2I", "C7": "7I", "C6": "6I"},
}
KINDS: Final = ("C", "L", "D", "S")
_SYSTEMS: Final = "GRECJSI"
_NO_SIGNALS: Final = ("I", "X", "T")
"""Types that are known and not read: the ionosphere's delay, the receiver's channel, and Transit (table A23; 2.11)."""


def map_signals(types: Sequence[str], system: str, version: float) -> dict[tuple[str, str], dict[str, int]]:
    """Map band and code to the fields of code, phase, Doppler and strength."""
    found: dict[tuple[str, str], dict[str, int]] = {}
    for column, name in sorted(enumerate(types), key=lambda typed: len(typed[1]) != 3):  # whole names first
        type_3 = _complete_name(name, types, system, version)
        signal = rinex_signal(system, type_3[1:], version) if type_3[:1] in KINDS else None
        if signal is not None:
            found.setdefault(signal, {}).setdefault(type_3[0], column)
    return found


def _complete_name(name: str, types: Sequence[str], system: str, version: float) -> str:
    """Return the name in version 3 of a type; "" for one that has no meaning, or not one alone.

    Names of version 2 stand in headers of version 3 as well, and the other way round.
    """
    if len(name) == 3:
        return name if name[0] in KINDS else ""
    if len(name) != 2 or name[0] not in "CLPDS":
        return ""
    if version >= 3.0 and (system == "C" or (name[1] != "1" and not {f"C{name[1]}", f"P{name[1]}"} & set(types))):
        return ""  # BeiDou's bands were numbered otherwise; and which of two codes a phase is of, is not known
    type_3 = _name_as_version_3(name, types, system)
    return type_3 if len(type_3) == 3 else ""


def report_names(layouts: Iterable[Layout], version: float) -> list[str]:
    """Report names of types that the version does not have: what they are read as, or that they are left out."""
    read, unknown = list[str](), list[str]()
    for layout in layouts:
        for system, types in layout.items():
            for name in types:
                wholes = {s: _complete_name(name, types, s, version) for s in (system or _SYSTEMS)}
                whole = next((n for s, n in wholes.items() if n and rinex_signal(s, n[1:], version)), "")
                if whole and (len(name) == 3) == (version >= 3.0):
                    continue
                if whole:
                    read.append(f"{system} {name} as {whole}".strip())
                elif name[:1] not in _NO_SIGNALS:
                    unknown.append(f"{system} {make_readable(name[:12])}".strip())
    open_ = list_names([*dict.fromkeys(unknown)])
    has_not = f"observation types that RINEX {version:g} does not have"
    return [
        *([f"{has_not} are read as what they mean: {list_names([*dict.fromkeys(read)])}"] if read else []),
        *([Remark(f"{has_not}, or whose meaning is open, are left out: {open_}", RemarkKind.BEARS)] if unknown else []),
    ]


def _name_as_version_3(name: str, types: Sequence[str], system: str) -> str:
    """Name a type of version 2 as version 3 does.

    Version 2 does not state a phase's code: it is C/A on the first band if there is one, else the other.
    """
    kind, band = name[:1], name[1:]
    codes = (f"C{band}", f"P{band}") if band == "1" or system != "G" else (f"P{band}", f"C{band}")
    code = name if kind in "CP" else next((c for c in codes if c in types), codes[0])
    attribute = _BY_SYSTEM_2.get(system, {}).get(code, _BY_TYPE_2.get(code, ""))
    return ("C" if kind == "P" else kind) + attribute
